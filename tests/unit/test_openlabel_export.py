"""OpenLABEL files: what stands in them when a set lacks things, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_labelled_set import make_labelled_set

from percept.core.errors import InputError
from percept.core.transform import Transform
from percept.datasets.labelling.formats.openlabel import export_openlabel
from percept.datasets.labelling.labelled_set import (
    Drive,
    ImageBoxes,
    Keyframe,
    LabelledSet,
    SolidBoxes,
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    return make_labelled_set(tmp_path_factory.mktemp("made") / "set", drives=1)


def _written(labelled: LabelledSet, folder: Path) -> dict[str, Any]:
    """Return the content of each file by its name below the folder."""
    folder.mkdir()
    export_openlabel(labelled, folder)
    return {
        str(file.relative_to(folder)): json.loads(file.read_text("utf-8"))["openlabel"]
        for file in folder.glob("*/*.json")
    }


def _only(labelled: LabelledSet, folder: Path) -> dict[str, Any]:
    (content,) = _written(labelled, folder).values()
    return dict(content)


def _with(labelled: LabelledSet, *keyframes: Keyframe) -> LabelledSet:
    return replace(labelled, keyframes=keyframes)


def _drive(labelled: LabelledSet, **changes: Any) -> LabelledSet:
    (drive,) = labelled.drives.values()
    changed: Drive = replace(drive, **changes)
    return replace(labelled, drives={drive.name: changed})


def test_a_drive_that_changes_split_is_a_file_for_each_stretch(
    made: LabelledSet, tmp_path: Path
) -> None:
    first, second, third = made.keyframes
    written = _written(_with(made, first, replace(second, split="val"), third), tmp_path / "out")
    drive = first.drive
    assert set(written) == {
        f"train/{drive}-0.json", f"val/{drive}-1.json", f"train/{drive}-2.json",
    }  # fmt: skip
    (middle,) = (written[f"val/{drive}-1.json"]["frames"]).values()
    assert middle["frame_properties"]["keyframe"] == second.keyframe
    named = [
        {one["name"]: uid for uid, one in file["objects"].items()} for file in written.values()
    ]
    assert len({names["car track 7"] for names in named}) == 1


def test_an_object_that_is_away_for_a_while_has_two_intervals(
    made: LabelledSet, tmp_path: Path
) -> None:
    first, second, third = made.keyframes
    bare = tuple(replace(frame, boxes=ImageBoxes.none()) for frame in second.frames)
    away = replace(second, frames=bare, solids=SolidBoxes.none())
    content = _only(_with(made, first, away, third), tmp_path / "out")
    (car,) = (one for one in content["objects"].values() if one["name"] == "car track 7")
    spans = [{"frame_start": 0, "frame_end": 0}, {"frame_start": 2, "frame_end": 2}]
    assert car["frame_intervals"] == spans
    assert car["object_data_pointers"]["cuboid"]["frame_intervals"] == spans
    assert car["object_data_pointers"]["bbox_left"]["frame_intervals"] == spans[:1]
    assert content["frames"]["1"]["objects"] == {}
    assert content["frame_intervals"] == [{"frame_start": 0, "frame_end": 2}]


def test_a_2d_box_that_names_a_3d_box_is_of_its_object(made: LabelledSet, tmp_path: Path) -> None:
    content = _only(_with(made, made.keyframes[0]), tmp_path / "out")
    objects = content["frames"]["0"]["objects"].values()
    walkers = [one["object_data"] for one in objects if _boxes(one, "cuboid") == [2]]
    assert [_boxes({"object_data": one}, "bbox") for one in walkers] == [[2, 5]]


def _boxes(one: dict[str, Any], kind: str) -> list[int]:
    numbers = (box["attributes"]["num"] for box in one["object_data"].get(kind, []))
    return [value["val"] for values in numbers for value in values if value["name"] == "box"]


def test_two_boxes_of_one_track_in_an_image_keep_names_apart(
    made: LabelledSet, tmp_path: Path
) -> None:
    keyframe = made.keyframes[0]
    frame = keyframe.frames[0]
    boxes = replace(
        frame.boxes, labels=("car",) * 3, track_ids=np.full(3, 7), solids=np.zeros(3, np.int64)
    )
    crowded = replace(keyframe, frames=(replace(frame, boxes=boxes), *keyframe.frames[1:]))
    content = _only(_with(made, crowded), tmp_path / "out")
    (uid,) = (uid for uid, one in content["objects"].items() if one["name"] == "car track 7")
    names = [one["name"] for one in content["frames"]["0"]["objects"][uid]["object_data"]["bbox"]]
    assert len(names) == len(set(names)) == 4
    assert set(names) < set(content["objects"][uid]["object_data_pointers"])


def test_a_camera_of_unknown_lens_has_its_images_and_boxes(
    made: LabelledSet, tmp_path: Path
) -> None:
    content = _only(_drive(made, cameras={}), tmp_path / "out")
    assert content["streams"]["front"]["stream_properties"] == {}
    assert "pose_wrt_parent" not in content["coordinate_systems"]["front"]
    properties = content["frames"]["0"]["frame_properties"]
    assert list(properties["transforms"]) == ["base_link_to_map"]
    assert len(content["objects"]) > 0


def test_where_motion_is_not_known_the_place_on_the_vehicle_stands_alone(
    made: LabelledSet, tmp_path: Path
) -> None:
    keyframe = made.keyframes[0]
    frames = tuple(replace(frame, vehicle_place=None) for frame in keyframe.frames)
    still = replace(keyframe, frames=frames, T_world_base=None)
    content = _only(_with(made, still), tmp_path / "out")
    assert content["frames"]["0"]["frame_properties"]["transforms"] == {}
    assert set(content["coordinate_systems"]) == {"base_link", "front", "left"}
    sensor = made.drives[keyframe.drive].cameras["left"]
    assert sensor.T_base_sensor is not None
    matrix = content["coordinate_systems"]["left"]["pose_wrt_parent"]["matrix4x4"]
    np.testing.assert_array_equal(np.reshape(matrix, (4, 4)), sensor.T_base_sensor.matrix)


def test_a_set_without_scans_has_no_stream_of_them(tmp_path: Path) -> None:
    made = make_labelled_set(tmp_path / "set", drives=1, with_scans=False, located=False)
    content = _only(made, tmp_path / "out")
    assert set(content["streams"]) == {"front", "left"}
    assert not (tmp_path / "out" / "scans").exists()


@pytest.mark.parametrize("name", ["base_link", "map", "scan"])
def test_a_camera_with_the_name_of_another_system_is_refused(
    made: LabelledSet, tmp_path: Path, name: str
) -> None:
    keyframe = made.keyframes[0]
    taken = replace(keyframe, frames=(replace(keyframe.frames[0], camera=name),))
    with pytest.raises(InputError, match=f"'{name}' names two coordinate systems"):
        _only(_with(made, taken), tmp_path / "out")


def test_a_world_with_the_name_of_the_base_frame_is_refused(
    made: LabelledSet, tmp_path: Path
) -> None:
    keyframe = replace(made.keyframes[0], T_world_base=Transform.identity("base_link", "base_link"))
    with pytest.raises(InputError, match="'base_link' names two coordinate systems"):
        _only(_with(made, keyframe), tmp_path / "out")


def test_the_readme_says_what_is_lost(made: LabelledSet, tmp_path: Path) -> None:
    lost = export_openlabel(made, tmp_path)
    readme = (tmp_path / "README.md").read_text("utf-8")
    assert lost
    assert all(sentence in readme for sentence in lost)
