"""Label files that are broken, hostile or not what they seem: one line, or a count."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from percept.core.errors import InputError, UsageError
from percept.core.labels import LabelledImage, LabelSet
from percept.datasets.labels import LabelFormat, label_format, read_detections, read_labels

_KITTI = "Car 0 0 0 {} 1.5 1.6 4 3 1.5 4 0"


def _coco(**changes: Any) -> dict[str, Any]:
    annotation = {"id": 1, "image_id": 1, "category_id": 1, "bbox": [1, 2, 30, 40], "iscrowd": 0}
    return {
        "images": [{"id": 1, "file_name": "a.jpg", "width": 640, "height": 400}],
        "categories": [{"id": 1, "name": "car"}],
        "annotations": [annotation],
        **changes,
    }


def _annotated(**changes: Any) -> dict[str, Any]:
    """Return a document with a sound annotation and one with these changes."""
    document = _coco()
    document["annotations"] += [{**document["annotations"][0], "id": 2, **changes}]
    return document


def _read_coco(folder: Path, document: object) -> LabelSet:
    path = folder / "a.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return read_labels(path, "coco")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"image_id": 7}, "annotations of an image that is not listed"),
        ({"image_id": None}, "annotations of an image that is not listed"),
        ({"image_id": [1]}, "annotations of an image that is not listed"),
        ({"category_id": 9}, "annotations of a category that is not listed"),
        ({"bbox": None}, "annotations without a box"),
        ({"bbox": [1, 2, 3]}, "annotations without a box"),
        ({"bbox": {"x": 1}}, "annotations without a box"),
        ({"bbox": ["1", 2, 3, 4]}, "boxes that are not finite"),
        ({"bbox": [float("nan"), 2, 3, 4]}, "boxes that are not finite"),
        ({"bbox": [10**400, 2, 3, 4]}, "boxes that are not finite"),
        ({"bbox": [True, 2, 3, 4]}, "boxes that are not finite"),
        ({"bbox": [1, 2, -30, 40]}, "boxes of negative or no size"),
        ({"bbox": [1, 2, 30, 0]}, "boxes of negative or no size"),
        ({"bbox": [1, 2, 1e9, 40]}, "boxes beyond a million pixels"),
    ],
)
def test_a_bad_annotation_is_counted_and_the_rest_kept(
    changes: dict[str, Any], reason: str, tmp_path: Path
) -> None:
    labels = _read_coco(tmp_path, _annotated(**changes))
    assert labels.dropped == {reason: 1}
    assert labels.images[0].boxes_px.tolist() == [[1, 2, 31, 42]]


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ("", "is not JSON"),
        ("{", "is not JSON"),
        ('{"a":' * 100_000, "is not JSON"),
        ('{"images": ' + "9" * 5000 + "}", "is not JSON"),
        ("3", "holds no COCO instances"),
        ({}, "no list 'images'"),
        (_coco(images=[3]), "no list 'images'"),
        (_coco(annotations={}), "no list 'annotations'"),
        (_coco(images=[{"file_name": "a.jpg"}]), "is no id"),
        (_coco(images=[{"id": "one", "file_name": "a.jpg"}]), "is no id"),
        (_coco(images=[{"id": 1, "file_name": "a"}, {"id": 1, "file_name": "b"}]), "two images"),
        (_coco(images=[{"id": 1, "file_name": "a"}, {"id": 2, "file_name": "a"}]), "two images"),
        (_coco(images=[{"id": 1, "file_name": "../../etc/x.jpg"}]), "leads out of the data set"),
        (_coco(images=[{"id": 1, "file_name": "..\\..\\x.jpg"}]), "leads out of the data set"),
        (_coco(images=[{"id": 1, "file_name": 3}]), "no file name"),
        (_coco(categories=[{"id": 1, "name": "a"}, {"id": 1, "name": "b"}]), "two categories"),
        (_coco(categories=[{"id": 1}]), "category 1 has no name"),
        (_annotated(score=0.5), "some boxes have a confidence"),
        (_annotated(score=98.3), "not in 0..1"),
    ],
)
def test_a_bad_document_is_refused_in_one_line(
    document: object, message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        _read_coco(tmp_path, document)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_odd_but_usable_coco(tmp_path: Path) -> None:
    document = _coco(
        images=[
            {"id": 0, "file_name": "/data/x.jpg", "width": 10**9, "height": 400},
            {"id": 5},
        ],
        annotations=[
            {"id": 3, "image_id": 0, "category_id": 1, "bbox": [1, 2, 3, 4]},
            {"id": 3, "image_id": 5, "category_id": 1, "bbox": [1, 2, 3, 4]},
        ],
    )
    labels = _read_coco(tmp_path, document)
    assert [image.name for image in labels.images] == ["data/x.jpg", "5"]
    assert [len(image) for image in labels.images] == [1, 1]
    assert labels.dropped == {"image sizes that cannot be": 1}
    assert labels.notes == ("1 annotation ids come more than once",)


def test_results_need_instances_and_are_no_labels(tmp_path: Path) -> None:
    results = [
        {"image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4], "score": 0.5},
        {"image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4]},
        {"image_id": 2, "category_id": 1, "bbox": [1, 2, 3, 4], "score": 0.5},
    ]
    path = tmp_path / "results.json"
    path.write_text(json.dumps(results))
    with pytest.raises(InputError, match="not labels"):
        read_labels(path, "coco")
    with pytest.raises(InputError, match="Give the COCO file of instances"):
        read_detections(path, "coco", LabelSet(()))
    found = read_detections(path, "coco", _read_coco(tmp_path, _coco()))
    assert [len(image) for image in found.images] == [1]
    assert found.dropped == {
        "boxes that are not finite": 1,
        "annotations of an image that is not listed": 1,
    }


def _yolo(folder: Path, lines: str, names: str = "names: [car, deer]") -> Path:
    (folder / "labels").mkdir()
    (folder / "labels" / "a.txt").write_text(lines)
    (folder / "data.yaml").write_text(names)
    return folder


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("0 0.5 0.5 0.1", "line 1 has 4 columns"),
        ("\n0 0.5 0.5 0.1 0.1 0.9 7", "line 2 has 7 columns"),
        ("0 " + "0.5 " * 8, "Polygons"),
        ("car 0.5 0.5 0.1 0.1", "beginning with 'car'"),
        ("-1 0.5 0.5 0.1 0.1", "beginning with '-1'"),
        ("0 0.5 x 0.1 0.1", "line 1: could not convert"),
        ("2 0.5 0.5 0.1 0.1", "class 2, and there are names of 2"),
        ("0 320 200 40 30", "is in pixels"),
        ("0 0.5 0.5 0.1 0.1 7", "not in 0..1"),
        ("0 0.5 0.5 0.1 0.1 0.3\n0 0.5 0.5 0.1 0.1", "some boxes have a confidence"),
        ("\x00\x01\x02", "beginning with"),
    ],
)
def test_bad_yolo_lines_are_refused(lines: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_labels(_yolo(tmp_path, lines), "yolo", image_size=(640, 400))
    assert "\n" not in str(caught.value)


def test_confidences_in_some_images_only_are_refused(tmp_path: Path) -> None:
    path = _yolo(tmp_path, "0 0.5 0.5 0.1 0.1 0.9")
    (path / "labels" / "b.txt").write_text("0 0.5 0.5 0.1 0.1")
    with pytest.raises(InputError, match="some images have confidences"):
        read_detections(path, "yolo", LabelSet(()), image_size=(640, 400))


def test_yolo_trees_keep_their_folders_in_the_names(tmp_path: Path) -> None:
    for name in ("train/a", "val/a"):
        file = tmp_path / "labels" / f"{name}.txt"
        file.parent.mkdir(parents=True)
        file.write_text("0 0.5 0.5 0.1 0.1")
    (tmp_path / "data.yaml").write_text("names: [car]")
    names = [image.name for image in read_labels(tmp_path, "yolo", image_size=(9, 9)).images]
    assert names == ["train/a", "val/a"]
    below = read_labels(tmp_path / "labels" / "val", "yolo", image_size=(9, 9))
    assert [image.name for image in below.images] == ["a"]


def test_the_size_that_is_passed_is_of_images_that_are_not_there(tmp_path: Path) -> None:
    path = _yolo(tmp_path, "0 0.5 0.5 0.1 0.1 0.9")
    known = LabelSet((LabelledImage.of("a", image_size=(300, 200)),))
    for size in ((300, 200), (100, 50)):  # that of the labels, then that of the image itself
        (image,) = read_detections(path, "yolo", known, image_size=(640, 400)).images
        assert image.image_size == size
        (path / "images").mkdir(exist_ok=True)
        assert cv2.imwrite(str(path / "images" / "a.png"), np.zeros((50, 100), np.uint8))
    (image,) = read_detections(path / "labels", "yolo", LabelSet(())).images
    assert image.image_size == (100, 50)


def test_bad_yolo_boxes_are_counted(tmp_path: Path) -> None:
    lines = "0 0.5 0.5 0.1 0.1\n0 nan 0.5 0.1 0.1\n1 0.5 0.5 -0.1 0.1\n1 0.5 0.5 0 0.1\n"
    labels = read_labels(_yolo(tmp_path, lines), "yolo", image_size=(640, 400))
    assert labels.images[0].boxes_px.tolist() == [[288, 180, 352, 220]]
    assert labels.dropped == {"boxes that are not finite": 1, "boxes of negative or no size": 2}


def test_yolo_without_a_size_says_how_to_give_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--image-size WxH"):
        read_labels(_yolo(tmp_path, "0 0.5 0.5 0.1 0.1"), "yolo")
    (tmp_path / "labels" / "a.txt").write_text("")
    assert len(read_labels(tmp_path, "yolo").images[0]) == 0  # no box, no size needed


@pytest.mark.parametrize("names", ["", "names: 3", "names: [1, 2]", "names: {a: b}", "x: ["])
def test_bad_class_names_are_refused(names: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"data\.yaml"):
        read_labels(_yolo(tmp_path, "0 0.5 0.5 0.1 0.1", names), "yolo", image_size=(640, 400))


def test_class_names_are_found_beside_or_above(tmp_path: Path) -> None:
    _yolo(tmp_path, "1 0.5 0.5 0.1 0.1")
    for path in (tmp_path, tmp_path / "labels"):
        assert read_labels(path, "yolo", image_size=(64, 40)).images[0].labels == ("deer",)
    (tmp_path / "data.yaml").unlink()
    with pytest.raises(InputError, match="has no class names"):
        read_labels(tmp_path, "yolo", image_size=(64, 40))
    (tmp_path / "labels" / "classes.txt").write_text("car\ntraffic light\n")
    labels = read_labels(tmp_path / "labels", "yolo", image_size=(64, 40))
    assert [image.labels for image in labels.images] == [("traffic light",)]


def test_files_of_windows_are_read(tmp_path: Path) -> None:
    mark = b"\xef\xbb\xbf"
    path = _yolo(tmp_path, "")
    (path / "data.yaml").unlink()
    (path / "classes.txt").write_bytes(mark + b"car\r\ndeer\r\n\r\n")
    (path / "labels" / "a.txt").write_bytes(mark + b"1 0.5 0.5 0.1 0.1\r\n0 0.5 0.5 0.2 0.2\r\n")
    (path / "labels" / "b.TXT").write_bytes(b"1 0.5 0.5 0.1 0.1")
    truth = read_labels(path, "yolo", image_size=(640, 400))
    assert [image.labels for image in truth.images] == [("deer", "car"), ("deer",)]
    instances, results = tmp_path / "instances.json", tmp_path / "results.json"
    instances.write_bytes(mark + json.dumps(_coco()).encode())
    one = {"image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4], "score": 0.5}
    results.write_bytes(mark + json.dumps([one]).encode())
    found = read_detections(results, "coco", read_labels(instances, "coco"))
    assert [len(image) for image in found.images] == [1]


@pytest.mark.parametrize("names", ["\ncar\ndeer\n", "car\n\ndeer\n", "\n"])
def test_lines_between_class_names_may_be_classes_too(names: str, tmp_path: Path) -> None:
    path = _yolo(tmp_path, "0 0.5 0.5 0.1 0.1")
    (path / "data.yaml").unlink()
    (path / "classes.txt").write_text(names)
    with pytest.raises(InputError, match=r"classes\.txt: has (empty lines|no class names)"):
        read_labels(path, "yolo", image_size=(640, 400))


def test_numbers_of_coco_categories_do_not_name_the_classes_of_yolo(tmp_path: Path) -> None:
    path = _yolo(tmp_path, "1 0.5 0.5 0.1 0.1 0.9")
    (path / "data.yaml").unlink()
    with pytest.raises(InputError, match="has no class names"):
        read_detections(path, "yolo", _read_coco(tmp_path, _coco()), image_size=(640, 400))


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("0 1 " + _KITTI.format("1 2 3 4"), "has 17 columns beginning with '0'"),
        ("Car 0 0 0", "has 4 columns"),
        (_KITTI.format("1 2 3 y"), "line 1: could not convert"),
        (_KITTI.format("1 2 3 4") + " 7.5", "not in 0..1"),
    ],
)
def test_bad_kitti_lines_are_refused(lines: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(lines)
    with pytest.raises(InputError, match=message):
        read_labels(tmp_path, "kitti")


def test_bad_kitti_boxes_are_counted(tmp_path: Path) -> None:
    boxes = ("1 2 30 40", "nan 2 30 40", "30 2 1 40", "inf 2 3 4")
    (tmp_path / "a.txt").write_text("\n".join(map(_KITTI.format, boxes)))
    labels = read_labels(tmp_path, "kitti")
    assert len(labels.images[0]) == 1
    assert labels.dropped == {"boxes that are not finite": 2, "boxes of negative or no size": 1}


_ROW = {
    "stamp_ns": 5, "camera": "front", "model": "a", "label": "car", "confidence": 0.5,
    "x1_px": 1.0, "y1_px": 2.0, "x2_px": 30.0, "y2_px": 40.0, "primary": True,
}  # fmt: skip


def _table(folder: Path, *rows: dict[str, Any]) -> Path:
    pq.write_table(pa.Table.from_pylist(list(rows)), folder / "detections_2d.parquet")
    return folder


def test_boxes_of_several_networks(tmp_path: Path) -> None:
    rows = [_ROW, {**_ROW, "model": "b", "primary": False}, {**_ROW, "model": "b", "stamp_ns": 6}]
    run = _table(tmp_path, *rows)
    both = read_labels(run, "parquet")
    assert [image.name for image in both.images] == ["front/5", "front/6"]
    assert not both.complete
    assert "1 that another model found" in both.notes[0]
    alone = read_detections(run, "parquet", LabelSet(()), model="b")
    assert [len(image) for image in alone.images] == [1, 1]
    with pytest.raises(UsageError, match="no model 'c'"):
        read_detections(run, "parquet", LabelSet(()), model="c")


def test_images_that_were_looked_at_are_known_by_network(tmp_path: Path) -> None:
    run = _table(tmp_path, _ROW)
    listed = pa.table(
        {
            "stamp_ns": [5, 6, 6, 7],
            "camera": ["front"] * 4,
            "model": ["a", "a", "b", None],
            "failure": [None, None, None, "a broken JPEG"],
        }
    )
    pq.write_table(listed, tmp_path / "images_2d.parquet")
    found = read_detections(run, "parquet", LabelSet(()))
    assert found.complete
    assert [(image.name, len(image)) for image in found.images] == [("front/5", 1), ("front/6", 0)]
    found = read_detections(run, "parquet", LabelSet(()), model="a")
    assert [image.name for image in found.images] == ["front/5", "front/6"]


def test_a_network_that_found_nothing_is_known(tmp_path: Path) -> None:
    run = _table(tmp_path, _ROW)
    looks = {"stamp_ns": [5, 5], "camera": ["front"] * 2, "model": ["a", "b"]}
    pq.write_table(pa.table(looks), tmp_path / "images_2d.parquet")
    found = read_detections(run, "parquet", LabelSet(()), model="b")
    assert [(image.name, len(image)) for image in found.images] == [("front/5", 0)]
    with pytest.raises(UsageError, match=r"Models: \['a', 'b'\]"):
        read_detections(run, "parquet", LabelSet(()), model="c")


def test_images_that_cannot_be_told_apart_are_left_out(tmp_path: Path) -> None:
    run = _table(tmp_path, _ROW, {**_ROW, "stamp_ns": 6}, {**_ROW, "stamp_ns": 7})
    looks = {"stamp_ns": [5, 6, 6, 6], "camera": ["front"] * 4, "model": ["a", "a", "b", "a"]}
    pq.write_table(pa.table(looks), tmp_path / "images_2d.parquet")
    for model, names in ((None, ["front/5"]), ("a", ["front/5"]), ("b", ["front/6"])):
        found = read_detections(run, "parquet", LabelSet(()), model=model)
        assert [image.name for image in found.images] == names
        assert found.dropped == ({} if model == "b" else {
            "images with the camera and the stamp of another": 1,
            "boxes in images that images_2d.parquet does not list": 2,
        })  # fmt: skip


def test_bad_rows_are_counted(tmp_path: Path) -> None:
    rows = [_ROW, {**_ROW, "label": None}, {**_ROW, "x1_px": float("nan")},
            {**_ROW, "x1_px": None}, {**_ROW, "x2_px": -5.0}]  # fmt: skip
    found = read_labels(_table(tmp_path, *rows), "parquet")
    assert len(found.images[0]) == 1
    assert found.dropped == {
        "rows without a stamp, camera or label": 1,
        "boxes that are not finite": 2,
        "boxes of negative or no size": 1,
    }


def test_distances_that_cannot_be_are_unknown(tmp_path: Path) -> None:
    rows = [{**_ROW, "range_m": range_m} for range_m in (7.5, -1.0, None, float("inf"))]
    (image,) = read_labels(_table(tmp_path, *rows), "parquet").images
    assert image.range_m[0] == 7.5
    assert np.isnan(image.range_m[1:]).all()


def test_bad_tables_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "detections_2d.parquet"
    path.write_bytes(b"PAR1 and no more")
    with pytest.raises(InputError, match="cannot be read as Parquet") as caught:
        read_labels(path, "parquet")
    assert "\n" not in str(caught.value)
    _table(tmp_path, {"stamp_ns": 1, "camera": "a"})
    with pytest.raises(InputError, match="no column label, x1_px"):
        read_labels(path, "parquet")
    for column, value in (("stamp_ns", "now"), ("label", 3), ("model", 1.5), ("primary", "yes")):
        _table(tmp_path, {**_ROW, column: value})
        with pytest.raises(InputError, match=f"{column} has the wrong type"):
            read_labels(path, "parquet")


def _text(content: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / "a.txt").write_text(content)
        return folder

    return write


def _run_without_boxes(folder: Path) -> Path:
    (folder / "run.json").write_text("{}")
    return folder


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (_text(_KITTI.format("1 2 3 4")), "kitti"),
        (_text("0 0.5 0.5 0.1 0.1"), "yolo"),
        (lambda folder: _yolo(folder, "0 0.5 0.5 0.1 0.1 0.9"), "yolo"),
        (lambda folder: _table(folder, _ROW), "parquet"),
        (lambda folder: _table(folder, _ROW) / "detections_2d.parquet", "parquet"),
        (_text("hello"), "none of the known formats"),
        (_text(""), "none of the known formats"),
        (lambda folder: folder / "missing", "does not exist"),
        (_run_without_boxes, "without 2D boxes"),
    ],
)
def test_formats_are_told_by_looking(
    make: Callable[[Path], Path], expected: LabelFormat | str, tmp_path: Path
) -> None:
    path = make(tmp_path)
    if expected in ("kitti", "yolo", "parquet"):
        assert label_format(path) == expected
    else:
        with pytest.raises(InputError, match=expected):
            label_format(path)


@pytest.mark.parametrize("name", ["coco", "yolo", "kitti", "parquet"])
def test_a_folder_with_nothing_and_a_missing_one_are_refused(
    name: LabelFormat, tmp_path: Path
) -> None:
    (tmp_path / "data.yaml").write_text("names: [car]")
    for path in (tmp_path, tmp_path / "missing"):
        with pytest.raises(InputError) as caught:
            read_labels(path, name)
        assert "\n" not in str(caught.value)
