"""The fuzzer's findings stay mended, and a short run of it finds no more."""

import itertools
from pathlib import Path

import pytest

from tests.fuzz.__main__ import CORPUS, inputs
from tests.fuzz.mutations import mutate
from tests.fuzz.targets import TARGETS
from tests.fuzz.trial import attempt

_INPUTS = 1200
_USED = 40
"""Every so many accepted inputs are used, not only read."""
_SECONDS = 1500.0
"""More than the fuzzer allows: the first inputs wait for kernels to compile."""
_FOUND = sorted(CORPUS.glob("*--*"))


@pytest.mark.parametrize("path", [pytest.param(path, id=path.name) for path in _FOUND])
def test_what_once_broke_something_no_longer_does(path: Path, tmp_path: Path) -> None:
    target = TARGETS[path.name.partition("--")[0]]
    if target.prepare:
        target.prepare(tmp_path)
    assert attempt(target, tmp_path, path.read_bytes(), seconds=_SECONDS).finding == ""


@pytest.mark.parametrize("name", TARGETS)
def test_a_sound_input_is_accepted(name: str, tmp_path: Path) -> None:
    target = TARGETS[name]
    for content in target.seeds:
        if target.prepare:
            target.prepare(tmp_path)
        trial = attempt(target, tmp_path, content, seconds=_SECONDS)
        assert trial.accepted
        assert trial.finding == ""


@pytest.mark.parametrize("name", TARGETS)
def test_changed_inputs_end_in_a_result_or_an_error(name: str, tmp_path: Path) -> None:
    target, accepted = TARGETS[name], 0
    for _, content in itertools.islice(inputs(1, [name]), _INPUTS // len(TARGETS)):
        if target.prepare:
            target.prepare(tmp_path)
        trial = attempt(target, tmp_path, content, use=accepted % _USED == _USED - 1, seconds=_SECONDS)
        accepted += trial.accepted
        assert trial.finding == "", content[:300]


def test_the_same_seed_makes_the_same_inputs() -> None:
    one, other = (list(itertools.islice(inputs(7, list(TARGETS)), 200)) for _ in range(2))
    assert one == other


def test_mutations_change_nearly_every_input() -> None:
    import random

    rng = random.Random(3)
    seed = TARGETS["flaser"].seeds[0]
    assert sum(mutate(seed, rng) != seed for _ in range(200)) > 160
