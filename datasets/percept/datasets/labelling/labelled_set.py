"""A data set in preparation: drives, keyframes, images, scans and the boxes to begin from.

Exporters read this and nothing else. Files are named relative to the folder of the set.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.rig import CameraSensor
from percept.core.transform import Transform

__all__ = [
    "SPLITS",
    "Drive",
    "ImageBoxes",
    "KeyScan",
    "Keyframe",
    "LabelledFrame",
    "LabelledSet",
    "SolidBoxes",
    "Split",
]

Split = Literal["train", "val", "test"]
SPLITS: tuple[Split, ...] = get_args(Split)
"""The parts of a data set, in their order."""

NO_TRACK = -1
"""Id of a box that belongs to no track."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageBoxes:
    """The boxes of one image.

    Attributes:
        ids: (N,) int64 number of each box among the 2D boxes of the set, from 1.
        boxes_px: (N, 4) float64 x1, y1, x2, y2 in the recorded image, inside it.
        labels: N class names.
        confidences: (N,) float64 in 0..1; NaN where a person drew the box.
        sources: What each box is from: the name of the network; `lidar` for a 3D box that no
            network saw in the image, projected; empty where a person drew it.
        track_ids: (N,) int64 the object's number in its drive; -1 where it has none.
        solids: (N,) int64 the id of the 3D box of the same object (`SolidBoxes.ids`); 0 without.
        truncated: (N,) float64 share of the object outside the image, 0..1; NaN if not known.
        occluded: (N,) float64 share of the object hidden by others, 0..1; NaN if not known.

    Raises:
        GeometryError: If the columns do not have one length.
    """

    ids: NDArray[np.int64]
    boxes_px: NDArray[np.float64]
    labels: tuple[str, ...]
    confidences: NDArray[np.float64]
    sources: tuple[str, ...]
    track_ids: NDArray[np.int64]
    solids: NDArray[np.int64]
    truncated: NDArray[np.float64]
    occluded: NDArray[np.float64]

    def __post_init__(self) -> None:
        _check_columns(
            len(self.labels), self.ids, self.confidences, np.empty(len(self.sources)),
            self.track_ids, self.solids, self.truncated, self.occluded,
        )  # fmt: skip
        _check_boxes(self.boxes_px, (len(self.labels), 4))

    def __len__(self) -> int:
        return len(self.labels)

    @classmethod
    def none(cls) -> ImageBoxes:
        """Return no boxes."""
        numbers, ids = np.zeros(0), np.zeros(0, np.int64)
        return cls(
            ids=ids, boxes_px=np.zeros((0, 4)), labels=(), confidences=numbers, sources=(),
            track_ids=ids, solids=ids, truncated=numbers, occluded=numbers,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SolidBoxes:
    """The 3D boxes of one keyframe, where the objects are at its time.

    Attributes:
        ids: (N,) int64 number of each box among the 3D boxes of the set, from 1.
        boxes_m: (N, 7) float64 in the drive's base frame as in `Detections3D`: centre x, y, z,
            length, width, height in metres, and yaw in rad; length is along the yaw.
        labels: N class names.
        confidences: (N,) float64 in 0..1; NaN where a person drew the box.
        sources: What each box is from, such as `tracks` or `lidar`; empty for a person.
        track_ids: (N,) int64 the object's number in its drive; -1 where it has none.
        velocities_mps: (N, 2) float64 over the ground along x and y of the base frame; NaN if
            not known.
        points: (N,) int64 points of the scan inside the box; -1 where that is not known.

    Raises:
        GeometryError: If the columns do not have one length.
    """

    ids: NDArray[np.int64]
    boxes_m: NDArray[np.float64]
    labels: tuple[str, ...]
    confidences: NDArray[np.float64]
    sources: tuple[str, ...]
    track_ids: NDArray[np.int64]
    velocities_mps: NDArray[np.float64]
    points: NDArray[np.int64]

    def __post_init__(self) -> None:
        _check_columns(
            len(self.labels), self.ids, self.confidences, np.empty(len(self.sources)),
            self.track_ids, self.points,
        )  # fmt: skip
        _check_boxes(self.boxes_m, (len(self.labels), 7))
        _check_boxes(self.velocities_mps, (len(self.labels), 2))

    def __len__(self) -> int:
        return len(self.labels)

    @classmethod
    def none(cls) -> SolidBoxes:
        """Return no boxes."""
        ids = np.zeros(0, np.int64)
        return cls(
            ids=ids, boxes_m=np.zeros((0, 7)), labels=(), confidences=np.zeros(0), sources=(),
            track_ids=ids, velocities_mps=np.zeros((0, 2)), points=ids,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LabelledFrame:
    """One image of a keyframe.

    Attributes:
        frame: Number in the set, from 0.
        camera: Name of the camera.
        stamp_ns: When it was taken.
        offset_ns: That time minus the keyframe's.
        file: The image as it was recorded, blurred where that was asked for: `images/<stem>.jpg`.
        rectified_file: The same without distortion, for formats that know no lens model; the
            image itself where the lens has none; None where no such format was asked for or the
            lens is not known.
        image_size: (width, height) in pixels; the rectified image has the same.
        boxes: Its boxes.
        vehicle_place: `T_base_then_base`, from the base frame at the keyframe's time into that
            at the image's; None where the motion is not known.
    """

    frame: int
    camera: str
    stamp_ns: int
    offset_ns: int
    file: str
    rectified_file: str | None
    image_size: tuple[int, int]
    boxes: ImageBoxes
    vehicle_place: Transform | None = None

    @property
    def stem(self) -> str:
        """Name of the image without folder and suffix; no other image of the set has it."""
        return Path(self.file).stem


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KeyScan:
    """The LiDAR points of a keyframe: all LiDARs in one cloud.

    Attributes:
        stamp_ns: When it was measured.
        offset_ns: That time minus the keyframe's.
        file: `scans/<stem>.bin`: rows of float32 x, y, z, intensity in the base frame, metres.
        points: Number of rows.
        offsets_ns: For each LiDAR in it, its scan's time minus the keyframe's.
    """

    stamp_ns: int
    offset_ns: int
    file: str
    points: int
    offsets_ns: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Keyframe:
    """One moment of a drive that is to be labelled.

    Attributes:
        keyframe: Number in the set, from 0.
        drive: Name of its drive.
        stamp_ns: The moment: that of the scan where there is one, else of an image.
        split: The part that it is in.
        latitude: Degrees north; NaN where not known.
        longitude: Degrees east; NaN where not known.
        reason: Why it was chosen, such as `distance`.
        score: What active selection gave it; 0 without.
        T_world_base: Where the vehicle was, in a frame that does not move; None if not known.
        frames: Its images, one a camera at most.
        scan: Its points; None without.
        solids: Its 3D boxes.
    """

    keyframe: int
    drive: str
    stamp_ns: int
    split: Split
    latitude: float
    longitude: float
    reason: str
    score: float
    T_world_base: Transform | None
    frames: tuple[LabelledFrame, ...]
    scan: KeyScan | None
    solids: SolidBoxes


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Drive:
    """One log of the set.

    Attributes:
        name: Short, safe in file names, made of the log's name and its content: it stays when
            logs are added. Letters, digits, `-`, `_` and `.` only.
        log: The log as the user named it.
        fingerprint: Hexadecimal digest of its first part.
        start_ns: Time of its first message.
        base_frame: Frame of the vehicle that 3D boxes and scans are in.
        cameras: Its cameras of known lens, by name; where the place is not known it says so.
        lidars: Names of the LiDARs whose points are in the scans.
        models: Sources of its boxes with what is known of them, such as a file's digest.
    """

    name: str
    log: str
    fingerprint: str
    start_ns: int
    base_frame: str
    cameras: Mapping[str, CameraSensor]
    lidars: tuple[str, ...] = ()
    models: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LabelledSet:
    """All of a data set.

    Attributes:
        folder: Where its files are.
        name: What people call it.
        categories: Class names in their order, which numbers of classes follow. All labels are
            among them.
        drives: By name.
        keyframes: In the order of drives and times.
        licence: What the user gave; empty if nothing.
        anonymised: What was blurred, such as `faces`; empty if nothing.
        created: Date and time, ISO 8601.
    """

    folder: Path
    name: str
    categories: tuple[str, ...]
    drives: Mapping[str, Drive]
    keyframes: tuple[Keyframe, ...]
    licence: str = ""
    anonymised: tuple[str, ...] = ()
    created: str = ""

    def frames(self) -> Iterator[tuple[Keyframe, LabelledFrame]]:
        """Yield all images with their keyframes, in the order of their numbers."""
        for keyframe in self.keyframes:
            for frame in keyframe.frames:
                yield keyframe, frame

    def camera_of(self, keyframe: Keyframe, frame: LabelledFrame) -> CameraSensor | None:
        """Return the camera that took an image; None where its lens is not known."""
        return self.drives[keyframe.drive].cameras.get(frame.camera)


def _check_columns(count: int, *columns: NDArray[np.generic]) -> None:
    if any(column.shape != (count,) for column in columns):
        raise GeometryError(
            f"{count} boxes need columns of one length, not {[c.shape for c in columns]}"
        )


def _check_boxes(boxes: NDArray[np.float64], shape: tuple[int, int]) -> None:
    if boxes.shape != shape:
        raise GeometryError(f"boxes are {shape}, not {boxes.shape}")
