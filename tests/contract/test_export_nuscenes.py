"""The nuScenes export: the tables hold together, and boxes and points are where they were.

The development kit itself reads it in `test_oracles.py`.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from made_labelled_set import CATEGORIES, make_labelled_set
from numpy.typing import NDArray

from percept.core.transform import matrix_from_quat_xyzw
from percept.datasets.labelling.formats import export
from percept.datasets.labelling.formats.camera_views import camera_views
from percept.datasets.labelling.formats.nuscenes_map import DriveMap
from percept.datasets.labelling.formats.nuscenes_tables import SensorTables, category_table
from percept.datasets.labelling.formats.scenes import scenes_of
from percept.datasets.labelling.labelled_set import LabelledSet

_Rows = dict[str, dict[str, Any]]
_NAMES = (
    "attribute", "calibrated_sensor", "category", "ego_pose", "instance", "log", "map", "sample",
    "sample_annotation", "sample_data", "scene", "sensor", "visibility",
)  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    return make_labelled_set(tmp_path_factory.mktemp("nuscenes") / "set")


@pytest.fixture(scope="module")
def folder(made: LabelledSet) -> Path:
    export(made, "nuscenes", made.folder / "nuscenes")
    return made.folder / "nuscenes"


@pytest.fixture(scope="module")
def tables(folder: Path) -> dict[str, _Rows]:
    return _tables(folder)


def _tables(folder: Path) -> dict[str, _Rows]:
    files = {path.stem: path for path in (folder / "v1.0-trainval").iterdir()}
    return {
        name: {row["token"]: row for row in json.loads(path.read_text(encoding="utf-8"))}
        for name, path in files.items()
    }


def _matrix(place: dict[str, Any]) -> NDArray[np.float64]:
    w, x, y, z = place["rotation"]
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_from_quat_xyzw([x, y, z, w])
    matrix[:3, 3] = place["translation"]
    return matrix


def test_all_thirteen_tables_refer_to_rows_that_exist(tables: dict[str, _Rows]) -> None:
    assert sorted(tables) == list(_NAMES)
    for rows in tables.values():
        for row in rows.values():
            for key, value in row.items():
                table = key.removesuffix("_token").removesuffix("_tokens")
                table = table.removeprefix("first_").removeprefix("last_")
                if key.endswith(("_token", "_tokens")) and value:
                    of = {"annotation": "sample_annotation"}.get(table, table)
                    wanted = value if isinstance(value, list) else [value]
                    assert all(token in tables[of] for token in wanted), key


@pytest.mark.parametrize(("table", "of"), [("sample", "scene"), ("sample_annotation", "instance")])
def test_chains_go_from_first_to_last(tables: dict[str, _Rows], table: str, of: str) -> None:
    part = table.removeprefix("sample_")
    for owner in tables[of].values():
        token, before, count = owner[f"first_{part}_token"], "", 0
        while token:
            row = tables[table][token]
            assert row["prev"] == before
            assert row[f"{of}_token"] == owner["token"]
            token, before, count = row["next"], token, count + 1
        assert before == owner[f"last_{part}_token"]
        assert count == owner["nbr_samples" if of == "scene" else "nbr_annotations"]


def test_boxes_are_ours_in_the_frame_of_the_scan(
    made: LabelledSet, tables: dict[str, _Rows]
) -> None:
    found = 0
    for keyframe in made.keyframes:
        sample = next(
            row
            for row in tables["sample"].values()
            if row["timestamp"] == keyframe.stamp_ns // 1000
        )
        pose = _matrix(_pose(tables, sample["token"], "LIDAR_TOP"))
        own = [
            row for row in tables["sample_annotation"].values()
            if row["sample_token"] == sample["token"]
        ]  # fmt: skip
        boxes = {round(row["size"][1], 3): row for row in own}  # no two have one length
        for row, box in enumerate(keyframe.solids.boxes_m):
            annotation = boxes[round(float(box[3]), 3)]
            place = np.linalg.inv(pose) @ _matrix(annotation)
            np.testing.assert_allclose(place[:3, 3], box[:3], atol=1e-6)
            assert annotation["size"] == [box[4], box[3], box[5]]
            heading = [np.cos(box[6]), np.sin(box[6]), 0]
            np.testing.assert_allclose(place[:3, 0], heading, atol=1e-9)
            instance = tables["instance"][annotation["instance_token"]]
            category = tables["category"][instance["category_token"]]
            assert category["description"] == keyframe.solids.labels[row]
            found += 1
    assert found == sum(len(keyframe.solids) for keyframe in made.keyframes)


def _pose(tables: dict[str, _Rows], sample: str, channel: str) -> dict[str, Any]:
    return tables["ego_pose"][_data(tables, sample, channel)["ego_pose_token"]]


def _data(tables: dict[str, _Rows], sample: str, channel: str) -> dict[str, Any]:
    for row in tables["sample_data"].values():
        place = tables["calibrated_sensor"][row["calibrated_sensor_token"]]
        name = tables["sensor"][place["sensor_token"]]["channel"]
        if row["sample_token"] == sample and name == channel:
            return row
    raise AssertionError((sample, channel))


def test_points_project_into_images_by_the_poses(
    made: LabelledSet, folder: Path, tables: dict[str, _Rows]
) -> None:
    """The kit's chain: scan, vehicle at its time, world, vehicle at the image's time, camera."""
    keyframe = made.keyframes[0]
    sample = next(iter(tables["sample"]))
    view = next(view for view in camera_views(made, keyframe) if view.frame.camera == "left")
    image, scan = _data(tables, sample, "CAM_LEFT"), _data(tables, sample, "LIDAR_TOP")
    assert image["timestamp"] == view.frame.stamp_ns // 1000
    points = np.fromfile(folder / scan["filename"], "<f4").reshape(-1, 5)
    chain = np.linalg.inv(_matrix(tables["calibrated_sensor"][image["calibrated_sensor_token"]]))
    chain = chain @ np.linalg.inv(_matrix(tables["ego_pose"][image["ego_pose_token"]]))
    chain = chain @ _matrix(tables["ego_pose"][scan["ego_pose_token"]])
    in_camera = points[:, :3] @ chain[:3, :3].T + chain[:3, 3]
    np.testing.assert_allclose(in_camera, view.T_camera_base.apply(points[:, :3]), atol=1e-5)
    K = tables["calibrated_sensor"][image["calibrated_sensor_token"]]["camera_intrinsic"]
    np.testing.assert_array_equal(K, view.sensor.camera().K)
    pixels = cv2.imread(str(folder / image["filename"]))
    assert pixels is not None
    assert pixels.shape[:2] == (image["height"], image["width"])


def test_a_track_is_one_instance_in_a_scene(tables: dict[str, _Rows]) -> None:
    counts = sorted(row["nbr_annotations"] for row in tables["instance"].values())
    # Of each drive: two tracks over three keyframes, and three boxes without a track.
    assert counts == [1] * 6 + [3] * 4


def test_what_a_prelabel_is_from_is_said(tables: dict[str, _Rows]) -> None:
    for row in tables["sample_annotation"].values():
        names = [tables["attribute"][token]["name"] for token in row["attribute_tokens"]]
        assert names == ([f"prelabel.{row['source']}"] if row["source"] else [])
        assert (row["score"] is None) == (not row["source"])
    assert {row["source"] for row in tables["sample_annotation"].values()} == {
        "tracks",
        "lidar",
        "",
    }


def test_points_and_visibility(made: LabelledSet, tables: dict[str, _Rows]) -> None:
    by_source = {row["source"]: row for row in tables["sample_annotation"].values()}
    assert by_source["tracks"]["num_lidar_pts"] == 120
    # That of a person was not counted when the set was made; its box is along the axes.
    scan = made.keyframes[-1].scan
    assert scan is not None
    points = np.fromfile(made.folder / scan.file, "<f4").reshape(-1, 4)[:, :3]
    inside = np.abs(points - [-15, 3, 1.2]) <= np.array([8.5, 2.5, 3.1]) / 2
    assert by_source[""]["num_lidar_pts"] == inside.all(axis=1).sum() >= 30
    levels = {s: tables["visibility"].get(r["visibility_token"]) for s, r in by_source.items()}
    assert levels["tracks"] is not None
    assert levels["tracks"]["level"] == "v80-100"
    assert levels["lidar"] is not None
    assert levels["lidar"]["level"] == "v40-60"  # 0.4 of it is visible
    assert levels[""] is None


def test_classes_keep_their_order_and_have_the_kits_names(folder: Path) -> None:
    rows = json.loads((folder / "v1.0-trainval" / "category.json").read_text(encoding="utf-8"))
    assert [row["description"] for row in rows] == list(CATEGORIES)
    assert [row["name"] for row in rows] == [
        "vehicle.car", "human.pedestrian.adult", CATEGORIES[2],
    ]  # fmt: skip


def test_two_classes_never_share_a_name() -> None:
    rows = category_table(("person", "pedestrian", "Traffic Cone", "deer"))
    assert [row["name"] for row in rows] == [
        "human.pedestrian.adult", "pedestrian", "movable_object.trafficcone", "deer",
    ]  # fmt: skip


def test_channels_lead_nowhere_and_are_one_each() -> None:
    sensors = SensorTables()
    names = ("front", "FRONT", "cam_front", "../../etc/é", "..")
    channels = [sensors.channel(name) for name in names]
    assert channels[0] == "CAM_FRONT"
    assert len(set(channels)) == len(names)
    assert all(re.fullmatch("CAM_[A-Z0-9_]+", channel) for channel in channels)
    assert [sensors.channel(name) for name in names] == channels


def test_scenes_are_listed_by_split(made: LabelledSet, folder: Path) -> None:
    assert json.loads((folder / "splits.json").read_text()) == {
        "train": ["drive-000000-0"], "val": ["drive-000001-0"], "test": [],
    }  # fmt: skip
    one, two, three = made.keyframes[:3]
    mixed = (one, replace(two, split="val"), three)
    scenes = [(scene.name[-1], scene.split, len(scene.keyframes)) for scene in scenes_of(mixed)]
    assert scenes == [("0", "train", 1), ("1", "val", 1), ("2", "train", 1)]


def test_the_map_shows_where_the_vehicle_was(
    made: LabelledSet, folder: Path, tables: dict[str, _Rows]
) -> None:
    world = next(iter(tables["map"].values()))
    pixels = cv2.imread(str(folder / world["filename"]), cv2.IMREAD_GRAYSCALE)
    assert pixels is not None
    sample = next(iter(tables["sample"]))
    x, y, _ = _pose(tables, sample, "LIDAR_TOP")["translation"]
    assert min(x, y) > 99  # the kit draws 57 m around the vehicle
    assert pixels[pixels.shape[0] - round(y * 10), round(x * 10)] == 255
    assert 0 < (pixels > 0).mean() < 0.01
    log = next(iter(tables["log"].values()))
    place = made.keyframes[0].T_world_base
    assert place is not None
    np.testing.assert_allclose([x, y] - place.translation_m[:2], log["global_offset_m"], atol=1e-9)


def test_north_is_up_on_the_map(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    world = DriveMap.around("bent", np.array([[-3.0, 7.0], [17.0, 47.0], [37.0, 47.0]]))
    assert world.draw(tmp_path)
    pixels = cv2.imread(str(tmp_path / world.file), cv2.IMREAD_GRAYSCALE)
    assert pixels is not None
    for x, y in world.places_m:
        assert pixels[pixels.shape[0] - round(y * 10), round(x * 10)] == 255


def test_a_map_that_is_too_large_is_a_pixel(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    world = DriveMap.around("far", np.array([[0.0, 0.0], [5000.0, 10.0]]))
    assert not world.draw(tmp_path)
    pixels = cv2.imread(str(tmp_path / world.file))
    assert pixels is not None
    assert pixels.shape[:2] == (1, 1)


def test_keyframes_that_lack_something_are_left_out_and_counted(
    made: LabelledSet, tmp_path: Path
) -> None:
    first, second, *others = made.keyframes
    lacking = replace(
        made, keyframes=(replace(first, T_world_base=None), replace(second, scan=None), *others)
    )
    told = export(lacking, "nuscenes", tmp_path / "out")
    assert "1 keyframes whose place is not known are left out." in told
    assert "1 keyframes without a scan are left out." in told
    assert len(_tables(tmp_path / "out")["sample"]) == len(others)
