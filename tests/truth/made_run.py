"""A run folder as `percept detect` leaves it, small and made up: two networks, tracks, poses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from made_tracks import START_NS, STEP_NS, make_tracks

from percept.core.results import Detections2D, Detections3D
from percept.core.rig import CameraSensor, Rig, rig_as_yaml
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.detection.result import ImageResult
from percept.export.finished import FinishedFrame, finished_image
from percept.export.image_table import IMAGES_2D, image_rows
from percept.export.pose_table import POSES, pose_rows
from percept.export.scan_table import SCANS_3D, scan_rows
from percept.export.tables import (
    DETECTIONS_2D,
    DETECTIONS_3D,
    detections_2d_table,
    detections_3d_table,
    write_parquet,
)
from percept.export.track_table import TRACKS, track_rows

__all__ = ["CAMERA", "IMAGE_DELAY_NS", "make_run"]

IMAGE_DELAY_NS = 20_000_000
"""Images are taken so long after scans."""

_FORWARD = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1.5], [0, 0, 0, 1.0]])
CAMERA = CameraSensor(
    "front", "/front", "front", (400, 200), "pinhole", (200, 200, 199.5, 99.5), (0.0,),
    Transform("base", "front", _FORWARD),
)  # fmt: skip


def make_run(folder: Path, *, steps: int = 12, tracks: bool = True, poses: bool = True) -> Path:
    """Write a run and return its folder.

    There is a scan each 0.1 s, an image 20 ms after each, and the vehicle drives along x of `map`
    at 10 m/s. Network `a` sees a person and a traffic light of which the state was read, network
    `b`, whose classes have the same names in another order, the same person a bit better.
    """
    folder.mkdir()
    stamps = [START_NS + step * STEP_NS for step in range(steps)]
    images = [_image(number, stamp + IMAGE_DELAY_NS) for number, stamp in enumerate(stamps)]
    scans = [_scan(stamp) for stamp in stamps]
    write_parquet(folder / "detections_2d.parquet", DETECTIONS_2D, map(detections_2d_table, images))
    write_parquet(
        folder / "images_2d.parquet", IMAGES_2D, [image_rows(finished_image(i)) for i in images]
    )
    write_parquet(
        folder / "detections_3d.parquet",
        DETECTIONS_3D,
        (detections_3d_table(number, scan) for number, scan in enumerate(scans)),
    )
    write_parquet(
        folder / "scans_3d.parquet",
        SCANS_3D,
        [
            scan_rows(FinishedFrame(number, "lidars", "base", stamp, stamp), 1)
            for number, stamp in enumerate(stamps)
        ],
    )
    if tracks:
        moments = (make_tracks(step) for step in range(steps))
        write_parquet(folder / "tracks.parquet", TRACKS, map(track_rows, moments))
    if poses:
        write_parquet(folder / "poses.parquet", POSES, [pose_rows(_poses(stamps))])
    (folder / "rig.yaml").write_text(rig_as_yaml(Rig("base", {"front": CAMERA})))
    (folder / "run.json").write_text(json.dumps(_record()))
    return folder


def _record() -> dict[str, object]:
    names = {"a": ["person", "car", "traffic light"], "b": ["traffic light", "person", "car"]}
    return {
        "command": ["percept", "detect", "--bag", "logs/drive", "--out", "run"],
        "config": {
            "models": {
                name: {"path": f"nets/{name}.onnx", "class_names": some}
                for name, some in names.items()
            },
            "cameras": [{"name": "front", "image_size": [400, 200]}],
            "tracking": {"classes": {"car": {}, "pedestrian": {}, "unknown": {}}},
        },
        "inputs": [
            {"path": "logs/drive/drive_0.mcap", "bytes": 10, "sha256_head": "aa"},
            {"path": "logs/drive/drive_1.mcap", "bytes": 12, "sha256_head": "bb"},
            {"path": "nets/a.onnx", "bytes": 3, "sha256_head": "cc"},
            {"path": "nets/b.onnx", "bytes": 3, "sha256_head": "dd"},
            {"path": "map.osm", "bytes": 4, "sha256_head": "ee"},
        ],
    }


def _image(number: int, stamp_ns: int) -> ImageResult:
    person, light = [300.0, 80.0, 320.0, 140.0], [50.0, 10.0, 62.0, 40.0]
    first = Detections2D(
        stamp_ns, "front", np.array([light, person]), ("traffic light", "person"),
        np.array([0.8, 0.6]),
    )  # fmt: skip
    second = Detections2D(stamp_ns, "front", np.array([person]), ("person",), np.array([0.7]))
    return ImageResult(
        frame=number,
        camera="front",
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns,
        image=None,
        boxes={"a": first, "b": second},
        primary={"a": np.array([True, False]), "b": np.array([True])},
        light_states={"a": ("red", "")},
        timings_ms={"a": {}, "b": {}},
    )


def _scan(stamp_ns: int) -> Detections3D:
    box = np.array([[15.0, 3.0, 1.0, 4.0, 2.0, 1.5, 0.0]])
    return Detections3D(
        stamp_ns, "lidars", "base", box, ("car",), np.array([0.9]), points=np.array([40])
    )


def _poses(stamps: list[int]) -> Trajectory:
    times = np.array([*stamps, stamps[-1] + STEP_NS])
    matrices = np.tile(np.eye(4), (len(times), 1, 1))
    matrices[:, 0, 3] = (times - times[0]) * 1e-8
    return Trajectory("map", "base", times, matrices)
