"""CVAT's XML and Label Studio's JSON, also such as nobody should have written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from percept.core.errors import InputError, UsageError
from percept.core.labels import LabelledImage, LabelSet
from percept.datasets.labels import label_format, read_detections, read_labels
from percept.datasets.labels.cvat import read_cvat
from percept.datasets.labels.label_studio import read_label_studio

_META = (
    "<version>1.1</version><meta><task><name>t</name><size>{size}</size><labels>"
    "<label><name>car</name></label><label><name>deer</name></label></labels>"
    "<original_size><width>64</width><height>48</height></original_size></task></meta>"
)


def _xml(folder: Path, body: str, *, size: int = 3) -> Path:
    path = folder / "annotations.xml"
    text = f"<annotations>{_META.format(size=size)}{body}</annotations>"
    path.write_text(text, encoding="utf-8")
    return path


def _box(sides: str = "1 2 11 22", said: str = "", *attributes: tuple[str, object]) -> str:
    names = zip(("xtl", "ytl", "xbr", "ybr"), sides.split(), strict=True)
    inner = "".join(f'<attribute name="{n}">{v}</attribute>' for n, v in attributes)
    outer = " ".join(f'{name}="{side}"' for name, side in names)
    return f"<box {outer} {said}>{inner}</box>"


def _image(body: str, name: str = "a.jpg") -> str:
    return f'<image id="0" name="{name}" width="64" height="48">{body}</image>'


def test_boxes_of_images(tmp_path: Path) -> None:
    car = _box("1 2 11 22.5", 'label="car"', ("box_id", 12), ("object_id", 7), ("score", 0.5))
    deer = _box("5 5 6 6", 'label="deer" occluded="1"', ("box_id", ""), ("object_id", ""))
    path = _xml(tmp_path, _image(car + deer) + _image("", "b.jpg"))
    assert label_format(path) == label_format(tmp_path) == "cvat"
    first, second = read_labels(path, "cvat").images
    assert (first.name, first.image_size, second.name, len(second)) == (
        "a.jpg",
        (64, 48),
        "b.jpg",
        0,
    )
    assert first.boxes_px.tolist() == [[1, 2, 11, 22.5], [5, 5, 6, 6]]
    assert first.labels == ("car", "deer")
    assert first.box_ids.tolist() == [12, 0]
    assert first.track_ids.tolist() == [7, -1]
    assert first.confidences is None
    assert read_cvat(path).categories == {0: "car", 1: "deer"}


def test_tracks_are_shown_as_cvat_shows_them(tmp_path: Path) -> None:
    folder = tmp_path / "front"
    folder.mkdir()
    own = ("object_id", 3)
    track = (
        _box("0 0 10 10", 'frame="0" outside="0" keyframe="1"', ("box_id", 1), own)
        + _box("4 0 14 10", 'frame="2" outside="0" keyframe="1"', ("box_id", 1), own)
        + _box("4 0 14 10", 'frame="4" outside="1" keyframe="1"', own)
    )
    other = _box("0 0 9 9", 'frame="1" outside="0"') + _box("0 0 9 9", 'frame="5" outside="1"')
    alone = _box("0 0 5 5", 'frame="5" outside="0"')
    path = _xml(
        folder,
        f'<track id="0" label="car">{track}</track><track id="1" label="deer">{other}</track>'
        f'<track id="2" label="deer">{alone}</track>',
        size=6,
    )
    images = read_cvat(path).images
    assert [image.name for image in images] == [f"front/{k}" for k in range(6)]
    cars = [image.boxes_px[k].tolist() for image in images for k in _rows(image, "car")]
    assert cars == [[0, 0, 10, 10], [2, 0, 12, 10], [4, 0, 14, 10], [4, 0, 14, 10]]
    assert [i.box_ids[k] for i in images for k in _rows(i, "car")] == [1, 0, 0, 0]
    assert {i.track_ids[k] for i in images for k in _rows(i, "car")} == {3}
    deer = [
        (int(image.name[-1]), image.track_ids[k]) for image in images for k in _rows(image, "deer")
    ]
    new = 2**32 + 1  # CVAT's number may be that of an object of ours; one box alone is no track
    assert deer == [(1, new), (2, new), (3, new), (4, new), (5, -1)]


def _rows(image: LabelledImage, label: str) -> list[int]:
    return [row for row, one in enumerate(image.labels) if one == label]


def test_shapes_that_are_no_boxes_are_counted(tmp_path: Path) -> None:
    body = (
        '<polygon label="car" points="1,2;3,4;5,6"/><tag label="car"/>'
        + _box("1 1 9 9", 'label="car" rotation="30.5"')
        + _box("9 9 1 1", 'label="car"')
        + _box("nan 1 9 9", 'label="car"')
        + _box("1 1 9 9", 'label="car" rotation="0.0"')
    )
    found = read_cvat(_xml(tmp_path, _image(body)))
    assert len(found.images[0]) == 1
    assert found.dropped == {
        "shapes of kind polygon": 1,
        "shapes of kind tag": 1,
        "turned boxes": 1,
        "boxes of negative or no size": 1,
        "boxes that are not finite": 1,
    }


_LAUGHS = '<!DOCTYPE a [<!ENTITY l "ha"><!ENTITY m "&l;&l;&l;">]>'
_FILES = '<!DOCTYPE a [<!ENTITY f SYSTEM "file:///etc/hostname">]>'


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (f"{_LAUGHS}<annotations>&m;</annotations>", "document type"),
        (f"{_FILES}<annotations>&f;</annotations>", "document type"),
        ('<!DOCTYPE annotations SYSTEM "http://127.0.0.1/a.dtd"><annotations/>', "document type"),
        ("<annotations>&unknown;</annotations>", "is no XML"),
        ("<annotations>", "is no XML"),
        ("", "is no XML"),
        ("<html/>", "holds <html>"),
        ("<annotations>" + "<a>" * 200 + "</a>" * 200 + "</annotations>", "100 deep"),
        (f"<annotations>{_image(_box())}</annotations>", "without a label"),
        (f"<annotations>{_image('', '')}</annotations>", "without a name"),
        (f"<annotations>{_image('') * 2}</annotations>", "two images"),
        ('<annotations><track label="a"><box frame="-1"/></track></annotations>', "no number"),
        (f"<annotations>{_META.format(size=10**8)}<track label='a'/></annotations>", "is most"),
        ('<?xml version="1.0" encoding="utf-99"?><annotations/>', "is no XML"),
    ],
)
def test_hostile_xml_is_an_error(text: str, what: str, tmp_path: Path) -> None:
    path = tmp_path / "annotations.xml"
    path.write_text(text)
    with pytest.raises(InputError, match=what):
        read_cvat(path)


def _region(label: str = "car", **more: Any) -> dict[str, Any]:
    value = {"x": 10, "y": 50, "width": 25, "height": 25, "rotation": 0, "rectanglelabels": [label]}
    return {
        "id": "box-4", "type": "rectanglelabels", "original_width": 200, "original_height": 100,
        "image_rotation": 0, "meta": {"track_id": 7}, "value": value,
    } | more  # fmt: skip


def _task(image: str = "/data/local-files/?d=images/a.jpg", *results: Any) -> dict[str, Any]:
    return {"data": {"image": image, "drive": "d"}, "annotations": [*results], "predictions": []}


def _done(*regions: Any, **more: Any) -> dict[str, Any]:
    return {"id": 1, "was_cancelled": False, "result": [*regions]} | more


def _read(folder: Path, content: object) -> LabelSet:
    path = folder / "export.json"
    path.write_text(json.dumps(content))
    return read_label_studio(path)


def test_regions_become_boxes(tmp_path: Path) -> None:
    found = _read(tmp_path, [_task("/data/upload/3/0a1b2c3d-f%20ro.jpg", _done(_region()))])
    assert label_format(tmp_path / "export.json") == "label-studio"
    (image,) = found.images
    assert (image.name, image.image_size, image.labels) == ("f ro.jpg", (200, 100), ("car",))
    assert image.boxes_px.tolist() == [[20, 50, 70, 75]]
    assert (image.box_ids[0], image.track_ids[0]) == (4, 7)
    own = _read(tmp_path, [_task("a.jpg", _done(_region(id="q3Fz_X1-hT", meta={"text": ["?"]})))])
    assert (own.images[0].box_ids[0], own.images[0].track_ids[0]) == (0, -1)


@pytest.mark.parametrize(
    ("address", "name"),
    [
        ("/data/local-files/?d=images/a.jpg", "images/a.jpg"),
        ("s3://bucket/sub/a.jpg", "sub/a.jpg"),
        ("https://host/x/a.jpg?signature=1", "x/a.jpg"),
        ("/data/local-files/?d=../../etc/passwd", "../../etc/passwd"),
        ("//[broken/a.jpg", "//[broken/a.jpg"),
    ],
)
def test_images_are_named_by_their_address(address: str, name: str, tmp_path: Path) -> None:
    assert _read(tmp_path, [_task(address, _done())]).images[0].name == name


def test_the_newest_annotation_counts_and_skipped_ones_do_not(tmp_path: Path) -> None:
    task = _task(
        "a.jpg",
        _done(_region("old"), updated_at="2026-01-01T00:00:00Z", id=9),
        _done(_region("new"), updated_at="2026-01-02T00:00:00Z", id=3),
        _done(_region("skipped"), updated_at="2026-01-03T00:00:00Z", was_cancelled=True),
    )
    nobody = _task("b.jpg") | {"predictions": [{"result": [_region()]}]}
    found = _read(tmp_path, [task, nobody])
    assert [image.labels for image in found.images] == [("new",)]
    assert found.dropped == {
        "older annotations of a task": 1,
        "tasks that nobody has annotated": 1,
    }


def test_regions_that_are_no_boxes_are_counted(tmp_path: Path) -> None:
    turned, two, sizeless = _region(), _region(), _region()
    turned["value"] = turned["value"] | {"rotation": 12.5}
    two["value"] = two["value"] | {"rectanglelabels": ["a", "b"]}
    sizeless["original_width"] = 1e400
    other = {"type": "choices", "value": {"choices": ["x"]}}
    broken = _region() | {"value": _region()["value"] | {"x": None}}
    found = _read(tmp_path, [_task("a.jpg", _done(turned, two, sizeless, other, broken, 3))])
    assert len(found.images[0]) == 0
    assert found.dropped == {
        "turned boxes": 1,
        "regions without one label": 1,
        "regions without the size of the image": 1,
        "regions that are no boxes with a label": 1,
        "boxes that are not finite": 1,
    }


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("{}", "no list of tasks"),
        ("[3]", "no list of tasks"),
        ('[{"a": 1}]', "no tasks"),
        ("[" * 100_000, "is not JSON"),
        ("[1" + "0" * 5_000 + "]", "is not JSON"),
        ('[{"data": {}, "annotations": [{"result": []}]}]', "names no image"),
        ('[{"data": 3, "annotations": [{"result": []}]}]', "names no image"),
        ('[{"data": {"image": "a"}, "annotations": [{}]}, '
         '{"data": {"image": "a"}, "annotations": [{"id": {}}]}]', "two tasks"),
    ],
)  # fmt: skip
def test_hostile_json_is_an_error(text: str, what: str, tmp_path: Path) -> None:
    path = tmp_path / "tasks.json"
    path.write_text(text)
    with pytest.raises(InputError, match=what):
        read_label_studio(path)


def test_files_too_large_are_not_read(tmp_path: Path) -> None:
    for name, read in (("a.xml", read_cvat), ("a.json", read_label_studio)):
        with (tmp_path / name).open("wb") as file:
            file.truncate((1 << 30) + 1)
        with pytest.raises(InputError, match="larger than 1 GiB"):
            read(tmp_path / name)


def test_tools_of_labellers_hold_no_detections(tmp_path: Path) -> None:
    path = _xml(tmp_path, _image(""))
    with pytest.raises(UsageError, match="labels, not detections"):
        read_detections(path, "cvat", read_cvat(path))
