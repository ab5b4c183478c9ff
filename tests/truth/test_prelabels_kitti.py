"""Pre-labels on real images: the 3D boxes of KITTI where its own 2D boxes are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections2D
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.datasets.labelling.labelled_set import SolidBoxes
from percept.datasets.labelling.prelabels.label_keyframe import ImageView, PreLabelConfig, link
from percept.datasets.labelling.prelabels.project_solids import project_solids

_SIZE = (1242, 375)


def _camera(projection: NDArray[np.float64]) -> CameraSensor:
    """The camera of a projection (3, 4), in a base frame x ahead, y left, z up."""
    matrix = np.eye(4)
    matrix[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
    matrix[:3, 3] = np.linalg.inv(projection[:, :3]) @ projection[:, 3]
    focal, centre = (projection[0, 0], projection[1, 1]), projection[:2, 2].tolist()
    placed = Transform("camera", "base", matrix).inverse()
    lens = (float(focal[0]), float(focal[1]), centre[0], centre[1])
    return CameraSensor("camera", None, "camera", _SIZE, "pinhole", lens, (0.0,), placed)


def test_cars_of_a_real_image_are_linked_one_to_one(shared_data: Path) -> None:
    content = json.loads((shared_data / "scenes/kitti_000008/000008.json").read_text())
    (scene,) = content["data_list"]
    cars = [one for one in scene["instances"] if one["bbox_label"] == 2]
    boxes_px = np.array([one["bbox"] for one in cars])
    boxes_m = [
        [z, -x, height / 2 - y, length, width, height, -turn - np.pi / 2]
        for x, y, z, length, height, width, turn in (one["bbox_3d"] for one in cars)
    ]
    camera = _camera(np.array(scene["images"]["CAM2"]["cam2img"])[:3])
    solids = SolidBoxes(
        ids=np.arange(1, 7),
        boxes_m=np.array(boxes_m),
        labels=("car",) * 6,
        confidences=np.ones(6),
        sources=("tracks",) * 6,
        track_ids=np.arange(6),
        velocities_mps=np.zeros((6, 2)),
        points=np.full(6, -1),
    )
    assert camera.T_base_sensor is not None
    shown = project_solids(solids.boxes_m, camera.T_base_sensor.inverse(), camera.camera())
    # Those labels are whole pixels in places, and drawn about what is seen.
    assert np.abs(shown.boxes_px - boxes_px).max() < 4
    assert np.median(np.abs(shown.boxes_px - boxes_px)) < 1
    assert (shown.truncated > 0.1).tolist() == [one["truncated"] > 0.1 for one in cars]
    found = Detections2D(0, "camera", boxes_px[::-1], ("Car",) * 6, np.ones(6))
    linked = link(
        ImageView(found={"labels": found}, image_size=_SIZE, camera=camera),
        solids,
        PreLabelConfig(),
    )
    assert linked.solids.tolist() == [6, 5, 4, 3, 2, 1]
