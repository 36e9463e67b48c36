"""Scan matchers of the literature behind the one `Matcher` protocol, one paper a file."""

from collections.abc import Callable, Mapping
from difflib import get_close_matches

from frontends.matcher import Matcher
from frontends.matchers.errors import MatcherError


def make_matcher(name: str) -> Matcher:
    """A matcher with its default settings.

    Args:
        name: a key of `MATCHERS`.

    Returns:
        The matcher.

    Raises:
        MatcherError: there is no such matcher.
    """
    factory = MATCHERS.get(name)
    if factory is None:
        close = get_close_matches(name, MATCHERS, n=1)
        hint = f"; did you mean '{close[0]}'?" if close else ""
        raise MatcherError(f"no matcher '{name}', expected one of {', '.join(MATCHERS)}{hint}")
    return factory()


def _icp() -> Matcher:
    from frontends.matchers.icp import IcpMatcher

    return IcpMatcher()


def _plicp() -> Matcher:
    from frontends.matchers.plicp import PlicpMatcher

    return PlicpMatcher()


def _idc() -> Matcher:
    from frontends.matchers.idc import IdcMatcher

    return IdcMatcher()


def _mbicp() -> Matcher:
    from frontends.matchers.mbicp import MbicpMatcher

    return MbicpMatcher()


def _wsm() -> Matcher:
    from frontends.matchers.wsm import WsmMatcher

    return WsmMatcher()


def _qwsm() -> Matcher:
    from frontends.matchers.qwsm import QwsmMatcher

    return QwsmMatcher()


def _ndt() -> Matcher:
    from frontends.matchers.ndt import NdtMatcher

    return NdtMatcher()


def _csm() -> Matcher:
    from frontends.matchers.csm import CsmMatcher

    return CsmMatcher()


MATCHERS: Mapping[str, Callable[[], Matcher]] = {
    "icp": _icp,
    "plicp": _plicp,
    "idc": _idc,
    "mbicp": _mbicp,
    "wsm": _wsm,
    "qwsm": _qwsm,
    "ndt": _ndt,
    "csm": _csm,
}
"""Makers of each matcher with its defaults, by the name used on the command line; a kernel is imported when made."""
