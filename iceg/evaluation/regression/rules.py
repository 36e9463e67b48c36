"""Rules, gates and special cases of a run that can be switched off, one at a time, to see what each is worth.

Most have no setting, and those that turn out to be worth nothing shall not get one: they go. So a rule is named by the
function that holds it, and switched off by another in its place. A name that no longer leads anywhere is an error: the
row of the rule goes with the rule.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import reduce
from importlib import import_module
from math import inf
from types import MappingProxyType
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from graph.ranges import RATES
from iceg.config import Config
from iceg.evaluation.errors import EvaluationError
from iceg.slam.broken_path.place_votes import Vote
from iceg.slam.broken_path.relocalisation import Failures, relocalise
from iceg.slam.closure_config import ConfirmedAreaConfig
from iceg.slam.closures.candidates import Candidate, EarlierPasses
from iceg.slam.loop_closure import LoopCloser
from iceg.slam.solution import Solution

Change = Callable[[Config], Config]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """Something a run does that it might as well not do.

    Attributes:
        what: it does, for a person.
        without: what stands in place of each function or constant, by `module:name` or `module:Class.name`, the module
            being the one that uses it.
        config: the settings that switch it off, where there are any.
    """

    what: str
    without: Mapping[str, Any] = field(default_factory=dict)
    config: Change | None = None


def _nothing(*_args: object, **_named: object) -> None:
    return None


def _no(*_args: object, **_named: object) -> bool:
    return False


def _yes(*_args: object, **_named: object) -> bool:
    return True


def _zero(*_args: object, **_named: object) -> float:
    return 0.0


def _empty(*_args: object, **_named: object) -> list[Any]:
    return []


def _mean_velocities(velocities: NDArray[np.float64], *given: NDArray[Any]) -> NDArray[np.float64]:
    """As if every step that is seen told as much of every other, however the robot turned."""
    seen = given[-1]
    return np.broadcast_to(velocities[seen].mean(axis=0) if seen.any() else np.zeros(3), velocities.shape)


def _first(first: Any, *_args: object, **_named: object) -> Any:  # noqa: ANN401
    """What was given, as it was."""
    return first


def _second(_self: object, second: Any, *_args: object, **_named: object) -> Any:  # noqa: ANN401
    """What a method was given, as it was."""
    return second


def _only_after_a_loss(closer: LoopCloser, solution: Solution, failures: Failures) -> tuple[Solution, Failures]:
    if not any(failure.is_lost for failure in failures.values()):
        return solution, failures
    return relocalise(closer, solution, failures)


def _only_near(passes: EarlierPasses, first: int, *where: Any) -> list[Candidate]:  # noqa: ANN401
    """Without the nearest pass where none is near."""
    *of, _reach = where
    return [candidate for candidate in passes.within(*of) if candidate.key_old < first]


def _no_variance(errors: NDArray[np.float64], *_args: object) -> NDArray[np.float64]:
    return np.zeros(len(errors))


def _with_loops(**settings: Any) -> Change:  # noqa: ANN401
    return lambda config: replace(config, loops=replace(config.loops, **settings))


def _believing_little(config: Config) -> Config:
    false_match = replace(config.ice.false_match, similar_per_metre=0.0, probability=RATES[0])
    return replace(config, ice=replace(config.ice, false_match=false_match))


def _among_nobody(config: Config) -> Config:
    check = replace(config.front_end.odometry_check, crowded=RATES[0])
    return replace(config, front_end=replace(config.front_end, odometry_check=check))


def _running_away(config: Config) -> Config:
    newest = replace(config.front_end.tracking.velocity, change_ahead=1e3, change_aside=1e3, kept_aside=1.0)
    tracking = replace(config.front_end.tracking, velocity=newest)
    return replace(config, front_end=replace(config.front_end, tracking=tracking))


def _with_any_odometry(config: Config) -> Config:
    calibration = replace(config.front_end.calibration, worse_than_velocity=1e6)
    return replace(config, front_end=replace(config.front_end, calibration=calibration))


def _without_joint_refinement(config: Config) -> Config:
    joint = replace(config.finish.joint, enabled=False)
    return replace(config, finish=replace(config.finish, joint=joint))


def _with_walls_in_pieces(config: Config) -> Config:
    joint = replace(config.finish.joint, wall_reach=0.0)
    return replace(config, finish=replace(config.finish, joint=joint))


def _with_normals_across_steps(config: Config) -> Config:
    joint = replace(config.finish.joint, evenness=1e6)
    return replace(config, finish=replace(config.finish, joint=joint))


_SLAM = "iceg.slam"
_FRONT_END = f"{_SLAM}.tracking.front_end:FrontEnd"
_CHECK = f"{_SLAM}.tracking.odometry_check:OdometryCheck"
_BACK_END = f"{_SLAM}.back_end:BackEnd"
_VOTES = f"{_SLAM}.broken_path.place_votes:PlaceVotes"
_RELOCALISATION: dict[str, Any] = {f"{_SLAM}.back_end:relocalise": lambda _closer, *found: found}

RULES: Mapping[str, Rule] = MappingProxyType(
    {
        "relocalisation": Rule(what="joins parts of a broken path by their maps", without=_RELOCALISATION),
        "relocalisation without a loss": Rule(
            what="the same where something always matched: against drift, and matches that lead astray",
            without={f"{_SLAM}.back_end:relocalise": _only_after_a_loss},
        ),
        "unspanned path": Rule(
            what="the same where nothing spans the path and its maps contradict each other",
            without={f"{_SLAM}.broken_path.relocalisation:_Relocalisation._unspanned": lambda _self: []},
        ),
        "seen from afar": Rule(
            what="scans of what is laid onto other parts are matched against the nearest pass where none is near",
            without={f"{_SLAM}.closures.candidates:EarlierPasses.before": _only_near},
        ),
        "view": Rule(
            what="only who sees something else at once may have been carried",
            without={
                f"{_SLAM}.back_end:judged_by_view": lambda failures, *_: {
                    key: replace(failure, log_odds_carried=inf) for key, failure in failures.items()
                }
            },
        ),
        "place votes": Rule(
            what="no closure after much drift while key scans fit another place as well",
            without={
                f"{_VOTES}.add": _nothing,
                f"{_VOTES}.of": lambda _self, attempt, _poses: Vote(
                    first=attempt.key_new, last=attempt.key_new, count=1
                ),
            },
        ),
        "plausible": Rule(
            what="a match far from odometry must explain what odometry does not",
            without={f"{_CHECK}._is_plausible": _yes},
        ),
        "among people": Rule(
            what="where people may stand, beams that end before walls tell nothing alone", config=_among_nobody
        ),
        "goes on": Rule(what="tells a jump of the odometry from a move", without={f"{_FRONT_END}._goes_on": _no}),
        "few beams": Rule(what="few beams do not overrule odometry", without={f"{_CHECK}._sees_too_little": _nothing}),
        "within reach": Rule(
            what="nobody jumps farther than the robot moves in that time, unless it is carried",
            without={f"{_SLAM}.tracking.reach:Reach.log_probability": _zero},
        ),
        "near odometry": Rule(
            what="a match near odometry is preferred to one that contradicts it",
            without={f"{_CHECK}._nearer": _nothing},
        ),
        "believed": Rule(
            what="odometry counts less where a match contradicts it beyond chance, and the step is suspect",
            without={f"{_BACK_END}._believed": lambda _self, motion, *_: motion.covariance},
        ),
        "fused": Rule(
            what="odometry speaks where a match is weak",
            without={f"{_FRONT_END}._odometry_share": _nothing},
        ),
        "submap drift": Rule(
            what="a match is no surer than how what holds it lies to the key scan it is measured from",
            without={f"{_SLAM}.tracking.submap_drift:SubmapDrift.may_matter": _no},
        ),
        "covered": Rule(
            what="scans that see nothing are not matched", without={f"{_SLAM}.tracking.front_end:sees_nothing": _no}
        ),
        "held by chance": Rule(
            what="what next to no wall holds may be held by something else",
            config=_believing_little,
        ),
        "velocity filter": Rule(
            what="without odometry a robot goes on as all matches say together, not as the newest one",
            config=_running_away,
        ),
        "halves of scans": Rule(
            what="matches count less where halves of scans disagree",
            without={"iceg.finding:with_measured_covariance_scale": _first},
        ),
        "joint refinement": Rule(what="poses and walls refined together", config=_without_joint_refinement),
        "one surface": Rule(
            what="normals of the joint refinement come from one surface, not from both sides of a step",
            config=_with_normals_across_steps,
        ),
        "walls run on": Rule(
            what="what points tell of the poses they tell across the wall as it runs on from piece to piece",
            config=_with_walls_in_pieces,
        ),
        "calibration": Rule(
            what="of the odometry, from the log's own matches",
            config=lambda config: replace(config, front_end=replace(config.front_end, calibrate_odometry=False)),
        ),
        "delay": Rule(
            what="odometry several scans late is put in time",
            without={f"{_SLAM}.odometry.calibration:whole_delay": lambda *_: 0},
        ),
        "lasting noise": Rule(
            what="errors of odometry persist for a while",
            without={f"{_SLAM}.odometry.calibration:lasting_noise": _first},
        ),
        "doubtful matches": Rule(
            what="what matches err by where they claim to be less sure is not the odometry's noise",
            without={f"{_SLAM}.odometry.noise:_unsure": _no_variance},
        ),
        "worse than velocity": Rule(
            what="odometry that tells less than the velocity does is left out",
            config=_with_any_odometry,
        ),
        "mount": Rule(
            what="finds lasers that look backwards or are upside down",
            without={f"{_SLAM}.passes:track_as_mounted": lambda log, follow, *_: (log, *follow(log))},
        ),
        "foretold steps": Rule(
            what="where odometry is missing or dead, a log is tracked once more, by the velocities before and after",
            without={f"{_SLAM}.passes:foretold_steps": _nothing},
        ),
        "slower turns": Rule(
            what="a robot without odometry goes slower where it turns",
            without={f"{_SLAM}.odometry.velocity:usual_velocities": _mean_velocities},
        ),
        "uncertain usual velocity": Rule(
            what="without odometry all corridors are known no better than the mean of the velocities seen",
            without={f"{_SLAM}.odometry.velocity:VelocityModel.of_mean": lambda *_: 0.0},
        ),
        "between keys": Rule(
            what="scans between key scans are smoothed by odometry",
            without={"iceg.finding:smoothed_between_keys": _first},
        ),
        "held readings": Rule(
            what="interpolates odometry where it repeats a reading and makes up for it at once",
            without={"iceg.finding:with_odometry_between_readings": _first},
        ),
        "own body": Rule(
            what="returns of the robot itself, and of hands around its laser, are left out",
            without={"iceg.finding:without_own_body": _first},
        ),
        "companions": Rule(
            what="whoever goes along with the robot is left out", without={"iceg.finding:without_companions": _first}
        ),
        "frozen scans": Rule(
            what="scans that repeat bit by bit show nothing", without={"iceg.finding:without_frozen_scans": _first}
        ),
        "dead odometry": Rule(
            what="odometry that stands while scans change says nothing",
            without={f"{_SLAM}.tracking.log_tracking:dead_intervals": _empty},
        ),
        "sudden steps": Rule(
            what="steps no robot makes are checked",
            without={
                f"{_SLAM}.tracking.log_tracking:sudden_steps": lambda odometry, *_: np.zeros(
                    max(len(odometry) - 1, 0), dtype=np.bool_
                )
            },
        ),
        "reassigned": Rule(
            what="scans around a break go to the right side of it", without={"iceg.finding:reassigned": _first}
        ),
        "lost odometry": Rule(
            what="a step tells nothing across a sudden loss",
            without={f"{_SLAM}.finish:without_lost_steps": lambda factors, *_: list(factors)},
        ),
        "displacement": Rule(
            what="covariances allow for a robot that may have been carried, or found again at a wrong place",
            without={"iceg.pipeline:displacements": _empty},
        ),
        "believed walls": Rule(
            what="poses that went part of the way to the walls keep part of the graph's covariance",
            without={f"{_SLAM}.joint.refinement:believed_covariances": _first},
        ),
        "contradiction": Rule(
            what="variances grow as far as the way from the graph to the walls is longer than both claim",
            without={f"{_SLAM}.joint.refinement:variance_factor": lambda *_: 1.0},
        ),
        "off the path": Rule(
            what="closures farther off the path than its covariance explains with `path_probability` are refused",
            without={f"{_BACK_END}._judge": _second},
        ),
        "confirmations": Rule(
            what="closures far from the estimate wait for two more", config=_with_loops(confirmations=1)
        ),
        "neighbours": Rule(
            what="neighbours of a key scan must agree with its closure", config=_with_loops(support_offsets=(0,))
        ),
        "contradicted closures": Rule(
            what="closures the finished graph contradicts are dropped",
            without={f"{_SLAM}.finish:without_contradicted": lambda attempts, loops, *_: (attempts, loops)},
        ),
        "robust closures": Rule(
            what="dynamic covariance scaling in the finish",
            without={f"{_SLAM}.finish:closure_kernel": _nothing, "iceg.corrections.by_hand:closure_kernel": _nothing},
        ),
        "confirmed passes": Rule(
            what="passes over confirmed areas are searched more seldom",
            config=_with_loops(confirmed=ConfirmedAreaConfig(passes=1_000_000)),
        ),
    }
)
"""Every rule by its name."""


def unknown_rules(names: Iterable[str]) -> list[str]:
    """Those parts of names, each of `RULES` or several joined by " + ", that no rule has."""
    return [part for name in names for part in _parts(name) if part not in RULES]


@contextmanager
def switched_off(name: str) -> Iterator[Change]:
    """Runs within do without a rule, or without several.

    Args:
        name: of `RULES`, or several joined by " + ".

    Yields:
        What the settings must become, too.

    Raises:
        EvaluationError: there is no such rule, or what it names is not there any more.
    """
    unknown = unknown_rules([name])
    if unknown:
        raise EvaluationError(f"found no rule '{unknown[0]}', expected one of {', '.join(RULES)}")
    rules = [RULES[part] for part in _parts(name)]
    with ExitStack() as stack:
        for part, rule in zip(_parts(name), rules, strict=True):
            for path, off in rule.without.items():
                owner, attribute = _owner(part, path)
                stack.enter_context(patch.object(owner, attribute, off))
        yield lambda config: reduce(lambda so_far, rule: (rule.config or _first)(so_far), rules, config)


def _parts(name: str) -> list[str]:
    return [part.strip() for part in name.split("+")]


def _owner(rule: str, path: str) -> tuple[Any, str]:
    """The module or class that holds what a rule is switched off by, and its name there."""
    module, _, names = path.partition(":")
    *classes, attribute = names.split(".")
    try:
        owner: Any = import_module(module)
        for name in classes:
            owner = getattr(owner, name)
        getattr(owner, attribute)
    except (ImportError, AttributeError) as error:
        raise EvaluationError(
            f"rule '{rule}': found no {path}, expected what it switches off; a rule that is gone leaves the table"
        ) from error
    return owner, attribute
