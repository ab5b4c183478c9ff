"""SUSTechPOINTS: a folder a scene, with the same stem for a moment's scan, images and labels.

Layout and conventions: github.com/naurril/SUSTechPOINTS, doc/data-format.md, scene_reader.py and
src/editor/js/calib.js. A box is its centre, its size along its own axes and its Euler angles in
the frame of the scan; `extrinsic` takes points of the scan into the camera, row by row.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.datasets.labelling.formats.camera_views import CameraView, camera_views
from percept.datasets.labelling.formats.format_readme import write_readme
from percept.datasets.labelling.formats.scenes import scenes_of
from percept.datasets.labelling.formats.solid_needs import check_solid_needs, rectified_file
from percept.datasets.labelling.labelled_set import ImageBoxes, Keyframe, LabelledSet, SolidBoxes
from percept.datasets.labelling.names import safe_name
from percept.datasets.labelling.placing import place_file

__all__ = ["export_sustech"]

_NAME = "sustech"
_OPENING = (
    "Scenes for SUSTechPOINTS: put the folders of `data/` into the `data/` of its checkout, or",
    "point its `data` there, start `python main.py` and choose a scene.",
    "",
    "- A scene is a stretch of a drive in one split; `scenes.json` says which. The stem of a frame",
    "  is the time of its keyframe in ns, as in `../keyframes.parquet`.",
    "- `lidar/` is all LiDARs in one cloud in the vehicle's base frame: `x y z intensity`.",
    "- `calib/camera/NAME.json` is where a camera sits; `calib/camera/NAME/STEM.json` has what the",
    "  vehicle drove between scan and image. Older versions of the tool read only the first.",
    "- `label/STEM.json` has the boxes in 3D: `obj_id` is the number of the track, empty without",
    "  one. `annotator` names the network that a box is from, which makes the tool treat it as",
    "  made by a machine. `label_fusion/` has the rectangles in the images.",
    "- `lidar_pose/` has where the vehicle was, where that is known.",
)


def export_sustech(labelled: LabelledSet, folder: Path) -> tuple[str, ...]:
    """Write a set as scenes of SUSTechPOINTS.

    Args:
        labelled: The set.
        folder: The folder to fill.

    Returns:
        What the format cannot hold, as sentences.

    Raises:
        InputError: If there is no scan, or a camera has no lens, place or rectified image.
    """
    check_solid_needs(labelled, _NAME)
    counts: Counter[str] = Counter()
    kept = [keyframe for keyframe in labelled.keyframes if keyframe.scan is not None]
    counts["keyframes without a scan are left out"] = len(labelled.keyframes) - len(kept)
    scenes = scenes_of(kept)
    for scene in scenes:
        for keyframe in scene.keyframes:
            _write_keyframe(labelled, keyframe, folder / "data" / scene.name, counts)
    _write(folder / "scenes.json", {scene.name: scene.split for scene in scenes})
    told = (
        "Confidences: `score` is in the files, but the tool drops it when it saves.",
        "Velocities, and the numbers of boxes.",
        "Truncation and occlusion.",
        *(f"{count} {what}." for what, count in counts.items() if count),
    )
    write_readme(folder, "SUSTechPOINTS", _OPENING, told)
    return told


def _write_keyframe(
    labelled: LabelledSet, keyframe: Keyframe, folder: Path, counts: Counter[str]
) -> None:
    if keyframe.scan is None:
        return
    stem = f"{keyframe.stamp_ns:019d}"
    place_file(labelled.folder / keyframe.scan.file, folder / "lidar" / f"{stem}.bin")
    _write(folder / "label" / f"{stem}.json", _solid_records(keyframe.solids))
    if keyframe.T_world_base is not None:
        pose = {"lidarPose": _numbers(keyframe.T_world_base.matrix)}
        _write(folder / "lidar_pose" / f"{stem}.json", pose)
    for view in camera_views(labelled, keyframe):
        camera = safe_name(view.frame.camera)
        source = labelled.folder / rectified_file(view.frame, _NAME)
        place_file(source, folder / "camera" / camera / f"{stem}{source.suffix}")
        _write_calibration(view, folder / "calib" / "camera" / camera, stem)
        rectangles = {
            "scene": folder.name,
            "frame": stem,
            "cameraType": "camera",
            "cameraName": camera,
            "objs": _rectangle_records(view.boxes),
        }
        _write(folder / "label_fusion" / "camera" / camera / f"{stem}.json", rectangles)
        counts["rectangles lie outside the images without distortion"] += view.left_out
        if not view.moved:
            counts["images are calibrated as if the vehicle stood between scan and image"] += 1


def _write_calibration(view: CameraView, folder: Path, stem: str) -> None:
    """Write where a camera sits, and beside it what is different for this image."""
    place = {
        "extrinsic": _numbers(view.T_base_camera.inverse().matrix),
        "intrinsic": _numbers(view.sensor.camera().K),
    }
    _write(folder.with_name(f"{folder.name}.json"), place)
    _write(folder / f"{stem}.json", {"lidar_transform": _numbers(view.T_then_base.matrix)})


def _solid_records(solids: SolidBoxes) -> list[dict[str, Any]]:
    return [
        {
            "psr": {
                "position": _xyz(box[:3]),
                "scale": _xyz(box[3:6]),
                "rotation": _xyz((0.0, 0.0, box[6])),
            },
            "obj_type": solids.labels[row],
            "obj_id": _track(solids.track_ids[row]),
            **_origin(solids.sources[row], solids.confidences[row]),
        }
        for row, box in enumerate(solids.boxes_m.tolist())
    ]


def _rectangle_records(boxes: ImageBoxes) -> list[dict[str, Any]]:
    return [
        {
            "rect": dict(zip(("x1", "y1", "x2", "y2"), box, strict=True)),
            "obj_type": boxes.labels[row],
            # Versions of the tool differ in what they call it.
            "obj_id": _track(boxes.track_ids[row]),
            "obj_track_id": _track(boxes.track_ids[row]),
            **_origin(boxes.sources[row], boxes.confidences[row]),
        }
        for row, box in enumerate(boxes.boxes_px.tolist())
    ]


def _origin(source: str, confidence: float) -> dict[str, Any]:
    """Return who made a box; nothing where a person did."""
    known = {"score": float(confidence)} if np.isfinite(confidence) else {}
    return known | ({"annotator": source} if source else {})


def _track(number: int) -> str:
    return str(number) if number >= 0 else ""


def _xyz(values: Sequence[float]) -> dict[str, float]:
    return dict(zip("xyz", values, strict=True))


def _numbers(matrix: NDArray[np.float64]) -> list[float]:
    values: list[float] = matrix.ravel().tolist()
    return values


def _write(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, ensure_ascii=False) + "\n", encoding="utf-8")
