"""Trajectory files: what is written is read back, and what is broken is refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from percept.core.errors import InputError
from percept.core.trajectory import Trajectory
from percept.odometry.files import read_kitti_poses, read_tum, write_kitti_poses, write_tum

_STAMPS = [-1, 0, 999_999_999, 1_700_000_000_123_456_789, 9_000_000_000_000_000_001]


def _trajectory() -> Trajectory:
    rng = np.random.default_rng(3)
    matrices = np.tile(np.eye(4), (len(_STAMPS), 1, 1))
    matrices[:, :3, :3] = Rotation.random(len(_STAMPS), rng=rng).as_matrix()
    matrices[:, :3, 3] = rng.normal(0, 1e5, (len(_STAMPS), 3))
    return Trajectory("map", "base_link", np.array(_STAMPS), matrices)


def test_a_tum_file_keeps_every_nanosecond_and_every_digit(tmp_path: Path) -> None:
    written = _trajectory()
    write_tum(tmp_path / "a.tum", written)
    back = read_tum(tmp_path / "a.tum")
    assert back.stamps_ns.tolist() == _STAMPS
    assert np.array_equal(back.matrices[:, :3, 3], written.matrices[:, :3, 3])
    np.testing.assert_allclose(back.matrices, written.matrices, atol=1e-14)


def test_a_kitti_file_keeps_every_digit(tmp_path: Path) -> None:
    written = _trajectory()
    write_kitti_poses(tmp_path / "a.txt", written)
    rows = np.loadtxt(tmp_path / "a.txt")
    assert np.array_equal(rows, written.matrices[:, :3].reshape(-1, 12))
    np.testing.assert_allclose(read_kitti_poses(tmp_path / "a.txt"), written.matrices, atol=1e-14)


def test_stamps_of_other_writers_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    path.write_text("# a comment\n\n1.5e9,1,2,3,0,0,0,1\n 1500000000.25 1 2 3 0 0 0 -1.001\n")
    back = read_tum(path, target="world", source="cam")
    assert back.stamps_ns.tolist() == [1_500_000_000_000_000_000, 1_500_000_000_250_000_000]
    assert (back.target, back.source) == ("world", "cam")
    np.testing.assert_allclose(back.matrices[:, :3, :3], [np.eye(3)] * 2, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no pose"),
        ("1 2 3 0 0 0 1\n", "7 numbers where 8 belong"),
        ("1 1 2 3 0 0 0 0\n", "length 0"),
        ("1 1 2 3 0 0 0 2\n", "length 2"),
        ("1 1 2 x 0 0 0 1\n", "not a number"),
        ("1 1 2 nan 0 0 0 1\n", "not finite"),
        ("1 1 2 1e999 0 0 0 1\n", "not finite"),
        ("nan 1 2 3 0 0 0 1\n", "no stamp"),
        ("one 1 2 3 0 0 0 1\n", "no stamp"),
        ("1e30 1 2 3 0 0 0 1\n", "no stamp"),
        ("1e999999 1 2 3 0 0 0 1\n", "no stamp"),
        ("2 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1\n", "must rise"),
        ("\x00\x01\x02", "numbers where"),
    ],
)
def test_a_broken_tum_file_is_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "a.tum"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_tum(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no pose"),
        ("1 0 0 0 0 1 0 0 0 0 1\n", "11 numbers where 12 belong"),
        ("2 0 0 0 0 1 0 0 0 0 1 0\n", "no rotation"),
        ("-1 0 0 0 0 1 0 0 0 0 1 0\n", "no rotation"),
        ("1 0 0 inf 0 1 0 0 0 0 1 0\n", "not finite"),
    ],
)
def test_a_broken_kitti_file_is_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "a.txt"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_kitti_poses(path)


def test_files_that_are_not_text_or_not_there_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.tum").write_bytes(b"\xff\xfe\xfa")
    for name in ("a.tum", "none.tum"):
        with pytest.raises(InputError, match="cannot be read"):
            read_tum(tmp_path / name)


def test_the_rounded_rotations_of_kitti_are_made_exact(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
    rows = np.column_stack([turn, [1.0, 2.0, 3.0]]).ravel()
    path.write_text(" ".join(f"{v:.6e}" for v in rows))
    (matrix,) = read_kitti_poses(path)
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(matrix[:3, :3], turn, atol=1e-5)
