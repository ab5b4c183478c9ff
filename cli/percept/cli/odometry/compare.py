"""How far poses are from those of a reference or of another source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from percept.cli.odometry.found import FoundPoses
from percept.core.errors import GeometryError, InsufficientDataError
from percept.core.trajectory import Trajectory
from percept.export.odometry_report import DriftRow
from percept.odometry.drift import Drift, measure_drift

__all__ = ["Compared", "compare", "drift_row"]


@dataclass(frozen=True, slots=True)
class Compared:
    """The drift from one other trajectory.

    Attributes:
        against: A file or a source.
        drift: How far the poses are from it.
    """

    against: str
    drift: Drift

    def as_json(self) -> dict[str, Any]:
        """Return the figures as plain values."""
        return {"against": self.against, **asdict(self.drift)}


def compare(
    found: FoundPoses, others: Mapping[str, Trajectory], *, own: bool = False
) -> list[Compared]:
    """Return the drift from each of several trajectories.

    Args:
        found: The poses in question.
        others: By name, what they are compared with.
        own: Whether the user asked for these: then one that cannot be compared is an error, and
            is left out else.

    Raises:
        PerceptError: If one that the user asked for shares no time or frame with the poses.
    """
    compared = []
    for name, other in others.items():
        try:
            compared.append(Compared(name, measure_drift(found.trajectory, other)))
        except (GeometryError, InsufficientDataError):
            if own:
                raise
    return compared


def drift_row(one: Compared) -> DriftRow:
    """Return the drift as a row of the report."""
    drift = one.drift
    stretches = {
        f"error over {s.length_m:g} m (%)": f"{s.translation_percent:.3f}" for s in drift.stretches
    }
    turning = drift.rotation_degpm
    return DriftRow(
        against=one.against,
        figures={
            "poses": str(drift.poses),
            "way (m)": f"{drift.way_m:.1f}",
            **stretches,
            **({} if turning is None else {"rotation (deg/m)": f"{turning:.5f}"}),
            "absolute (m)": f"{drift.ate_m:.3f}",
            "absolute (deg)": f"{drift.ate_deg:.3f}",
            "pose to pose (m)": f"{drift.rpe_m:.3f}",
            "at the end (m)": f"{drift.end_m:.3f}",
        },
    )
