"""Laws of the label readers: what was written comes back, and a format changes no score."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from percept.core.labels import ANY_LABEL, LabelledImage, LabelSet
from percept.datasets.labels import LabelFormat, label_format, read_detections, read_labels
from percept.datasets.labels.image_size import image_file_size
from percept.evaluation.boxes_2d import score_boxes, scores_as_json

_SIZE = (1241, 375)
_CLASSES = ("car", "traffic light", "deer")
_Write = Callable[[Path, Sequence[LabelledImage]], Path]


def _random_images(seed: int, *, scored: bool, count: int = 15) -> list[LabelledImage]:
    rng = np.random.default_rng(seed)
    images = []
    for k in range(count):
        boxes = int(rng.integers(0, 7))
        corner = rng.uniform((0, 0), (1100, 300), (boxes, 2))
        far = corner + rng.uniform(5, 70, (boxes, 2))
        images.append(
            LabelledImage.of(
                f"front/{1_700_000_000_000_000_000 + k}",
                np.column_stack([corner, far]),
                [_CLASSES[i] for i in rng.integers(0, 3, boxes)],
                rng.uniform(0.01, 1, boxes) if scored and boxes else None,
                image_size=_SIZE,
            )
        )
    return images


def _detected(truth: Sequence[LabelledImage], seed: int) -> list[LabelledImage]:
    """Return the boxes of the labels, moved a little, with confidences, and some more."""
    rng = np.random.default_rng(seed)
    images = []
    for labelled, more in zip(truth, _random_images(seed + 1, scored=True), strict=True):
        moved = labelled.boxes_px + rng.normal(0, 3, labelled.boxes_px.shape)
        boxes = np.concatenate([moved, more.boxes_px])
        images.append(
            LabelledImage.of(
                labelled.name,
                np.column_stack([boxes[:, :2], np.maximum(boxes[:, 2:], boxes[:, :2] + 1)]),
                (*labelled.labels, *more.labels),
                rng.uniform(0.01, 1, len(boxes)) if len(boxes) else None,
                image_size=_SIZE,
            )
        )
    return images


def _rows(image: LabelledImage) -> list[tuple[str, list[float], float | None]]:
    confidences = [None] * len(image) if image.confidences is None else image.confidences.tolist()
    return list(zip(image.labels, image.boxes_px.tolist(), confidences, strict=True))


def _write_coco(folder: Path, images: Sequence[LabelledImage]) -> Path:
    annotations = [
        {
            "id": 0, "image_id": k, "category_id": 10 + _CLASSES.index(label), "iscrowd": 0,
            "bbox": [x1, y1, x2 - x1, y2 - y1],
            **({} if confidence is None else {"score": confidence}),
        }
        for k, image in enumerate(images)
        for label, (x1, y1, x2, y2), confidence in _rows(image)
    ]  # fmt: skip
    for number, annotation in enumerate(annotations):
        annotation["id"] = number
    path = folder / "instances.json"
    path.write_text(
        json.dumps(
            {
                "images": [
                    {"id": k, "file_name": f"{i.name}.jpg", "width": _SIZE[0], "height": _SIZE[1]}
                    for k, i in enumerate(images)
                ],
                "categories": [{"id": 10 + k, "name": name} for k, name in enumerate(_CLASSES)],
                "annotations": annotations,
            }
        )
    )
    return path


def _write_yolo(folder: Path, images: Sequence[LabelledImage]) -> Path:
    (folder / "data.yaml").write_text(yaml.safe_dump({"names": dict(enumerate(_CLASSES))}))
    for image in images:
        path = folder / "labels" / f"{image.name}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = []
        for label, (x1, y1, x2, y2), confidence in _rows(image):
            shares = [(x1 + x2) / 2 / _SIZE[0], (y1 + y2) / 2 / _SIZE[1],
                      (x2 - x1) / _SIZE[0], (y2 - y1) / _SIZE[1]]  # fmt: skip
            shares += [] if confidence is None else [confidence]
            lines.append(" ".join(map(str, (_CLASSES.index(label), *shares))))
        path.write_text("\n".join(lines))
        picture = folder / "images" / f"{image.name}.png"
        picture.parent.mkdir(parents=True, exist_ok=True)
        picture.write_bytes(_png_header(*_SIZE))
    return folder


def _png_header(width: int, height: int) -> bytes:
    """Return the first chunk of a PNG and nothing else: the pixels must not be needed."""
    body = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + body + struct.pack(">I", zlib.crc32(body))


def _write_kitti(folder: Path, images: Sequence[LabelledImage]) -> Path:
    labels = folder / "training" / "label_2"
    labels.mkdir(parents=True)
    for image in images:
        lines = [
            f"{label.replace(' ', '_')} 0 0 -10 {' '.join(map(str, box))} -1 -1 -1 "
            f"-1000 -1000 -1000 -10{'' if confidence is None else f' {confidence}'}"
            for label, box, confidence in _rows(image)
        ]
        (labels / f"{image.name.split('/')[-1]}.txt").write_text("\n".join(lines))
    return folder


def _write_parquet(folder: Path, images: Sequence[LabelledImage]) -> Path:
    rows = []
    for image in images:
        camera, stamp_ns = image.name.split("/")
        rows += [
            {
                "stamp_ns": int(stamp_ns), "camera": camera, "label": label,
                "x1_px": box[0], "y1_px": box[1], "x2_px": box[2], "y2_px": box[3],
                **({} if confidence is None else {"confidence": confidence}),
            }
            for label, box, confidence in _rows(image)
        ]  # fmt: skip
    pq.write_table(pa.Table.from_pylist(rows), folder / "detections_2d.parquet")
    names = [image.name.split("/") for image in images]
    listed = {"stamp_ns": [int(s) for _, s in names], "camera": [c for c, _ in names]}
    pq.write_table(pa.table(listed), folder / "images_2d.parquet")
    return folder


_WRITERS: dict[LabelFormat, _Write] = {
    "coco": _write_coco,
    "yolo": _write_yolo,
    "kitti": _write_kitti,
    "parquet": _write_parquet,
}


def _folder(root: Path, name: str) -> Path:
    (root / name).mkdir()
    return root / name


@pytest.mark.parametrize("scored", [False, True])
@pytest.mark.parametrize("name", _WRITERS)
def test_what_is_written_comes_back(name: LabelFormat, *, scored: bool, tmp_path: Path) -> None:
    images = _random_images(3, scored=scored)
    path = _WRITERS[name](tmp_path, images)
    assert label_format(path) == name
    read = read_labels(path, name)
    assert not read.dropped
    assert [image.name.split("/")[-1].removesuffix(".jpg") for image in read.images] == [
        image.name.split("/")[-1] for image in images
    ]
    for ours, theirs in zip(images, read.images, strict=True):
        assert tuple(label.replace("_", " ") for label in theirs.labels) == ours.labels
        np.testing.assert_allclose(theirs.boxes_px, ours.boxes_px, atol=1e-9)
        assert not theirs.ignore.any()
        if ours.confidences is None:
            assert theirs.confidences is None
        else:
            assert theirs.confidences is not None
            np.testing.assert_array_equal(theirs.confidences, ours.confidences)
        if name in ("coco", "yolo"):
            assert theirs.image_size == _SIZE


@pytest.mark.parametrize(("ours", "theirs"), list(product(_WRITERS, _WRITERS)))
def test_a_format_changes_no_score(ours: LabelFormat, theirs: LabelFormat, tmp_path: Path) -> None:
    images = [_named(image) for image in _random_images(5, scored=False)]
    detections = [_named(image) for image in _detected(images, 6)]
    plain = score_boxes(LabelSet(tuple(images)), LabelSet(tuple(detections)))
    truth = read_labels(_WRITERS[ours](_folder(tmp_path, "a"), images), ours)
    found = read_detections(_WRITERS[theirs](_folder(tmp_path, "b"), detections), theirs, truth)
    expected, document = scores_as_json(plain), scores_as_json(score_boxes(truth, found))
    assert 0.1 < document["ap50"] < 0.9
    for key in ("images", "ap", "ap50", "ap75", "ar", "by_class", "by_size", "by_height"):
        assert document[key] == expected[key], key
    assert document["confusions"] == expected["confusions"]
    assert document["mistakes"] == expected["mistakes"]
    assert document["ap50_interval"] == expected["ap50_interval"]


def _named(image: LabelledImage) -> LabelledImage:
    """Return an image whose classes can be written in all formats: KITTI's have no spaces."""
    labels = tuple("deer" if label == "traffic light" else label for label in image.labels)
    return LabelledImage.of(
        image.name, image.boxes_px, labels, image.confidences, image_size=image.image_size
    )


