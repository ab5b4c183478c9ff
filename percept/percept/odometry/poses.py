"""The vehicle's poses over a log, with the means to distrust them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.geodesy import LocalFrame
from percept.core.results import Verdict
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.odometry.health import Jump

__all__ = ["PoseSource", "VehiclePoses"]

PoseSource = Literal["gnss+imu", "gnss", "odometry", "pose", "tf"]
"""What poses were made from."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VehiclePoses:
    """Where the vehicle was, and how well that is known.

    Attributes:
        trajectory: `T_inertial_base`; its gaps hold those of the stream and the jumps.
        source: What the poses were made from.
        origin: Where the inertial frame lies on the earth (x east, y north, z up); None where
            that is not known.
        sd_position_m: (N,) float64 root of the expected squared error of the position over all
            three axes; NaN where the source does not tell.
        sd_heading_rad: (N,) float64 standard deviation of the heading; NaN where the source
            does not tell.
        gaps_ns: (G, 2) int64 stamps around each gap of the stream.
        jumps: Steps that contradict the motion around them.
        notes: What a user should know besides, as clauses.
        dropped: Readings that were not used, by reason.
        verdict: How far the poses can be trusted.
        why: Reasons for the verdict, as clauses.
    """

    trajectory: Trajectory
    source: PoseSource
    origin: LocalFrame | None
    sd_position_m: NDArray[np.float64]
    sd_heading_rad: NDArray[np.float64]
    gaps_ns: NDArray[np.int64]
    jumps: tuple[Jump, ...] = ()
    notes: tuple[str, ...] = ()
    dropped: Counter[str] = field(default_factory=Counter)
    verdict: Verdict = Verdict.GOOD
    why: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = (len(self.trajectory),)
        if self.sd_position_m.shape != shape or self.sd_heading_rad.shape != shape:
            raise GeometryError(f"standard deviations of {shape[0]} poses are {shape}")

    def at(self, stamp_ns: int) -> Transform | None:
        """Return `T_inertial_base` at a time; None outside the span, in a gap and in a jump."""
        return self.trajectory.at(stamp_ns)

    def poses_at(
        self, stamps_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return poses (M, 4, 4) at times (M,), and (M,) whether there is one."""
        return self.trajectory.poses_at(stamps_ns)

    def segments(self) -> NDArray[np.int64]:
        """Return (S, 2) first and last stamp of each span without gap or jump, rising."""
        stamps, breaks = self.trajectory.stamps_ns, self.trajectory.gaps_ns
        starts = np.append(stamps[:1], breaks[:, 1])
        return np.column_stack([starts, np.append(breaks[:, 0], stamps[-1:])])
