"""The steps that odometry does not know, as the matches and the velocity tell them after a first pass.

Where a scan faces a single wall, or two that are parallel, it is matched where it was guessed to be. From scan to scan
the guess is the step before once more, so that its errors add up along a corridor, until the end of a wall is taken for
another one. The second pass guesses from the velocities before and after.
"""

from graph import dense
from graph.arrays import Floats
from graph.measurement import NoMatch
from graph.odometry import OdometryMotion
from graph.se2 import between, compose, expmap, logmap
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.odometry.heading_odometry import HeadingOdometry, with_headings
from iceg.slam.odometry.velocity import motions_without_odometry, pauses_along
from iceg.slam.track import KeyScan, Track


def foretold_steps(
    track: Track, stamps: Floats, config: CalibrationConfig, heading: HeadingOdometry | None = None
) -> Floats | None:
    """What a first pass tells of every step from scan to scan.

    What a key scan's match and the velocity tell of the way to it are put together by their covariances; by how much
    that differs from the way that was tracked, it is spread evenly over the time between.

    Args:
        track: what the front end found in a log without odometry, or in one whose odometry is dead somewhere.
        stamps: (n_scans,) of the scans [s]; they tell where scans are missing.
        config: when the matches tell enough of the velocity.
        heading: what is known of the turns; None for nothing.

    Returns:
        (n_scans - 1, 3) steps in the frame of the scan before each; None where all were tracked as well as can be.
    """
    unknown = track.keys_left_to_velocity()
    unseen = [k for k, key in enumerate(track.keys) if k and k in unknown and not key.is_fully_observed]
    if heading is None:
        if not unseen:
            return None
        poses = track.T_track_scans
    else:
        poses = with_headings(track, heading.headings)
    twists = logmap(between(poses[:-1], poses[1:]))
    motions = motions_without_odometry(track, stamps, config, heading)
    pauses = pauses_along(stamps, poses)
    for index in unseen:
        before, key, motion = track.keys[index - 1], track.keys[index], motions[index - 1]
        if motion is not None:
            way = between(poses[before.index], poses[key.index])
            change = logmap(_with_velocity(way, key, motion)) - logmap(way)
            between_keys = slice(before.index, key.index)
            shares = pauses[between_keys] / pauses[between_keys].sum()
            twists[between_keys] += shares[:, None] * change
    return expmap(twists)


def _with_velocity(way: Floats, key: KeyScan, motion: OdometryMotion) -> Floats:
    """(3,) the way to a key scan by its match and the velocity together; by the velocity alone if nothing matched."""
    if isinstance(key.match, NoMatch):
        return motion.T_key_robot
    by_match, offset = key.match.informed_covariance, logmap(between(way, motion.T_key_robot))
    return compose(way, expmap(dense.matvec(by_match, dense.solve_vector(by_match + motion.covariance, offset))))
