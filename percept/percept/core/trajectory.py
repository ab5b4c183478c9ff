"""Poses over time, interpolated on SE(3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.transform import Transform, matrix_from_quat_xyzw, quat_xyzw_from_matrix

__all__ = ["Trajectory"]


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses `T_target_source` of one moving frame.

    Attributes:
        target: The frame that poses are given in, such as `map` or `odom`.
        source: The frame that moves, such as `base_link`.
        stamps_ns: (N,) int64, strictly rising.
        matrices: (N, 4, 4) float64 rigid transforms, metres.

    Raises:
        GeometryError: If shapes do not match or stamps do not rise.
    """

    target: str
    source: str
    stamps_ns: NDArray[np.int64]
    matrices: NDArray[np.float64]

    def __post_init__(self) -> None:
        stamps = np.asarray(self.stamps_ns, dtype=np.int64)
        if stamps.ndim != 1 or self.matrices.shape != (len(stamps), 4, 4) or not len(stamps):
            raise GeometryError(
                f"a trajectory has (N,) stamps and (N, 4, 4) matrices, "
                f"not {stamps.shape} and {self.matrices.shape}"
            )
        if np.any(np.diff(stamps) <= 0):
            raise GeometryError("the stamps of a trajectory must rise")
        object.__setattr__(self, "stamps_ns", stamps)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def at(self, stamp_ns: int) -> Transform | None:
        """Return the pose at a time, or None outside the recorded span.

        Translation is interpolated linearly and rotation on the shortest arc (slerp).
        """
        if not self.stamps_ns[0] <= stamp_ns <= self.stamps_ns[-1]:
            return None
        right = int(np.searchsorted(self.stamps_ns, stamp_ns))
        if self.stamps_ns[right] == stamp_ns:
            return Transform(self.target, self.source, self.matrices[right])
        before, after = self.matrices[right - 1], self.matrices[right]
        span_ns = int(self.stamps_ns[right] - self.stamps_ns[right - 1])
        share = (stamp_ns - int(self.stamps_ns[right - 1])) / span_ns
        matrix = np.eye(4)
        matrix[:3, :3] = _slerp(before[:3, :3], after[:3, :3], share)
        matrix[:3, 3] = (1 - share) * before[:3, 3] + share * after[:3, 3]
        return Transform(self.target, self.source, matrix)


def _slerp(
    before: NDArray[np.float64], after: NDArray[np.float64], share: float
) -> NDArray[np.float64]:
    quat_a, quat_b = quat_xyzw_from_matrix(before), quat_xyzw_from_matrix(after)
    cosine = float(quat_a @ quat_b)
    if cosine < 0:
        quat_b, cosine = -quat_b, -cosine
    angle = float(np.arccos(min(cosine, 1.0)))
    if angle < 1e-9:
        return matrix_from_quat_xyzw((1 - share) * quat_a + share * quat_b)
    mixed = np.sin((1 - share) * angle) * quat_a + np.sin(share * angle) * quat_b
    return matrix_from_quat_xyzw(mixed / np.sin(angle))
