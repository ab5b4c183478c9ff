"""Exports in 3D as independent programs read them: boxes are where they are in the set to 1 mm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from independent_readers import read_with
from made_labelled_set import make_labelled_set
from numpy.typing import NDArray

from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.labelling.formats import export
from percept.datasets.labelling.labelled_set import Keyframe, LabelledFrame, LabelledSet

_TOLERANCE_M = 1e-3
_TOLERANCE_PX = 0.01
_TOLERANCE_RAD = 1e-4
_F64 = NDArray[np.float64]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    return make_labelled_set(tmp_path_factory.mktemp("made") / "set", drives=3, keyframes=2)


@pytest.fixture(scope="module")
def nuscenes(made: LabelledSet) -> dict[int, Any]:
    """Samples by their time in microseconds, as the devkit reads them."""
    folder = made.folder / "nuscenes"
    export(made, "nuscenes", folder)
    return {sample["stamp_us"]: sample for sample in read_with("read_nuscenes.py", folder)}


@pytest.fixture(scope="module")
def openlabel(made: LabelledSet) -> dict[int, Any]:
    """Frames by the number of their keyframe, as VCD reads them."""
    folder = made.folder / "openlabel"
    export(_with_lenses(made), "openlabel", folder)
    documents = read_with("read_openlabel.py", *sorted(folder.glob("*/*.json")))
    return {frame["keyframe"]: frame for document in documents for frame in document["frames"]}


def test_datumaro_reads_the_same_solids_in_kitti(made: LabelledSet, tmp_path: Path) -> None:
    export(made, "kitti", tmp_path / "kitti")
    (items,) = read_with("read_datumaro.py", "kitti3d", tmp_path / "kitti" / "training")
    found = {item["name"]: {box["label"]: box for box in item["boxes"]} for item in items}
    compared = 0
    for keyframe, frame in made.frames():
        T_camera_base = _camera_place(made, keyframe, frame)
        rows = {int(number): row for row, number in enumerate(keyframe.solids.ids)}
        for row, label in enumerate(frame.boxes.labels):
            box = found[f"{frame.frame:06d}"]["_".join(label.split())]
            number = int(frame.boxes.solids[row])
            if number == 0:
                assert box["dimensions"] == [-1, -1, -1]
                continue
            _same_kitti_box(box, keyframe.solids.boxes_m[rows[number]], T_camera_base)
            compared += 1
    assert compared == 2 * sum(len(frame.boxes) > 0 for _, frame in made.frames())


def test_the_nuscenes_devkit_reads_the_same_solids(
    made: LabelledSet, nuscenes: dict[int, Any]
) -> None:
    instances: dict[tuple[str, int], set[str]] = {}
    assert set(nuscenes) == {keyframe.stamp_ns // 1000 for keyframe in made.keyframes}
    for keyframe in made.keyframes:
        sample, solids = nuscenes[keyframe.stamp_ns // 1000], keyframe.solids
        assert sample["log"] == made.drives[keyframe.drive].log
        for token, row in _rows(sample, keyframe).items():
            box = sample["boxes"][token]
            _same_nuscenes_box(box, keyframe, row, sample["global_offset_m"])
            track, number = int(solids.track_ids[row]), int(solids.ids[row])
            owner = (keyframe.drive, track) if track >= 0 else ("", number)
            instances.setdefault(owner, set()).add(box["instance"])
    assert all(len(tokens) == 1 for tokens in instances.values())
    assert len(set.union(*instances.values())) == len(instances)


def test_the_nuscenes_devkit_finds_solids_in_images_and_points(
    made: LabelledSet, nuscenes: dict[int, Any]
) -> None:
    seen = 0
    for keyframe in made.keyframes:
        sample, solids = nuscenes[keyframe.stamp_ns // 1000], keyframe.solids
        rows, lidar = _rows(sample, keyframe), sample["sensors"]["LIDAR_TOP"]
        assert keyframe.scan is not None
        scan = np.fromfile(made.folder / keyframe.scan.file, "<f4").reshape(-1, 4)
        np.testing.assert_allclose(lidar["points"], scan, atol=1e-6)
        assert lidar["boxes"].keys() == rows.keys()
        for token, box in lidar["boxes"].items():
            _close(box["centre"], solids.boxes_m[rows[token], :3])
        for frame in keyframe.frames:
            camera = sample["sensors"][f"CAM_{frame.camera.upper()}"]
            assert frame.rectified_file is not None
            assert Path(camera["file"]).samefile(made.folder / frame.rectified_file)
            at_camera = _camera_place(made, keyframe, frame).apply(solids.boxes_m[:, :3])
            for token, box in camera["boxes"].items():
                _close(box["centre"], at_camera[rows[token]])
                seen += 1
    assert seen >= len(made.keyframes)


def test_openlabel_obeys_its_schema_and_vcd_reads_the_same_boxes(
    made: LabelledSet, openlabel: dict[int, Any]
) -> None:
    assert sorted(openlabel) == [keyframe.keyframe for keyframe in made.keyframes]
    for keyframe in made.keyframes:
        found = openlabel[keyframe.keyframe]
        assert found["stamp_ns"] == str(keyframe.stamp_ns)
        rectangles: dict[int, Any] = {}
        solids: dict[int, Any] = {}
        for one in found["objects"]:
            for kind, boxes in (("bbox", rectangles), ("cuboid", solids)):
                boxes |= {box["box"]: box | {"label": one["label"]} for box in one[kind]}
        assert len(rectangles) == sum(len(frame.boxes) for frame in keyframe.frames)
        for frame in keyframe.frames:
            stream = found["streams"][frame.camera]
            assert stream["stamp_ns"] == str(frame.stamp_ns)
            file = made.folder / "openlabel" / keyframe.split / stream["uri"]
            assert file.samefile(made.folder / frame.file)
            for row in range(len(frame.boxes)):
                _same_rectangle(rectangles[int(frame.boxes.ids[row])], frame, row)
        assert len(solids) == len(keyframe.solids)
        for row in range(len(keyframe.solids)):
            _same_cuboid(solids[int(keyframe.solids.ids[row])], keyframe, row)


def test_vcd_places_openlabel_solids_in_the_world_and_in_images(
    made: LabelledSet, openlabel: dict[int, Any]
) -> None:
    compared, lenses = set(), _with_lenses(made)
    for keyframe in made.keyframes:
        assert keyframe.T_world_base is not None
        solids = [one["cuboid"] for one in openlabel[keyframe.keyframe]["objects"]]
        for solid in (box for boxes in solids for box in boxes):
            centre = np.array(solid["val"][:3])[None]
            _close(solid["world"], keyframe.T_world_base.apply(centre)[0])
            for frame in keyframe.frames:
                sensor = lenses.camera_of(keyframe, frame)
                assert sensor is not None
                at_camera = _camera_place(made, keyframe, frame).apply(centre)
                pixels, valid = sensor.camera().project(at_camera)
                inside = valid[0] and ((pixels >= 0) & (pixels < frame.image_size)).all()
                if inside:
                    off_px = np.abs(np.subtract(solid["pixels"][frame.camera], pixels[0])).max()
                    assert off_px <= _TOLERANCE_PX
                    compared.add(sensor.model)
    assert compared == {"pinhole", "fisheye", "rational"}


def test_boxes_of_a_track_are_one_openlabel_object_in_its_drive(
    made: LabelledSet, openlabel: dict[int, Any]
) -> None:
    for drive in made.drives:
        of_drive = [one.keyframe for one in made.keyframes if one.drive == drive]
        objects = [one for number in of_drive for one in openlabel[number]["objects"]]
        tracked = {
            (box["track_id"], one["uid"])
            for one in objects
            for box in [*one["bbox"], *one["cuboid"]]
            if "track_id" in box
        }
        assert sorted(track for track, _ in tracked) == [7, 8]


def _with_lenses(made: LabelledSet) -> LabelledSet:
    """Return the set with another lens in the front of the second and the third drive."""
    lenses = {
        "fisheye": (0.02, -0.01, 0.003, -0.001),
        "rational": (-0.12, 0.03, 0.0004, -0.0006, 0.001, 0.02, 0.003, 0.0001),
    }
    drives = dict(made.drives)
    for name, (model, numbers) in zip(list(drives)[1:], lenses.items(), strict=True):
        front = replace(drives[name].cameras["front"], model=model, distortion=numbers)
        drives[name] = replace(drives[name], cameras={**drives[name].cameras, "front": front})
    return replace(made, drives=drives)


def _camera_place(made: LabelledSet, keyframe: Keyframe, frame: LabelledFrame) -> Transform:
    """Return `T_camera_base`, from the base frame at the keyframe's time to the image's."""
    sensor = made.camera_of(keyframe, frame)
    assert sensor is not None
    assert sensor.T_base_sensor is not None
    assert frame.vehicle_place is not None
    return sensor.T_base_sensor.inverse() @ frame.vehicle_place


def _rows(sample: Any, keyframe: Keyframe) -> dict[str, int]:
    """Return the row of each box of a nuScenes sample: that of the nearest solid of the set."""
    assert keyframe.T_world_base is not None
    centres = keyframe.T_world_base.apply(keyframe.solids.boxes_m[:, :3])
    centres = centres + np.array([*sample["global_offset_m"], 0])
    rows = {
        token: int(np.linalg.norm(centres - box["centre"], axis=1).argmin())
        for token, box in sample["boxes"].items()
    }
    assert sorted(rows.values()) == list(range(len(centres)))
    return rows


def _same_kitti_box(found: Any, wanted: _F64, T_camera_base: Transform) -> None:
    x, y, z, length, width, height, yaw = wanted
    _close(found["dimensions"], np.array([height, width, length]))
    centre = T_camera_base.apply(np.array([[x, y, z]]))[0]
    _close(found["location"], centre + np.array([0, height / 2, 0]))
    heading = T_camera_base.rotation @ [np.cos(yaw), np.sin(yaw), 0]
    turn = np.arctan2(-heading[2], heading[0])
    assert abs(_turned(found["rotation_y"] - turn)) <= _TOLERANCE_RAD
    alpha = turn - np.arctan2(centre[0], centre[2])
    assert abs(_turned(found["alpha"] - alpha)) <= _TOLERANCE_RAD


def _same_nuscenes_box(found: Any, keyframe: Keyframe, row: int, offset_m: list[float]) -> None:
    x, y, z, length, width, height, yaw = keyframe.solids.boxes_m[row]
    assert found["label"] == keyframe.solids.labels[row]
    assert keyframe.T_world_base is not None
    centre = keyframe.T_world_base.apply(np.array([[x, y, z]]))[0]
    _close(found["centre"], centre + np.array([*offset_m, 0]))
    _close(found["size_wlh"], np.array([width, length, height]))
    rotation = keyframe.T_world_base.rotation @ rotation_from_rpy(0, 0, yaw)
    np.testing.assert_allclose(found["rotation"], rotation, atol=_TOLERANCE_RAD)
    points = int(keyframe.solids.points[row])
    assert points < 0 or found["points"] == points


def _same_rectangle(found: Any, frame: LabelledFrame, row: int) -> None:
    boxes = frame.boxes
    x, y, width, height = found["val"]
    sides = [x - width / 2, y - height / 2, x + width / 2, y + height / 2]
    assert np.abs(sides - boxes.boxes_px[row]).max() <= _TOLERANCE_PX
    assert found["system"] == frame.camera
    assert found["label"] == boxes.labels[row]
    assert found.get("confidence", np.nan) == pytest.approx(boxes.confidences[row], nan_ok=True)
    assert found.get("truncated", np.nan) == pytest.approx(boxes.truncated[row], nan_ok=True)
    assert found.get("occluded", np.nan) == pytest.approx(boxes.occluded[row], nan_ok=True)
    assert found.get("track_id", -1) == boxes.track_ids[row]
    assert found.get("box_3d", 0) == boxes.solids[row]
    assert found.get("source", "") == boxes.sources[row]


def _same_cuboid(found: Any, keyframe: Keyframe, row: int) -> None:
    solids = keyframe.solids
    x, y, z, qx, qy, qz, qw, length, width, height = found["val"]
    _close([x, y, z, length, width, height], solids.boxes_m[row, :6])
    assert (qx, qy) == (0, 0)
    assert abs(_turned(2 * np.arctan2(qz, qw) - solids.boxes_m[row, 6])) <= _TOLERANCE_RAD
    assert found["system"] == "base_link"
    assert found["label"] == solids.labels[row]
    assert found.get("confidence", np.nan) == pytest.approx(solids.confidences[row], nan_ok=True)
    assert found.get("track_id", -1) == solids.track_ids[row]
    assert found.get("source", "") == solids.sources[row]
    assert found.get("points", -1) == solids.points[row]
    velocity = found.get("velocity_mps", [np.nan, np.nan])
    np.testing.assert_allclose(velocity, solids.velocities_mps[row])


def _close(found: Any, wanted: _F64) -> None:
    assert np.abs(np.subtract(found, wanted)).max() <= _TOLERANCE_M


def _turned(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2 * np.pi) - np.pi)
