"""SUSTechPOINTS: a reader that goes by its documentation finds boxes and images where they are.

No checker of it is on the package index, so the reader is written here, after the tool's
`scene_reader.py`, `tools/utils.py` and `src/editor/js/calib.js`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_labelled_set import make_labelled_set
from numpy.typing import NDArray

from percept.datasets.labelling.formats import export
from percept.datasets.labelling.formats.camera_views import camera_views
from percept.datasets.labelling.labelled_set import LabelledSet

_F64 = NDArray[np.float64]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    return make_labelled_set(tmp_path_factory.mktemp("sustech") / "set")


@pytest.fixture(scope="module")
def scenes(made: LabelledSet) -> Path:
    export(made, "sustech", made.folder / "sustech")
    return made.folder / "sustech" / "data"


def _json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _calibration(scene: Path, camera: str, frame: str) -> tuple[_F64, _F64]:
    """Return scan to camera and K, as the tool joins its two files."""
    fixed = _json(scene / "calib" / "camera" / f"{camera}.json")
    own = _json(scene / "calib" / "camera" / camera / f"{frame}.json")
    extrinsic = np.reshape(fixed["extrinsic"], (4, 4)) @ np.reshape(own["lidar_transform"], (4, 4))
    return extrinsic, np.reshape(fixed["intrinsic"], (3, 3))


def _euler(angles: dict[str, float]) -> _F64:
    """Return Rx Ry Rz, the order of three.js."""
    (cx, cy, cz), (sx, sy, sz) = (
        [f(angles[axis]) for axis in "xyz"] for f in (np.cos, np.sin)
    )  # fmt: skip
    x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(x @ y @ z)


def test_frames_of_all_folders_have_one_stem(made: LabelledSet, scenes: Path) -> None:
    assert sorted(path.name for path in scenes.iterdir()) == ["drive-000000-0", "drive-000001-0"]
    for scene in scenes.iterdir():
        stems = [f"{k.stamp_ns}" for k in made.keyframes if k.drive == scene.name[:-2]]
        for folder in ("lidar", "label", "lidar_pose", "camera/front", "camera/left",
                       "calib/camera/front", "label_fusion/camera/left"):  # fmt: skip
            assert sorted(path.stem for path in (scene / folder).iterdir()) == stems
    splits = _json(scenes.parent / "scenes.json")
    assert splits == {"drive-000000-0": "train", "drive-000001-0": "val"}


def test_boxes_are_where_they_were(made: LabelledSet, scenes: Path) -> None:
    for keyframe in made.keyframes:
        objects = _json(scenes / f"{keyframe.drive}-0" / "label" / f"{keyframe.stamp_ns}.json")
        for row, (one, box) in enumerate(zip(objects, keyframe.solids.boxes_m, strict=True)):
            psr = one["psr"]
            np.testing.assert_array_equal([psr["position"][a] for a in "xyz"], box[:3])
            np.testing.assert_array_equal([psr["scale"][a] for a in "xyz"], box[3:6])
            heading = _euler(psr["rotation"])[:, 0]
            np.testing.assert_allclose(heading, [np.cos(box[6]), np.sin(box[6]), 0], atol=1e-9)
            assert one["obj_type"] == keyframe.solids.labels[row]
        assert [one["obj_id"] for one in objects] == ["7", "", "8"]
        assert [one.get("annotator") for one in objects] == ["tracks", "lidar", None]
        assert [one.get("score") for one in objects] == [0.93, 0.51, None]


def test_points_project_into_images(made: LabelledSet, scenes: Path) -> None:
    keyframe = made.keyframes[1]
    scene, frame = scenes / f"{keyframe.drive}-0", str(keyframe.stamp_ns)
    points = np.fromfile(scene / "lidar" / f"{frame}.bin", "<f4").reshape(-1, 4)[:, :3]
    for view in camera_views(made, keyframe):
        extrinsic, K = _calibration(scene, view.frame.camera, frame)
        in_camera = points @ extrinsic[:3, :3].T + extrinsic[:3, 3]
        expected, seen = view.sensor.camera().project(view.T_camera_base.apply(points))
        assert seen.sum() > 20
        pixels = in_camera @ K.T
        np.testing.assert_allclose((pixels[:, :2] / pixels[:, 2:])[seen], expected[seen], atol=1e-4)


def test_rectangles_are_those_of_the_images_without_distortion(
    made: LabelledSet, scenes: Path
) -> None:
    keyframe = made.keyframes[0]
    folder = scenes / f"{keyframe.drive}-0" / "label_fusion" / "camera"
    for view in camera_views(made, keyframe):
        content = _json(folder / view.frame.camera / f"{keyframe.stamp_ns}.json")
        assert (content["scene"], content["frame"]) == (
            f"{keyframe.drive}-0",
            str(keyframe.stamp_ns),
        )
        assert (content["cameraType"], content["cameraName"]) == ("camera", view.frame.camera)
        boxes = [[one["rect"][key] for key in ("x1", "y1", "x2", "y2")] for one in content["objs"]]
        np.testing.assert_array_equal(boxes, view.boxes.boxes_px)
        assert [one["obj_type"] for one in content["objs"]] == list(view.boxes.labels)


def test_where_the_vehicle_was_is_kept(made: LabelledSet, scenes: Path) -> None:
    keyframe = made.keyframes[2]
    pose = _json(scenes / f"{keyframe.drive}-0" / "lidar_pose" / f"{keyframe.stamp_ns}.json")
    assert keyframe.T_world_base is not None
    np.testing.assert_array_equal(
        np.reshape(pose["lidarPose"], (4, 4)), keyframe.T_world_base.matrix
    )
