"""KITTI exports: readers that know nothing of percept find the boxes where they are."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_labelled_set import CATEGORIES, make_labelled_set
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.rig import CameraSensor
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.labelling.formats import ExportFormat, export
from percept.datasets.labelling.formats.camera_views import CameraView, camera_views
from percept.datasets.labelling.formats.kitti_boxes import (
    from_camera_boxes,
    kitti_types,
    to_camera_boxes,
)
from percept.datasets.labelling.labelled_set import Keyframe, LabelledSet
from percept.datasets.labels.kitti import read_kitti
from percept.datasets.labels.kitti_tracking import from_kitti_boxes, read_kitti_tracks

_F64 = NDArray[np.float64]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    return make_labelled_set(tmp_path_factory.mktemp("kitti") / "set", cameras=("front", "left"))


@pytest.fixture(scope="module")
def kitti(made: LabelledSet) -> Path:
    export(made, "kitti", made.folder / "kitti")
    return made.folder / "kitti"


@pytest.fixture(scope="module")
def tracking(made: LabelledSet) -> Path:
    export(made, "kitti-tracking", made.folder / "kitti-tracking")
    return made.folder / "kitti-tracking"


def _views(made: LabelledSet) -> list[tuple[Keyframe, CameraView]]:
    return [(k, view) for k in made.keyframes for view in camera_views(made, k)]


def _matrices(path: Path) -> dict[str, _F64]:
    rows = [line.replace(":", " ").split() for line in path.read_text().splitlines()]
    return {row[0]: np.array(row[1:], float).reshape(3, -1) for row in rows}


def _in_camera(made: LabelledSet, keyframe: Keyframe, view: CameraView) -> _F64:
    """Return the centres of 3D boxes in the camera, by the poses alone."""
    frame, sensor = view.frame, made.camera_of(keyframe, view.frame)
    assert sensor is not None
    assert sensor.T_base_sensor is not None
    assert frame.vehicle_place is not None
    in_base_then = frame.vehicle_place.apply(keyframe.solids.boxes_m[:, :3])
    return sensor.T_base_sensor.inverse().apply(in_base_then)


def test_rectangles_are_read_back(made: LabelledSet, kitti: Path) -> None:
    labels = read_kitti(kitti / "training" / "label_2")
    views = _views(made)
    assert [image.name for image in labels.images] == [f"{v.frame.frame:06d}" for _, v in views]
    types = kitti_types(CATEGORIES)
    for image, (_, view) in zip(labels.images, views, strict=True):
        np.testing.assert_allclose(image.boxes_px, view.boxes.boxes_px, atol=1e-5)
        assert image.labels == tuple(types[label] for label in view.boxes.labels)
        assert image.confidences is None


def test_3d_boxes_are_read_back(made: LabelledSet, kitti: Path) -> None:
    for keyframe, view in _views(made):
        rows = _rows(kitti, view)
        for row, number in zip(rows, view.boxes.solids.tolist(), strict=True):
            if not number:
                np.testing.assert_array_equal(row[7:], [-1, -1, -1, -1000, -1000, -1000, -10])
                continue
            at = keyframe.solids.ids.tolist().index(number)
            back = from_camera_boxes(row[None, 7:], view.T_camera_base)
            np.testing.assert_allclose(back[0], keyframe.solids.boxes_m[at], atol=1e-5)
            centre = row[10:13] - [0, row[7] / 2, 0]
            np.testing.assert_allclose(centre, _in_camera(made, keyframe, view)[at], atol=1e-5)


def test_points_of_an_object_project_into_its_3d_box(made: LabelledSet, kitti: Path) -> None:
    """By KITTI's own chain: P2, R0_rect and Tr_velo_to_cam of the sample's calibration."""
    keyframe, view = _views(made)[0]
    name = f"{view.frame.frame:06d}"
    calib = _matrices(kitti / "training" / "calib" / f"{name}.txt")
    points = np.fromfile(kitti / "training" / "velodyne" / f"{name}.bin", "<f4").reshape(-1, 4)
    inside = points[400:430, :3]  # the first object's, as they were made
    in_camera = (inside @ calib["Tr_velo_to_cam"][:, :3].T + calib["Tr_velo_to_cam"][:, 3]) @ calib[
        "R0_rect"
    ].T
    row = _rows(kitti, view)[0]
    assert np.abs(in_camera - (row[10:13] - [0, row[7] / 2, 0])).max() < 0.25 * np.sqrt(3)
    pixels = np.column_stack([in_camera, np.ones(30)]) @ calib["P2"].T
    expected, seen = view.sensor.camera().project(view.T_camera_base.apply(inside))
    assert seen.all()
    np.testing.assert_allclose(pixels[:, :2] / pixels[:, 2:], expected, atol=1e-6)
    assert keyframe.scan is not None
    source = (made.folder / keyframe.scan.file).stat()
    assert (kitti / "training" / "velodyne" / f"{name}.bin").stat().st_ino == source.st_ino


def test_samples_are_listed_by_split(made: LabelledSet, kitti: Path) -> None:
    with (kitti / "frames.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    expected = [(f"{f.frame:06d}", f.camera, k.split, f.file) for k, f in made.frames()]
    assert [(r["sample"], r["camera"], r["split"], r["file"]) for r in rows] == expected
    for split in ("train", "val", "test"):
        listed = (kitti / "ImageSets" / f"{split}.txt").read_text().split()
        assert listed == [name for name, _, of, _ in expected if of == split]
    images = sorted(path.stem for path in (kitti / "training" / "image_2").iterdir())
    assert images == [name for name, *_ in expected]


def test_what_is_lost_is_said(made: LabelledSet, kitti: Path, tmp_path: Path) -> None:
    told = export(made, "kitti", tmp_path / "kitti")
    readme = (kitti / "README.md").read_text()
    assert all(f"- {sentence}\n" in readme for sentence in told)
    # Of each keyframe's three 3D boxes, the one behind is in no image.
    assert f"{len(made.keyframes)} 3D boxes have no rectangle in any image" in readme
    assert "up to 2.0 deg" in readme


def test_tracks_are_read_back(made: LabelledSet, tracking: Path) -> None:
    with (tracking / "sequences.csv").open(encoding="utf-8") as file:
        sequences = list(csv.DictReader(file))
    assert [(s["drive"], s["camera"]) for s in sequences] == [
        (drive, camera) for drive in made.drives for camera in ("front", "left")
    ]
    for sequence in sequences:
        table = read_kitti_tracks(
            tracking / "training" / "label_02" / f"{sequence['sequence']}.txt"
        )
        own = [
            (k, v)
            for k, v in _views(made)
            if (k.drive, v.frame.camera) == (sequence["drive"], sequence["camera"])
        ]
        for number, (keyframe, view) in enumerate(own):
            rows = np.flatnonzero(table.frames == number)
            np.testing.assert_allclose(table.boxes_px[rows], view.boxes.boxes_px, atol=1e-5)
            tracked = view.boxes.track_ids >= 0
            assert table.ids[rows][tracked].tolist() == view.boxes.track_ids[tracked].tolist()
            assert (table.ids[rows][~tracked] > 8).all()  # the largest track of the made set
            assert len(set(table.ids[rows].tolist())) == len(rows)
            linked = view.boxes.solids > 0
            at = [keyframe.solids.ids.tolist().index(n) for n in view.boxes.solids[linked]]
            level = from_kitti_boxes(
                to_camera_boxes(keyframe.solids.boxes_m[at], view.T_camera_base)
            )
            np.testing.assert_allclose(table.boxes_m[rows][linked], level, atol=1e-5)
            assert np.isnan(table.boxes_m[rows][~linked]).all()


def test_one_calibration_serves_all_frames_of_a_sequence(made: LabelledSet, tracking: Path) -> None:
    """The points are moved to the image's time, so that they project as with their own motion."""
    calib = _matrices(tracking / "training" / "calib" / "0000.txt")
    own = [
        (k, v) for k, v in _views(made) if (k.drive, v.frame.camera) == ("drive-000000", "front")
    ]
    for number, (keyframe, view) in enumerate(own):
        path = tracking / "training" / "velodyne" / "0000" / f"{number:06d}.bin"
        moved = np.fromfile(path, "<f4").reshape(-1, 4)
        assert keyframe.scan is not None
        points = np.fromfile(made.folder / keyframe.scan.file, "<f4").reshape(-1, 4)
        np.testing.assert_array_equal(moved[:, 3], points[:, 3])
        T = calib["Tr_velo_cam"]
        in_camera = moved[:, :3] @ T[:, :3].T + T[:, 3]
        expected = view.T_camera_base.apply(points[:, :3])
        np.testing.assert_allclose(in_camera, expected, atol=1e-4)
        assert np.abs(moved[:, :3] - points[:, :3]).max() > 0.05


