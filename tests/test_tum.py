"""Trajectories go out and come back to a nanometre."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iceg.tum import TrajectoryError, format_tum, read_tum

_POSE = st.tuples(
    st.floats(-1e4, 1e4),
    st.floats(-1e4, 1e4),
    st.one_of(st.floats(-np.pi, np.pi), st.sampled_from([np.pi, -np.pi, 0.0, 1e-9, np.pi - 1e-9])),
)


@given(st.lists(st.tuples(st.floats(0, 2e9), _POSE), min_size=1, max_size=20))
def test_reading_back_gives_the_same_poses(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, tuple[float, float, float]]]
) -> None:
    stamps = np.array([stamp for stamp, _ in rows])
    poses = np.array([pose for _, pose in rows])
    path = tmp_path_factory.mktemp("tum") / "trajectory.tum"
    path.write_text(format_tum(stamps, poses))
    trajectory = read_tum(path)
    np.testing.assert_allclose(trajectory.stamps, stamps, atol=6e-7, rtol=0)
    np.testing.assert_allclose(trajectory.poses[:, :2], poses[:, :2], atol=6e-10, rtol=0)
    turned = trajectory.poses[:, 2] - poses[:, 2]
    np.testing.assert_allclose(np.hypot(np.sin(turned), 1 - np.cos(turned)), 0, atol=1e-11)
    assert (trajectory.poses[:, 2] > -np.pi).all()


def test_lines_are_what_other_tools_expect() -> None:
    text = format_tum(np.array([976052857.33753]), np.array([[1.5, -2.0, np.pi / 2]]))
    assert text == "976052857.337530 1.500000000 -2.000000000 0 0 0 0.707106781187 0.707106781187\n"


def test_equal_poses_give_equal_bytes_whatever_the_sign_of_zero() -> None:
    stamps = np.zeros(1)
    assert format_tum(stamps, np.array([[0.0, 0.0, 0.0]])) == format_tum(stamps, np.array([[-0.0, -0.0, -0.0]]))


def test_file_order_is_kept_when_stamps_step_back(tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    path.write_text(format_tum(np.array([2.0, 1.0, 3.0]), np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])))
    np.testing.assert_array_equal(read_tum(path).poses[:, 0], [0, 1, 2])


def test_comments_roll_and_a_rounded_norm_are_taken_in(tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    path.write_text("# t x y z qx qy qz qw\n\n0 1 2 3 0.1 0 0.38 0.92\n")
    assert read_tum(path).poses[0, 2] == pytest.approx(np.arctan2(2 * 0.92 * 0.38, 0.92**2 + 0.1**2 - 0.38**2))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no pose"),
        ("0 1 2 3 0 0 0\n", r":1: found 7 numbers, expected 8"),
        ("0 1 2 3 0 0 0 1\n0 1 2 3 0 0 zero 1\n", r":2: .*'zero'.*expected"),
        ("0 nan 2 3 0 0 0 1\n", ":1: .*finite"),
        ("0 1 2 3 0 0 0 0\n", ":1: .*unit quaternion"),
    ],
)
def test_a_bad_file_is_named_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.tum"
    path.write_text(text)
    with pytest.raises(TrajectoryError, match=message):
        read_tum(path)


def test_a_missing_or_binary_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match="cannot be read"):
        read_tum(tmp_path / "none.tum")
    (tmp_path / "binary.tum").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(TrajectoryError, match="cannot be read"):
        read_tum(tmp_path / "binary.tum")


def test_what_cannot_be_written_is_refused() -> None:
    with pytest.raises(TrajectoryError, match=r"pose 1 .* not finite"):
        format_tum(np.zeros(2), np.array([[0.0, 0, 0], [np.nan, 0, 0]]))
    with pytest.raises(TrajectoryError, match="3 numbers per stamp"):
        format_tum(np.zeros(2), np.zeros((3, 3)))