def test_results_of_coco_get_their_names_from_the_labels(tmp_path: Path) -> None:
    images = _random_images(7, scored=False)
    detections = _detected(images, 8)
    truth = read_labels(_write_coco(tmp_path, images), "coco")
    results = [
        {"image_id": k, "category_id": 10 + _CLASSES.index(label), "score": score,
         "bbox": [x1, y1, x2 - x1, y2 - y1]}
        for k, image in enumerate(detections)
        for label, (x1, y1, x2, y2), score in _rows(image)
    ]  # fmt: skip
    path = tmp_path / "results.json"
    path.write_text(json.dumps(results))
    found = read_detections(path, "coco", truth)
    assert scores_as_json(score_boxes(truth, found)) == scores_as_json(
        score_boxes(truth, LabelSet(tuple(detections), complete=False))
    ) | {"worst_images": scores_as_json(score_boxes(truth, found))["worst_images"]}


def test_yolo_detections_borrow_names_and_sizes_from_the_labels(tmp_path: Path) -> None:
    """A detector that saves its boxes writes label files and nothing beside them."""
    images = _random_images(9, scored=False)
    truth = read_labels(_write_yolo(_folder(tmp_path, "a"), images), "yolo")
    bare = _write_yolo(_folder(tmp_path, "b"), _detected(images, 10)) / "labels"
    (bare.parent / "data.yaml").unlink()
    for picture in (bare.parent / "images").rglob("*.png"):
        picture.unlink()
    found = read_detections(bare, "yolo", truth)
    scores = score_boxes(truth, found)
    assert scores.average.ap50 > 0.5
    assert any("taken for those of the labels" in note for note in scores.notes)


