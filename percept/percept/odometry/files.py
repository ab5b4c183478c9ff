"""Trajectories as text files: those of the TUM benchmark and of the KITTI odometry benchmark.

TUM (Sturm et al. 2012): one line a pose, ``stamp x y z qx qy qz qw``, the stamp in seconds.
KITTI (Geiger et al. 2012): one line a pose, the upper three rows of its matrix, without a stamp.
Numbers are written with all their digits, and stamps to the nanosecond, so that a file that is
read back is what was written.
"""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.core.clock import NS_PER_S
from percept.core.errors import GeometryError, InputError
from percept.core.trajectory import Trajectory

__all__ = ["read_kitti_poses", "read_tum", "write_kitti_poses", "write_tum"]

_TUM_NUMBERS, _KITTI_NUMBERS = 8, 12
_LARGEST_BYTES = 1 << 30
_LONGEST_LINE = 2000
_LAST_STAMP_S = Decimal(2**63 - 1) / NS_PER_S
_QUATERNION_OFF = 1e-2
_ROTATION_OFF = 1e-3


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory as a TUM file; quaternions have w >= 0."""
    quats = Rotation.from_matrix(trajectory.matrices[:, :3, :3]).as_quat(canonical=True)
    rows = np.hstack([trajectory.matrices[:, :3, 3], quats]).tolist()
    with path.open("w", encoding="ascii") as file:
        file.write("# stamp_s x_m y_m z_m qx qy qz qw\n")
        for stamp_ns, row in zip(trajectory.stamps_ns.tolist(), rows, strict=True):
            file.write(f"{_seconds(stamp_ns)} {' '.join(map(repr, row))}\n")


def write_kitti_poses(path: Path, trajectory: Trajectory) -> None:
    """Write the poses of a trajectory as a KITTI file; stamps and gaps are lost."""
    rows = trajectory.matrices[:, :3, :].reshape(-1, _KITTI_NUMBERS).tolist()
    with path.open("w", encoding="ascii") as file:
        file.writelines(f"{' '.join(map(repr, row))}\n" for row in rows)


def read_tum(path: Path, *, target: str = "map", source: str = "base_link") -> Trajectory:
    """Return the trajectory of a TUM file.

    Args:
        path: The file; lines that begin with `#` and empty ones are passed over, and commas
            may stand between the numbers.
        target: Name of the frame that its poses are given in, which the file does not have.
        source: Name of the frame that moves.

    Raises:
        InputError: If it is no such file; names the line.
    """
    stamps_ns, rows = [], []
    for where, words in _lines(path, _TUM_NUMBERS):
        stamps_ns.append(_stamp_ns(words[0], where))
        rows.append(_numbers(words[1:], where))
        length = float(np.linalg.norm(rows[-1][3:]))
        if abs(length - 1) > _QUATERNION_OFF:
            raise InputError(f"the quaternion has length {length:.3g} and not 1", where=where)
    if not rows:
        raise InputError("holds no pose", where=path)
    values = np.array(rows)
    matrices = np.tile(np.eye(4), (len(rows), 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(values[:, 3:]).as_matrix()
    matrices[:, :3, 3] = values[:, :3]
    try:
        return Trajectory(target, source, np.array(stamps_ns, dtype=np.int64), matrices)
    except GeometryError as error:
        raise InputError(error.what, where=path) from error


def read_kitti_poses(path: Path) -> NDArray[np.float64]:
    """Return the poses (N, 4, 4) of a KITTI file; rounded rotations are made exact.

    Raises:
        InputError: If it is no such file; names the line.
    """
    matrices = []
    for where, words in _lines(path, _KITTI_NUMBERS):
        matrix = np.vstack([np.reshape(_numbers(words, where), (3, 4)), [0.0, 0.0, 0.0, 1.0]])
        matrix[:3, :3] = _nearest_rotation(matrix[:3, :3], where)
        matrices.append(matrix)
    if not matrices:
        raise InputError("holds no pose", where=path)
    return np.stack(matrices)


def _lines(path: Path, numbers: int) -> Iterator[tuple[str, list[str]]]:
    """Yield the place and the words of each line that holds a pose."""
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise InputError("too large for a trajectory file", where=path)
        with path.open(encoding="utf-8") as file:
            for number, line in enumerate(file, start=1):
                where = f"{path}:{number}"
                words = line[:_LONGEST_LINE].replace(",", " ").split()
                if not words or words[0].startswith("#"):
                    continue
                if len(words) != numbers:
                    raise InputError(f"{len(words)} numbers where {numbers} belong", where=where)
                yield where, words
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read ({error})", where=path) from error


def _numbers(words: list[str], where: str) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise InputError(f"not a number ({error})", where=where) from error
    if not np.isfinite(values).all():
        raise InputError("a number that is not finite", where=where)
    return values


def _stamp_ns(word: str, where: str) -> int:
    """Return a stamp in seconds as nanoseconds, exactly: a float would lose the last digits."""
    try:
        seconds = Decimal(word)
    except InvalidOperation as error:
        raise InputError(f"'{word[:40]}' is no stamp", where=where) from error
    if not seconds.is_finite() or abs(seconds) > _LAST_STAMP_S:
        raise InputError(f"'{word[:40]}' is no stamp in seconds", where=where)
    return int((seconds * NS_PER_S).to_integral_value())


def _seconds(stamp_ns: int) -> str:
    sign, size = ("-", -stamp_ns) if stamp_ns < 0 else ("", stamp_ns)
    return f"{sign}{size // NS_PER_S}.{size % NS_PER_S:09d}"


def _nearest_rotation(matrix: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    left, _, right = np.linalg.svd(matrix)
    rotation: NDArray[np.float64] = left @ right
    if np.abs(rotation - matrix).max() > _ROTATION_OFF or np.linalg.det(rotation) < 0:
        raise InputError("the matrix is no rotation", where=where)
    return rotation
