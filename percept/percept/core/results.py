"""Results of the stages, as structures of arrays, and the verdict that a run ends with."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError

__all__ = ["Detections2D", "Detections3D", "Verdict"]


class Verdict(StrEnum):
    """How far a result can be trusted."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    BAD = "bad"
    AMBIGUOUS = "ambiguous"

    @property
    def exit_code(self) -> int:
        """0 for good and doubtful, 4 for the rest."""
        return 0 if self in (Verdict.GOOD, Verdict.DOUBTFUL) else 4


@dataclass(frozen=True, slots=True, eq=False)
class Detections2D:
    """Boxes in one image.

    Attributes:
        stamp_ns: Time of the image.
        camera: Name of the camera.
        boxes_px: (N, 4) float64 x1, y1, x2, y2 in the recorded image.
        labels: N class names.
        confidences: (N,) float64 in 0..1.

    Raises:
        GeometryError: If the columns do not have one length.
    """

    stamp_ns: int
    camera: str
    boxes_px: NDArray[np.float64]
    labels: tuple[str, ...]
    confidences: NDArray[np.float64]

    def __post_init__(self) -> None:
        _check_columns(self.boxes_px, 4, self.labels, self.confidences)

    def __len__(self) -> int:
        return len(self.boxes_px)


@dataclass(frozen=True, slots=True, eq=False)
class Detections3D:
    """Boxes of one scan.

    Attributes:
        stamp_ns: Time of the scan.
        sensor: Name of the sensor, or of the group that was merged.
        frame_id: Frame that the boxes are given in.
        boxes_m: (N, 7) float64 centre x, y, z, length, width, height in metres, and yaw in rad
            about z, in (-pi, pi]; length is along the yaw.
        labels: N class names.
        confidences: (N,) float64 in 0..1.
        mean_intensity: (N,) float64 in the sensor's own units; NaN where it has none.
        points: (N,) int64 number of points in each box's cluster.

    Raises:
        GeometryError: If the columns do not have one length.
    """

    stamp_ns: int
    sensor: str
    frame_id: str
    boxes_m: NDArray[np.float64]
    labels: tuple[str, ...]
    confidences: NDArray[np.float64]
    mean_intensity: NDArray[np.float64]
    points: NDArray[np.int64]

    def __post_init__(self) -> None:
        _check_columns(
            self.boxes_m, 7, self.labels, self.confidences, self.mean_intensity, self.points
        )

    def __len__(self) -> int:
        return len(self.boxes_m)


def _check_columns(
    boxes: NDArray[np.float64], width: int, labels: tuple[str, ...], *columns: NDArray[np.generic]
) -> None:
    count = len(labels)
    if boxes.shape != (count, width) or any(column.shape != (count,) for column in columns):
        raise GeometryError(
            f"detections need ({count}, {width}) boxes and ({count},) columns, got "
            f"{[boxes.shape, *(column.shape for column in columns)]}"
        )
