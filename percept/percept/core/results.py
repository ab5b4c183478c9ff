"""Results of the stages, as structures of arrays, and the verdict that a run ends with."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.transform import Transform

__all__ = ["Detections2D", "Detections3D", "LightStates", "Tracks", "Verdict"]


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
        points: (N,) int64 number of points in each box's cluster; 0 where that is not known.
        offsets_ns: (N,) int64 when each box was measured, counted from `stamp_ns`: a LiDAR that
            turns sees the objects of a scan one after another. 0 where that is not known.

    Raises:
        GeometryError: If the columns do not have one length.
    """

    stamp_ns: int
    sensor: str
    frame_id: str
    boxes_m: NDArray[np.float64]
    labels: tuple[str, ...]
    confidences: NDArray[np.float64]
    mean_intensity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    points: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    offsets_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        if self.labels and not len(self.mean_intensity):
            object.__setattr__(self, "mean_intensity", np.full(len(self.labels), np.nan))
        for name in ("points", "offsets_ns"):
            if self.labels and not len(getattr(self, name)):
                object.__setattr__(self, name, np.zeros(len(self.labels), np.int64))
        _check_columns(
            self.boxes_m,
            7,
            self.labels,
            self.confidences,
            self.mean_intensity,
            self.points,
            self.offsets_ns,
        )

    def __len__(self) -> int:
        return len(self.boxes_m)

    def transformed(self, T_target_frame: Transform) -> Detections3D:
        """Return the boxes in another frame; they stay upright, whatever the tilt between both.

        Raises:
            GeometryError: If the transform does not start at the frame of the boxes.
        """
        if T_target_frame.source != self.frame_id:
            raise GeometryError(
                f"boxes in frame '{self.frame_id}' cannot go through "
                f"T_{T_target_frame.target}_{T_target_frame.source}"
            )
        turn = np.arctan2(T_target_frame.rotation[1, 0], T_target_frame.rotation[0, 0])
        boxes = self.boxes_m.copy()
        boxes[:, :3] = T_target_frame.apply(boxes[:, :3])
        boxes[:, 6] = np.arctan2(np.sin(boxes[:, 6] + turn), np.cos(boxes[:, 6] + turn))
        return replace(self, frame_id=T_target_frame.target, boxes_m=boxes)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Tracks:
    """The tracks of one moment.

    Attributes:
        stamp_ns: The moment.
        frame_id: Frame that boxes and velocities are given in: one that does not move.
        ids: (N,) int64, one for each object, never used twice in a drive.
        boxes_m: (N, 7) float64 as in `Detections3D`.
        velocities_mps: (N, 2) float64 over the ground along x and y of the frame.
        labels: N class names, each the most probable one.
        label_probabilities: (N,) float64 probability of that class.
        states: `full` for an object that is confirmed, `trial` for one that is not yet.
        position_sd_m: (N,) float64 standard deviation of the position in x and y, the larger one.
        velocity_sd_mps: (N,) float64 the same of the velocity.
        observed: (N,) bool whether a detection at this very moment is in it; otherwise the
            state is predicted, or interpolated with hindsight.
        scores: (N,) float64 mean confidence of the detections of each track, in the units of the
            detector; NaN where it is not known.

    Raises:
        GeometryError: If the columns do not have one length.
    """

    stamp_ns: int
    frame_id: str
    ids: NDArray[np.int64]
    boxes_m: NDArray[np.float64]
    velocities_mps: NDArray[np.float64]
    labels: tuple[str, ...]
    label_probabilities: NDArray[np.float64]
    states: tuple[str, ...]
    position_sd_m: NDArray[np.float64]
    velocity_sd_mps: NDArray[np.float64]
    observed: NDArray[np.bool_]
    scores: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if self.labels and not len(self.scores):
            object.__setattr__(self, "scores", np.full(len(self.labels), np.nan))
        _check_columns(
            self.boxes_m, 7, self.labels, self.ids, self.label_probabilities,
            np.empty(len(self.states)), self.position_sd_m, self.velocity_sd_mps, self.observed,
            self.scores,
        )  # fmt: skip
        if self.velocities_mps.shape != (len(self.labels), 2):
            raise GeometryError(f"velocities are (N, 2), not {self.velocities_mps.shape}")

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LightStates:
    """The traffic lights of one moment.

    Attributes:
        stamp_ns: The moment.
        ids: (N,) int64: the light's id in the map, or that of a track of boxes without a map.
        states: What each shows: `red`, `yellow`, `green`; `dark` for a housing that is seen and
            of which no lamp shines; `unknown` where it is not seen, or where the evidence does
            not decide. Of a flashing light the colour that flashes, also while it is dark.
        flashing: (N,) bool; with the state `unknown` until a lit lamp was seen.
        probabilities: (N,) float64 of that state and whether it flashes.
        cameras: For each light the cameras that saw it at or shortly before this moment.

    Raises:
        GeometryError: If the columns do not have one length.
    """

    stamp_ns: int
    ids: NDArray[np.int64]
    states: tuple[str, ...]
    flashing: NDArray[np.bool_]
    probabilities: NDArray[np.float64]
    cameras: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        lengths = {
            len(column)
            for column in (self.ids, self.states, self.flashing, self.probabilities, self.cameras)
        }
        if len(lengths) > 1:
            raise GeometryError(f"the columns of lights have one length, not {sorted(lengths)}")

    def __len__(self) -> int:
        return len(self.ids)


def _check_columns(
    boxes: NDArray[np.float64], width: int, labels: tuple[str, ...], *columns: NDArray[np.generic]
) -> None:
    count = len(labels)
    if boxes.shape != (count, width) or any(column.shape != (count,) for column in columns):
        raise GeometryError(
            f"detections need ({count}, {width}) boxes and ({count},) columns, got "
            f"{[boxes.shape, *(column.shape for column in columns)]}"
        )
