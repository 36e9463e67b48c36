"""The matchers of one scan against one other: pairs, their fit, and again until nothing moves."""

import math
from abc import abstractmethod
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frontends.matchers import _covariance_kernels, _pair_kernels
from frontends.matchers._icp_kernels import Stopping
from frontends.matchers._outline_kernels import Outline
from frontends.matchers._pair_kernels import Pairs, Trimming
from frontends.matchers.acceptance import AcceptanceConfig, Alignment
from frontends.matchers.bearing_scan import BearingScan
from frontends.matchers.errors import require
from frontends.matchers.point_matcher import PointMatcher
from frontends.scan import Scan

_NO_END = 3
"""Above every kind of end of an outline: no pair is left out for lying at one."""
_MOST_PUBLISHED = 500
"""Most iterations of a run as published."""


@dataclass(frozen=True, kw_only=True)
class PairConfig:
    """Settings that ICP, PLICP, IDC and MbICP share."""

    max_distance: float = 2.0
    """Farthest correspondence [m]."""
    trim: float = 0.95
    """Share of the correspondences kept in each iteration, the nearest ones …"""
    adaptive_order: float = 0.7
    """… and, once the iterations have settled, those below `adaptive_factor` times this quantile of them: far from the
    optimum that would keep only what agrees by chance."""
    adaptive_factor: float = 4.0
    """See `adaptive_order`."""
    coarse_points: int = 90
    """About so many points of the scan are used until the iterations have settled."""
    coarse_epsilon: float = 2e-3
    """They have settled when one of them moves the scan by less than this [m, rad]."""
    epsilon: float = 1e-4
    """The iterations end when none of them moves the scan farther than this [m, rad]."""
    max_iterations: int = 80
    """Most iterations before they have settled, and most after."""
    strict_first: float = 0.9
    """Strict iterations from the guess come first. Where they settle with points this close to the reference on average
    (1 is on it), the last ones begin; else wide ones settle too, and the closer is taken. Above 1 there are only wide
    ones, which in a corridor can slide away from a good guess."""
    as_published: bool = False
    """One run on all points with the farthest share trimmed and nothing else, as in the paper: pairs at the ends of
    what the reference saw stay. They hold a scan against itself, and pull at one from elsewhere."""
    max_gap: float = 0.5
    """Neighbouring points nearer than this are joined by a straight piece of surface [m]."""
    range_sigma: float = 0.01
    """Least standard deviation of one range [m], for the covariance."""
    weak_share: float = 0.01
    """A direction is unobservable when fewer than this share of the correspondences constrain it."""
    acceptance: AcceptanceConfig = field(default_factory=AcceptanceConfig)
    """When a match is credible."""

    def __post_init__(self) -> None:
        for name in ("max_distance", "adaptive_factor", "epsilon", "max_gap", "range_sigma"):
            value = getattr(self, name)
            require(value > 0, f"{name} must be positive, found {value}")
        for name in ("trim", "adaptive_order"):
            value = getattr(self, name)
            require(0 < value <= 1, f"{name} must lie in (0, 1], found {value}")
        require(self.coarse_points >= 10, f"coarse_points must be at least 10, found {self.coarse_points}")
        require(
            self.coarse_epsilon >= self.epsilon,
            f"coarse_epsilon must be at least epsilon, found {self.coarse_epsilon}",
        )
        require(self.strict_first > 0, f"strict_first must be positive, found {self.strict_first}")
        require(self.max_iterations >= 1, f"max_iterations must be at least 1, found {self.max_iterations}")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceScan:
    """The scan that is matched against, in the frame of its laser.

    Attributes:
        outline: its returns, and which of them are joined.
        T_ref_laser: (3,) its laser in the reference frame of the caller.
    """

    outline: Outline
    T_ref_laser: NDArray[np.float64]

    def __len__(self) -> int:
        """Number of returns."""
        return len(self.outline.xy)