def test_coco_crowds_and_kitti_dont_care_are_regions(tmp_path: Path) -> None:
    coco = {
        "images": [{"id": 1, "file_name": "a.jpg"}],
        "categories": [{"id": 1, "name": "car"}],
        "annotations": [
            {"id": 1, "image_id": 1, "category_id": 1, "bbox": [0, 0, 9, 9], "iscrowd": 1}
        ],
    }
    (tmp_path / "a.json").write_text(json.dumps(coco))
    (image,) = read_labels(tmp_path / "a.json", "coco").images
    assert (image.labels, image.ignore.tolist(), image.image_size) == (("car",), [True], None)
    (tmp_path / "label_2").mkdir()
    (tmp_path / "label_2" / "a.txt").write_text(
        "Car 0 0 0 10 10 50 40 1.5 1.6 4 3 1.5 4 0\n"
        "DontCare -1 -1 -10 500 160 590 190 -1 -1 -1 -1000 -1000 -1000 -10\n"
    )
    (image,) = read_labels(tmp_path, "kitti").images
    assert image.labels == ("Car", ANY_LABEL)
    assert image.ignore.tolist() == [False, True]
    np.testing.assert_allclose(image.range_m, [5.0, np.nan])


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp"])
def test_image_sizes_are_those_that_opencv_decodes(suffix: str, tmp_path: Path) -> None:
    for width, height in ((1, 1), (640, 399), (17, 1000)):
        path = tmp_path / f"a{suffix}"
        assert cv2.imwrite(str(path), np.zeros((height, width, 3), np.uint8))
        assert image_file_size(path) == (width, height)


def test_image_sizes_of_real_images(shared_data: Path) -> None:
    files = [
        *sorted(shared_data.glob("yolo/images/*.jpg")),
        *sorted(shared_data.glob("scenes/kitti_*/**/*.png")),
        *sorted(shared_data.glob("intrinsics/*/*.jpg"))[::7],
        *sorted(shared_data.glob("camera_lidar/acfr_vlp/images/*.jpg"))[:2],
    ]
    assert len(files) > 5
    for file in files:
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert image is not None
        assert image_file_size(file) == (image.shape[1], image.shape[0]), file.name


def test_image_sizes_of_rarer_headers(tmp_path: Path) -> None:
    """A JPEG whose Huffman tables come before its frame, and a BMP stored from the top."""
    frame = b"\xff\xc2" + struct.pack(">HBHHB", 17, 8, 30, 40, 3) + bytes(9)
    tables = b"\xff\xc4" + struct.pack(">HBHH", 7, 0, 9, 9) + b"\xff\xff\xff"
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8" + tables[:-1] + frame)
    assert image_file_size(tmp_path / "a.jpg") == (40, 30)
    (tmp_path / "a.bmp").write_bytes(b"BM" + bytes(16) + struct.pack("<ii", 40, -30))
    assert image_file_size(tmp_path / "a.bmp") == (40, 30)


def test_image_sizes_that_cannot_be_told(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    _, jpeg = cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))
    whole = [bytes(jpeg), _png_header(8, 8)]
    for content in [b"", b"GIF89a", _png_header(0, 8), _png_header(2**31, 8), b"\xff\xd8" * 20]:
        path.write_bytes(content)
        assert image_file_size(path) is None
    for content in whole:
        for end in range(0, min(len(content), 160), 3):
            path.write_bytes(content[:end])
            assert image_file_size(path) in (None, (8, 8))
    assert image_file_size(tmp_path / "missing.png") is None
