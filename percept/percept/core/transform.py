"""Rigid transforms that know their frames, and the one place where quaternions are converted.

`T_target_source` maps points from the source frame to the target frame,
``points_target = T_target_source.apply(points_source)``, and reads right to left:
``T_a_b @ T_b_c`` is ``T_a_c``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from percept.core.errors import GeometryError

__all__ = [
    "Transform",
    "matrix_from_quat_xyzw",
    "quat_xyzw_from_matrix",
    "rotation_from_rpy",
    "rpy_from_rotation",
]

_ORTHONORMAL_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """A rigid transform between two named frames.

    Attributes:
        target: Name of the frame that points are mapped into.
        source: Name of the frame that points are mapped from.
        matrix: (4, 4) float64, read-only; rotation and translation in metres.

    Raises:
        GeometryError: If the matrix is not a finite rigid transform.
    """

    target: str
    source: str
    matrix: NDArray[np.float64]

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, dtype=np.float64)
        where = f"T_{self.target}_{self.source}"
        if matrix.shape != (4, 4):
            raise GeometryError(f"a transform is (4, 4), not {matrix.shape}", where=where)
        rotation = matrix[:3, :3]
        error = np.abs(rotation @ rotation.T - np.eye(3)).max()
        rigid = error < _ORTHONORMAL_TOLERANCE and np.linalg.det(rotation) > 0
        if not (np.isfinite(matrix).all() and rigid and np.array_equal(matrix[3], [0, 0, 0, 1])):
            raise GeometryError("the matrix is not a rigid transform", where=where)
        matrix.setflags(write=False)
        object.__setattr__(self, "matrix", matrix)

    @classmethod
    def identity(cls, target: str, source: str) -> Transform:
        """Return the transform between two frames that coincide."""
        return cls(target, source, np.eye(4))

    @classmethod
    def from_quat_xyzw(
        cls, target: str, source: str, translation_m: ArrayLike, quat_xyzw: ArrayLike
    ) -> Transform:
        """Build a transform from a translation (3,) in metres and a quaternion (4,) x y z w.

        Raises:
            GeometryError: If the quaternion has no length or a value is not finite.
        """
        matrix = np.eye(4)
        matrix[:3, :3] = matrix_from_quat_xyzw(quat_xyzw)
        matrix[:3, 3] = translation_m
        return cls(target, source, matrix)

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) float64 rotation from source to target."""
        return self.matrix[:3, :3]

    @property
    def translation_m(self) -> NDArray[np.float64]:
        """(3,) float64 origin of the source frame, in the target frame, metres."""
        return self.matrix[:3, 3]

    def inverse(self) -> Transform:
        """Return `T_source_target`."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation.T
        matrix[:3, 3] = -self.rotation.T @ self.translation_m
        return Transform(self.source, self.target, matrix)

    def __matmul__(self, other: Transform) -> Transform:
        """Compose ``T_a_b @ T_b_c`` into `T_a_c`.

        Raises:
            GeometryError: If the inner frames differ.
        """
        if self.source != other.target:
            raise GeometryError(
                f"T_{self.target}_{self.source} @ T_{other.target}_{other.source}: "
                f"frames '{self.source}' and '{other.target}' do not meet"
            )
        return Transform(self.target, other.source, self.matrix @ other.matrix)

    def apply(self, points_source: NDArray[np.floating]) -> NDArray[np.float64]:
        """Map points (N, 3) from the source frame into the target frame."""
        points = np.asarray(points_source, dtype=np.float64)
        mapped: NDArray[np.float64] = points @ self.rotation.T + self.translation_m
        return mapped


def matrix_from_quat_xyzw(quat_xyzw: ArrayLike) -> NDArray[np.float64]:
    """Return the (3, 3) rotation of a quaternion (4,) x y z w, which is normalised first.

    Raises:
        GeometryError: If the quaternion is not finite or shorter than 1e-6.
    """
    quat = np.asarray(quat_xyzw, dtype=np.float64)
    if quat.shape != (4,):
        raise GeometryError(f"a quaternion has 4 numbers x y z w, not {quat.shape}")
    length = float(np.linalg.norm(quat))
    if not np.isfinite(length) or length < 1e-6:
        raise GeometryError(f"quaternion {quat.tolist()} is no rotation")
    x, y, z, w = quat / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quat_xyzw_from_matrix(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternion (4,) x y z w with w >= 0 of a (3, 3) rotation.

    The largest of the four components is taken from the diagonal and the others from it
    (Shepperd 1978), which is exact to rounding for every rotation.
    """
    r = np.asarray(rotation, dtype=np.float64)
    squares = np.array(
        [
            1 + r[0, 0] - r[1, 1] - r[2, 2],
            1 - r[0, 0] + r[1, 1] - r[2, 2],
            1 - r[0, 0] - r[1, 1] + r[2, 2],
            1 + r[0, 0] + r[1, 1] + r[2, 2],
        ]
    )
    rows = np.array(
        [
            [squares[0], r[1, 0] + r[0, 1], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
            [r[1, 0] + r[0, 1], squares[1], r[2, 1] + r[1, 2], r[0, 2] - r[2, 0]],
            [r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], squares[2], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], squares[3]],
        ]
    )
    quat: NDArray[np.float64] = rows[int(np.argmax(squares))]
    quat /= np.linalg.norm(quat)
    return quat if quat[3] >= 0 else -quat


def rotation_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> NDArray[np.float64]:
    """Return the (3, 3) rotation of fixed-axis roll, pitch, yaw: Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = np.cos(roll_rad), np.sin(roll_rad)
    cp, sp = np.cos(pitch_rad), np.sin(pitch_rad)
    cy, sy = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_from_rotation(rotation: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return roll, pitch and yaw in rad of a (3, 3) rotation Rz(yaw) Ry(pitch) Rx(roll).

    Pitch is in -pi/2..pi/2. At its ends only the sum or difference of roll and yaw is determined;
    whatever yaw comes out there, roll fits to it, so that `rotation_from_rpy` gives the rotation
    back.
    """
    r = np.asarray(rotation, dtype=np.float64)
    yaw = np.arctan2(r[1, 0], r[0, 0])
    cy, sy = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-r[2, 0], cy * r[0, 0] + sy * r[1, 0])
    roll = np.arctan2(sy * r[0, 2] - cy * r[1, 2], cy * r[1, 1] - sy * r[0, 1])
    return float(roll), float(pitch), float(yaw)