def test_sequence_maps_list_each_split(tracking: Path) -> None:
    assert (tracking / "training" / "evaluate_tracking.seqmap.train").read_text().splitlines() == [
        "0000 empty 000000 000003",
        "0001 empty 000000 000003",
    ]
    assert (tracking / "training" / "evaluate_tracking.seqmap.val").read_text().startswith("0002 ")
    assert (tracking / "training" / "evaluate_tracking.seqmap.test").read_text() == ""


def test_boxes_survive_any_camera() -> None:
    random = np.random.default_rng(3)
    boxes = np.column_stack(
        [random.uniform(-30, 30, (50, 3)), random.uniform(0.3, 9, (50, 3)),
         random.uniform(-np.pi, np.pi, 50)]
    )  # fmt: skip
    for turn in np.linspace(-2, 2, 9):
        tilt = np.radians([3, 25, 0]) * turn / 2
        T = _camera_looking(*tilt)
        back = from_camera_boxes(to_camera_boxes(boxes, T), T)
        np.testing.assert_allclose(back[:, :6], boxes[:, :6], atol=1e-9)
        off = np.mod(back[:, 6] - boxes[:, 6] + np.pi, 2 * np.pi) - np.pi
        np.testing.assert_allclose(off, 0, atol=1e-9)


def _camera_looking(roll: float, pitch: float, yaw: float) -> Transform:
    optical = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(roll, pitch, yaw) @ optical
    matrix[:3, 3] = (1.5, 0.2, 1.6)
    return Transform("base_link", "camera", matrix).inverse()