class SingleScanMatcher(PointMatcher[ReferenceScan, BearingScan]):
    """Matches against the newest scan of the reference; the older ones are left out.

    Covariance: Censi's closed form, how the noise of every range of both scans moves the minimum. The noise is that of
    the residuals, where it exceeds the laser's: what the scans do not share shows there.
    """

    def __init__(self, config: PairConfig) -> None:
        super().__init__(config.acceptance)
        self._pairs = config

    @abstractmethod
    def _iterate(
        self,
        outline: Outline,
        points: NDArray[np.float64],
        start: NDArray[np.float64],
        trimming: Trimming,
        stopping: Stopping,
    ) -> tuple[NDArray[np.float64], Pairs, int]:
        """The paper's iterations: pose, last pairs and number of iterations from points (n, 2) and a start (3,)."""

    def _extract(self, scan: Scan) -> BearingScan:
        return BearingScan.of(scan)

    def _place(self, scans: list[Scan], T_ref_lasers: NDArray[np.float64]) -> ReferenceScan:
        points = self._points_of(scans[-1])
        linked = points.links(self._pairs.max_gap)
        outline = Outline(points.xy, points.bearings, linked, points.ends(linked))
        return ReferenceScan(outline=outline, T_ref_laser=T_ref_lasers[-1])

    def _align(self, reference: ReferenceScan, points: BearingScan, T_frame_guess: NDArray[np.float64]) -> Alignment:
        config = self._pairs
        start = np.asarray(T_frame_guess, dtype=np.float64)
        if config.as_published:
            return self._last(reference, points, start, self._trimming(_NO_END, adaptive=False))
        settled = self._settled(reference.outline, points, start)
        return self._last(reference, points, settled, self._trimming(1, adaptive=True))

    def _settled(self, outline: Outline, points: BearingScan, start: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where the iterations settle on some of the points: with strict rules, or wide ones if those end closer."""
        config, reach = self._pairs, self._acceptance.inlier_distance
        some = np.ascontiguousarray(points.xy[:: max(1, round(len(points) / config.coarse_points))])
        stopping = Stopping(config.max_iterations, config.coarse_epsilon)
        wide, strict = self._trimming(2, adaptive=False), self._trimming(1, adaptive=True)
        if config.strict_first > 1.0:
            return self._iterate(outline, some, start, wide, stopping)[0]
        first = self._iterate(outline, some, start, strict, stopping)[0]
        close = _pair_kernels.closeness(outline, some, first, reach)
        if close >= config.strict_first:
            return first
        second = self._iterate(outline, some, start, wide, stopping)[0]
        return second if _pair_kernels.closeness(outline, some, second, reach) > close else first

    def _trimming(self, least_end: int, *, adaptive: bool) -> Trimming:
        config = self._pairs
        factor = config.adaptive_factor if adaptive else math.inf
        return Trimming(config.max_distance, config.trim, config.adaptive_order, factor, least_end)

    def _last(
        self, reference: ReferenceScan, points: BearingScan, start: NDArray[np.float64], trimming: Trimming
    ) -> Alignment:
        """Where they end on all points."""
        config, outline = self._pairs, reference.outline
        stopping = Stopping(_MOST_PUBLISHED if config.as_published else config.max_iterations, config.epsilon)
        pose, pairs, iterations = self._iterate(outline, points.xy, start, trimming, stopping)
        hessian, scatter, (count, total) = _covariance_kernels.covariance_parts(outline, pairs, pose)
        variance = max(config.range_sigma**2, total / max(count - 3, 1))
        return Alignment(
            T_frame_laser=pose,
            hessian=hessian,
            scatter=variance * scatter,
            pairs=int(np.count_nonzero(pairs.kept)),
            residual=math.sqrt(total / max(count, 1)),
            iterations=int(iterations),
            weak_share=config.weak_share,
        )

    def _agreeing(
        self, reference: ReferenceScan, points: BearingScan, T_frame_laser: NDArray[np.float64]
    ) -> tuple[int, int]:
        inliers, known = _pair_kernels.agreement(
            reference.outline,
            points.xy,
            T_frame_laser,
            self._acceptance.inlier_distance,
            self._acceptance.known_distance,
        )
        return int(inliers), int(known)
