"""Poses over time, interpolated on SE(3)."""

from __future__ import annotations

from dataclasses import dataclass, field

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
        gaps_ns: (G, 2) int64 first and last stamp of each gap, rising: two stamps of the
            trajectory between which nothing is known, so that nothing is interpolated.

    Raises:
        GeometryError: If shapes do not match or stamps do not rise.
    """

    target: str
    source: str
    stamps_ns: NDArray[np.int64]
    matrices: NDArray[np.float64]
    gaps_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))

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
        gaps = np.asarray(self.gaps_ns, dtype=np.int64)
        if gaps.ndim != 2 or gaps.shape[1] != 2 or np.any(np.diff(gaps.ravel()) < 0):
            raise GeometryError(f"the gaps of a trajectory are (G, 2) and rise, not {gaps.shape}")
        object.__setattr__(self, "gaps_ns", gaps)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def length_m(self) -> float:
        """Length of the way, metres; steps over gaps are in it as straight lines."""
        return float(np.linalg.norm(np.diff(self.matrices[:, :3, 3], axis=0), axis=1).sum())

    def at(self, stamp_ns: int) -> Transform | None:
        """Return the pose at a time, or None outside the recorded span and inside a gap.

        Translation is interpolated linearly and rotation on the shortest arc (slerp).
        """
        if not self.covers(np.array([stamp_ns], dtype=np.int64))[0]:
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

    def poses_at(
        self, stamps_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return poses (M, 4, 4) at times (M,), and (M,) whether there is one.

        Where there is none, outside the span and inside gaps, the matrix is the identity.
        """
        from scipy.spatial.transform import Rotation, Slerp

        valid = self.covers(stamps_ns)
        matrices = np.broadcast_to(np.eye(4), (len(valid), 4, 4)).copy()
        if len(self) == 1:
            matrices[valid] = self.matrices[0]
            return matrices, valid
        times = (np.asarray(stamps_ns, dtype=np.int64)[valid] - self.stamps_ns[0]).astype(float)
        known = (self.stamps_ns - self.stamps_ns[0]).astype(float)
        turn = Slerp(known, Rotation.from_matrix(self.matrices[:, :3, :3]))
        matrices[valid, :3, :3] = turn(times).as_matrix()
        for axis in range(3):
            matrices[valid, axis, 3] = np.interp(times, known, self.matrices[:, axis, 3])
        return matrices, valid

    def covers(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return (M,) whether there is a pose at times (M,): in the span and in no gap."""
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        # The ends of a gap are poses; where two gaps meet, so is the stamp between them.
        begun = np.searchsorted(self.gaps_ns[:, 0], stamps, side="left")
        ended = np.searchsorted(self.gaps_ns[:, 1], stamps, side="right")
        inside = (stamps >= self.stamps_ns[0]) & (stamps <= self.stamps_ns[-1])
        covered: NDArray[np.bool_] = inside & (begun <= ended)
        return covered


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
