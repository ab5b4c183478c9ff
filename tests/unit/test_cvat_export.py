"""CVAT's XML: of images, and of videos as CVAT shows their tracks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from made_labelled_set import make_labelled_set
from renamed_labelled_set import HARD_NAMES, renamed, with_boxes

from percept.datasets.labelling.formats import export
from percept.datasets.labelling.formats.xml_text import xml_text
from percept.datasets.labelling.labelled_set import ImageBoxes, LabelledFrame, LabelledSet
from percept.datasets.labelling.names import safe_name

_Shown = tuple[str, tuple[float, ...], str]


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    made = renamed(make_labelled_set(tmp_path_factory.mktemp("cvat_set"), drives=3, keyframes=3))
    keyframes = tuple(
        replace(k, frames=tuple(replace(f, camera=_unsafe(f.camera)) for f in k.frames))
        for k in made.keyframes
    )
    made = replace(made, keyframes=keyframes)
    export(made, "cvat", made.folder / "cvat")
    return made


def _unsafe(camera: str) -> str:
    return "../лево" if camera == "left" else camera


def _root(path: Path) -> etree._Element:
    return etree.parse(path, etree.XMLParser(resolve_entities=False, no_network=True)).getroot()


def _attributes(box: etree._Element) -> dict[str, str]:
    return {str(one.attrib["name"]): one.text or "" for one in box.findall("attribute")}


def _sides(box: etree._Element) -> tuple[float, ...]:
    return tuple(float(box.attrib[name]) for name in ("xtl", "ytl", "xbr", "ybr"))


def test_images_have_their_boxes(labelled: LabelledSet) -> None:
    root = _root(labelled.folder / "cvat/images/annotations.xml")
    assert (root.tag, root.findtext("version")) == ("annotations", "1.1")
    images = root.findall("image")
    both = list(labelled.frames())
    for image, (keyframe, frame) in zip(images, both, strict=True):
        assert image.attrib["name"] == Path(frame.file).name
        assert image.attrib["subset"] == keyframe.split
        assert (image.attrib["width"], image.attrib["height"]) == ("320", "200")
        placed = labelled.folder / "cvat/images/images" / keyframe.split / image.attrib["name"]
        assert placed.samefile(labelled.folder / frame.file)
        boxes = image.findall("box")
        assert [box.attrib["label"] for box in boxes] == [xml_text(b) for b in frame.boxes.labels]
        found = np.array([_sides(box) for box in boxes]).reshape(-1, 4)
        np.testing.assert_allclose(found, frame.boxes.boxes_px, rtol=0, atol=1e-4)
        ids = [int(_attributes(box)["box_id"]) for box in boxes]
        assert ids == frame.boxes.ids.tolist()
    assert len({image.attrib["id"] for image in images}) == len(images)


def test_a_pre_label_says_that_it_is_one(labelled: LabelledSet) -> None:
    root = _root(labelled.folder / "cvat/images/annotations.xml")
    network, lidar, person = root.findall("image")[0].findall("box")
    assert [b.attrib["source"] for b in (network, lidar, person)] == ["auto", "auto", "manual"]
    assert [b.attrib["occluded"] for b in (network, lidar, person)] == ["1", "1", "0"]
    assert _attributes(network) == {
        "box_id": "1",
        "object_id": "7",
        "score": "0.8750",
        "model": "small",
    }
    assert _attributes(lidar)["model"] == "lidar"
    assert _attributes(person) == {"box_id": "3", "object_id": "", "score": "", "model": ""}


def test_classes_and_splits_are_those_of_the_set(labelled: LabelledSet) -> None:
    root = _root(labelled.folder / "cvat/images/annotations.xml")
    names = [label.findtext("name") for label in root.iter("label")]
    assert names == [xml_text(name) for name in HARD_NAMES]
    assert [subset.text for subset in root.iter("subset")] == ["train", "val", "test"]
    settings = json.loads((labelled.folder / "cvat/labels.json").read_text("ascii"))
    assert [setting["name"] for setting in settings] == names
    # What the constructor of labels asks for: texts, and not an empty list of them.
    for one in (one for setting in settings for one in setting["attributes"]):
        assert (type(one["mutable"]), one["input_type"], one["values"]) == (bool, "text", [""])


def test_control_characters_are_spelled_out() -> None:
    assert xml_text("a\x07\tb\r\n") == r"a\u0007\u0009b\u000d\u000a"
    assert xml_text("車 <&> \"'😀") == "車 <&> \"'😀"


def _videos(labelled: LabelledSet) -> Iterator[tuple[Path, list[LabelledFrame]]]:
    videos: dict[tuple[str, str], list[LabelledFrame]] = {}
    for keyframe, frame in labelled.frames():
        videos.setdefault((keyframe.drive, frame.camera), []).append(frame)
    for (drive, camera), frames in videos.items():
        folder = labelled.folder / "cvat/video" / f"{drive}_{safe_name(camera)}"
        yield folder, sorted(frames, key=lambda frame: frame.stamp_ns)


def _shown(folder: Path, images: int) -> list[list[_Shown]]:
    """Return what CVAT shows in each image: label, sides and number of each box."""
    shown: list[list[_Shown]] = [[] for _ in range(images)]
    for track in _root(folder / "annotations.xml").findall("track"):
        drawn = {int(box.attrib["frame"]): box for box in track.findall("box")}
        assert len(drawn) == len(track.findall("box"))
        assert all(box.attrib["keyframe"] == "1" for box in drawn.values())
        assert max(drawn) < images
        last = None
        for number in range(images):
            last = drawn.get(number, last)
            if last is not None and last.attrib["outside"] == "0":
                about = str(track.attrib["label"]), _sides(last), _attributes(last)["box_id"]
                shown[number].append(about)
    return shown


def _true(frame: LabelledFrame) -> list[_Shown]:
    boxes = frame.boxes
    rows = zip(boxes.labels, boxes.boxes_px.tolist(), boxes.ids.tolist(), strict=True)
    return [
        (xml_text(label), tuple(round(s, 4) for s in sides), str(n)) for label, sides, n in rows
    ]


def _assert_videos_show_the_boxes(labelled: LabelledSet) -> None:
    for folder, frames in _videos(labelled):
        for found, frame in zip(_shown(folder, len(frames)), frames, strict=True):
            assert sorted(found) == sorted(_true(frame))


def test_videos_show_the_boxes_of_each_image(labelled: LabelledSet) -> None:
    assert len(list((labelled.folder / "cvat/video").iterdir())) == 6
    _assert_videos_show_the_boxes(labelled)


def test_videos_have_their_images_in_the_order_of_time(labelled: LabelledSet) -> None:
    for folder, frames in _videos(labelled):
        images = sorted((folder / "images").iterdir())
        assert [image.name for image in images] == [
            f"{number:06d}_{Path(frame.file).name}" for number, frame in enumerate(frames)
        ]
        for image, frame in zip(images, frames, strict=True):
            assert image.samefile(labelled.folder / frame.file)
        task = _root(folder / "annotations.xml").find("meta/task")
        assert task is not None
        said = [task.findtext(name) for name in ("mode", "size", "start_frame", "stop_frame")]
        assert said == ["interpolation", "3", "0", "2"]
        assert task.findtext("original_size/width") == "320"


def test_an_object_is_one_track_over_gaps(tmp_path: Path) -> None:
    made = make_labelled_set(tmp_path, drives=1, keyframes=5, cameras=("front",))
    boxes = [frame.boxes for _, frame in made.frames()]
    boxes[4] = _again(boxes[3], 40)  # the last image of a drive has no boxes
    boxes[1] = ImageBoxes.none()
    made = with_boxes(made, boxes)
    export(made, "cvat", tmp_path / "cvat")
    _assert_videos_show_the_boxes(made)
    (folder,) = (tmp_path / "cvat/video").iterdir()
    tracks = _root(folder / "annotations.xml").findall("track")
    (car,) = [track for track in tracks if track.attrib["label"] == "car"]
    flags = [(box.attrib["frame"], box.attrib["outside"]) for box in car.findall("box")]
    assert flags == [("0", "0"), ("1", "1"), ("2", "0"), ("3", "0"), ("4", "0")]
    # Whoever takes the box outside in again draws a new one, of the same object.
    gone = _attributes(car.findall("box")[1])
    assert gone == {"box_id": "", "object_id": "7", "score": "", "model": ""}
    # A box without an object is a track by itself.
    assert len(tracks) == 1 + sum(int((one.track_ids < 0).sum()) for one in boxes)
    assert len({track.attrib["id"] for track in tracks}) == len(tracks)
    subsets = [one.text for one in _root(tmp_path / "cvat/images/annotations.xml").iter("subset")]
    assert subsets == ["train"]


def test_an_object_that_cvat_cannot_hold_as_one_track_becomes_several(tmp_path: Path) -> None:
    made = make_labelled_set(tmp_path, drives=1, keyframes=3, cameras=("front",))
    first, second, _ = (frame.boxes for _, frame in made.frames())
    twice = replace(first, track_ids=np.array([7, 7, 7]), labels=("car", "car", "pedestrian"))
    changed = replace(second, labels=("pedestrian", "car", "car"))
    made = with_boxes(made, [twice, changed, ImageBoxes.none()])
    export(made, "cvat", tmp_path / "cvat")
    _assert_videos_show_the_boxes(made)


def _again(boxes: ImageBoxes, first_id: int) -> ImageBoxes:
    return replace(boxes, ids=np.arange(first_id, first_id + len(boxes)))