def test_words_of_classes_are_one_each() -> None:
    types = kitti_types(("a b", "a_b", "DontCare", "", "car"))
    assert types == {"a b": "a_b", "a_b": "a_b_", "DontCare": "DontCare_", "": "_", "car": "car"}


@pytest.mark.parametrize("name", ["kitti", "kitti-tracking", "nuscenes", "sustech"])
def test_what_is_missing_is_said_with_the_command_that_makes_it(
    made: LabelledSet, name: ExportFormat, tmp_path: Path
) -> None:
    lacks = {
        r"drive 0\.mcap: the lens of camera 'front' is not known.*percept calib camera'": (
            _with_cameras(made, {})
        ),
        "the place of camera 'front' is not known.*percept calib camera-lidar": _with_cameras(
            made, {n: replace(c, T_base_sensor=None) for n, c in _cameras(made).items()}
        ),
        f"{name} needs LiDAR scans.*percept calib lidar": _with_keyframes(made, scan=None),
        f"needs it without distortion.*prepare --format {name}": replace(
            made,
            keyframes=tuple(
                replace(k, frames=tuple(replace(f, rectified_file=None) for f in k.frames))
                for k in made.keyframes
            ),
        ),
    }
    if name == "nuscenes":
        no_poses = _with_keyframes(made, T_world_base=None)
        lacks["needs the places of the vehicle.*percept odometry"] = no_poses
    for number, (message, lacking) in enumerate(lacks.items()):
        with pytest.raises(InputError, match=message):
            export(lacking, name, tmp_path / str(number))


@pytest.mark.parametrize("name", ["kitti", "kitti-tracking"])
def test_jpegs_are_refused(made: LabelledSet, name: ExportFormat, tmp_path: Path) -> None:
    frames = made.keyframes[0].frames
    plain = tuple(replace(frame, rectified_file=frame.file) for frame in frames)
    lossy = replace(made, keyframes=(replace(made.keyframes[0], frames=plain),))
    with pytest.raises(InputError, match=r"without distortion, as \.png"):
        export(lossy, name, tmp_path / "out")


def test_a_keyframe_without_scan_is_left_out_and_counted(made: LabelledSet, tmp_path: Path) -> None:
    first = replace(made.keyframes[0], scan=None)
    told = export(replace(made, keyframes=(first, *made.keyframes[1:])), "kitti", tmp_path / "out")
    assert "2 images of keyframes without a scan are left out." in told
    assert not (tmp_path / "out" / "training" / "label_2" / "000000.txt").exists()


def test_an_unknown_motion_is_told(made: LabelledSet, tmp_path: Path) -> None:
    keyframe = made.keyframes[0]
    still = tuple(replace(frame, vehicle_place=None) for frame in keyframe.frames)
    told = export(
        replace(made, keyframes=(replace(keyframe, frames=still),)), "kitti", tmp_path / "out"
    )
    assert "2 images are calibrated as if the vehicle stood, up to 14 ms." in told


def _rows(kitti: Path, view: CameraView) -> _F64:
    path = kitti / "training" / "label_2" / f"{view.frame.frame:06d}.txt"
    lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    return np.array([[float(word) for word in line[1:]] for line in lines]).reshape(-1, 14)


def _cameras(made: LabelledSet) -> dict[str, CameraSensor]:
    return dict(next(iter(made.drives.values())).cameras)


def _with_cameras(made: LabelledSet, cameras: dict[str, CameraSensor]) -> LabelledSet:
    drives = {name: replace(drive, cameras=cameras) for name, drive in made.drives.items()}
    return replace(made, drives=drives)


def _with_keyframes(made: LabelledSet, **changes: Any) -> LabelledSet:
    return replace(made, keyframes=tuple(replace(k, **changes) for k in made.keyframes))
