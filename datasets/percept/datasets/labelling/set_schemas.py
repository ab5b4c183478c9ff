"""The tables of a labelled set and its record: what the columns are."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
from pydantic import BaseModel, ConfigDict

__all__ = [
    "ABOUT",
    "BOXES_2D",
    "BOXES_3D",
    "FRAMES",
    "KEYFRAMES",
    "POSE",
    "TABLES",
    "DriveRecord",
    "SetRecord",
]

ABOUT = "dataset.json"
"""Name of the record."""

POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Parts of a pose, as ends of the names of columns."""

FRAMES = pa.schema(
    [
        ("frame", pa.int64()),
        ("keyframe", pa.int64()),
        ("log", pa.string()),
        ("drive", pa.string()),
        ("stamp_ns", pa.int64()),
        ("offset_ns", pa.int64()),
        ("camera", pa.string()),
        ("file", pa.string()),
        ("rectified_file", pa.string()),
        ("width_px", pa.int64()),
        ("height_px", pa.int64()),
        ("split", pa.string()),
        ("latitude", pa.float64()),
        ("longitude", pa.float64()),
        *((f"base_{name}", pa.float64()) for name in POSE),
    ]
)
"""Columns of `frames.parquet`: a row for each image, in the order of drives and times.

`log` is the log as it was named, `drive` its name in files. `offset_ns` is the image's time minus
the keyframe's. `base_x` to `base_qw` are `T_base_then_base`, from the base frame at the keyframe's
time into that at the image's; null where the motion is not known. Latitude and longitude are null
where they are not known.
"""

KEYFRAMES = pa.schema(
    [
        ("keyframe", pa.int64()),
        ("drive", pa.string()),
        ("stamp_ns", pa.int64()),
        ("split", pa.string()),
        ("latitude", pa.float64()),
        ("longitude", pa.float64()),
        ("reason", pa.string()),
        ("score", pa.float64()),
        ("frame_id", pa.string()),
        *((f"base_{name}", pa.float64()) for name in POSE),
        ("scan_file", pa.string()),
        ("scan_stamp_ns", pa.int64()),
        ("scan_points", pa.int64()),
        ("scan_offsets_ns", pa.string()),
    ]
)
"""Columns of `keyframes.parquet`: a row for each moment.

`base_x` to `base_qw` are `T_frame_base`, where the vehicle was in the frame `frame_id`, which does
not move. `scan_offsets_ns` is JSON: for each LiDAR its scan's time minus the keyframe's.
"""

BOXES_2D = pa.schema(
    [
        ("box", pa.int64()),
        ("frame", pa.int64()),
        *((name, pa.float64()) for name in ("x1_px", "y1_px", "x2_px", "y2_px")),
        ("label", pa.string()),
        ("confidence", pa.float64()),
        ("source", pa.string()),
        ("track_id", pa.int64()),
        ("box_3d", pa.int64()),
        ("truncated", pa.float64()),
        ("occluded", pa.float64()),
    ]
)
"""Columns of `boxes_2d.parquet`: pixels of the recorded image, a row for each box.

`confidence` is null, and `source` empty, where a person drew the box. `track_id` and `box_3d` are
null where there is none; `truncated` and `occluded` where the shares are not known.
"""

BOXES_3D = pa.schema(
    [
        ("box", pa.int64()),
        ("keyframe", pa.int64()),
        *((name, pa.float64()) for name in ("x", "y", "z", "length", "width", "height", "yaw_rad")),
        ("label", pa.string()),
        ("confidence", pa.float64()),
        ("source", pa.string()),
        ("track_id", pa.int64()),
        ("vx", pa.float64()),
        ("vy", pa.float64()),
        ("points", pa.int64()),
    ]
)
"""Columns of `boxes_3d.parquet`: metres and rad in the drive's base frame at that time."""


TABLES = {
    "frames": FRAMES,
    "keyframes": KEYFRAMES,
    "boxes_2d": BOXES_2D,
    "boxes_3d": BOXES_3D,
}
"""The tables of a set: the schema of `<name>.parquet`."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class DriveRecord(_Strict):
    """What `dataset.json` says of a drive; `rig` is the content of a rig file."""

    log: str
    fingerprint: str
    start_ns: int
    rig: dict[str, Any]
    lidars: tuple[str, ...]
    models: dict[str, str]


class SetRecord(_Strict):
    """The content of `dataset.json`."""

    name: str
    categories: tuple[str, ...]
    licence: str
    anonymised: tuple[str, ...]
    created: str
    drives: dict[str, DriveRecord]
