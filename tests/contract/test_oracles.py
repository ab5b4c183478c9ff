"""Exports as independent programs read them: images, classes and 2D boxes are those of the set.

What is in 3D is in `test_oracles_solid`.
"""

from __future__ import annotations

import csv
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np
import pytest
from independent_readers import read_with
from made_labelled_set import SIZE, make_labelled_set
from numpy.typing import NDArray
from renamed_labelled_set import HARD_NAMES, renamed

from percept.datasets.labelling.formats import ExportFormat, export
from percept.datasets.labelling.labelled_set import Keyframe, LabelledFrame, LabelledSet

_TOLERANCE_PX = 0.01
# Without control characters: XML has none, and the exporters' own tests say what becomes of them.
_NAMES = (*HARD_NAMES[:2], "車 é 😀")
_TRACKEVAL_CLASSES = {"car": 1, "pedestrian": 4, "misc": 8}
_Boxes = list[tuple[str, list[float]]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    return renamed(make_labelled_set(tmp_path_factory.mktemp("made") / "set"), _NAMES)


@dataclass(frozen=True)
class _Kind:
    """How one format is read: by what name, where, and how it names images and classes."""

    reader: str
    folder: str = "."
    name: Callable[[LabelledFrame], str] = lambda frame: frame.stem
    label: Callable[[str], str] = str
    split: Callable[[Keyframe], str] = lambda keyframe: keyframe.split
    rectified: bool = False


_KINDS: dict[ExportFormat, _Kind] = {
    "coco": _Kind("coco"),
    "yolo": _Kind("yolo"),
    "cvat": _Kind("cvat", folder="images"),
    "kitti": _Kind(
        "kitti",
        name=lambda frame: f"{frame.frame:06d}",
        label=lambda label: "_".join(label.split()),
        split=lambda _: "training",
        rectified=True,
    ),
}


@pytest.mark.parametrize("name", _KINDS)
def test_datumaro_reads_the_same_images_and_boxes(
    made: LabelledSet, tmp_path: Path, name: ExportFormat
) -> None:
    kind = _KINDS[name]
    export(made, name, tmp_path / name)
    (items,) = read_with("read_datumaro.py", kind.reader, tmp_path / name / kind.folder)
    found = {item["name"]: item for item in items}
    wanted = {kind.name(frame): (keyframe, frame) for keyframe, frame in made.frames()}
    assert len(items) == len(found)
    assert set(found) == set(wanted)
    for key, (keyframe, frame) in wanted.items():
        item = found[key]
        file = frame.rectified_file if kind.rectified else frame.file
        assert file is not None
        assert Path(item["file"]).samefile(made.folder / file)
        assert tuple(item["size"]) == SIZE
        assert item["split"] == kind.split(keyframe)
        boxes = [_box(made, keyframe, frame, row, kind) for row in range(len(frame.boxes))]
        _same_boxes([(one["label"], one["box"]) for one in item["boxes"]], boxes)


def test_coco_keeps_the_numbers_tracks_and_sources_of_boxes(
    made: LabelledSet, tmp_path: Path
) -> None:
    export(made, "coco", tmp_path / "coco")
    (items,) = read_with("read_datumaro.py", "coco", tmp_path / "coco")
    found = {item["name"]: {box["id"]: box for box in item["boxes"]} for item in items}
    for _, frame in made.frames():
        boxes = frame.boxes
        assert set(found[frame.stem]) == set(boxes.ids.tolist())
        for row, number in enumerate(boxes.ids.tolist()):
            box = found[frame.stem][number]
            assert _number(box.get("score")) == pytest.approx(boxes.confidences[row], nan_ok=True)
            assert box.get("track_id", -1) == boxes.track_ids[row]
            assert box.get("source", "") == boxes.sources[row]


def test_cvat_keeps_the_numbers_and_tracks_of_boxes(made: LabelledSet, tmp_path: Path) -> None:
    export(made, "cvat", tmp_path / "cvat")
    (items,) = read_with("read_datumaro.py", "cvat", tmp_path / "cvat" / "images")
    found = {item["name"]: {int(box["box_id"]): box for box in item["boxes"]} for item in items}
    for _, frame in made.frames():
        boxes = frame.boxes
        assert set(found[frame.stem]) == set(boxes.ids.tolist())
        for row, number in enumerate(boxes.ids.tolist()):
            box = found[frame.stem][number]
            confidence = pytest.approx(boxes.confidences[row], abs=5e-5, nan_ok=True)
            assert _number(box.get("score")) == confidence
            assert int(box.get("object_id") or -1) == boxes.track_ids[row]
            assert box.get("model", "") == boxes.sources[row]


def test_datumaro_reads_the_same_tracks_in_cvat_videos(made: LabelledSet, tmp_path: Path) -> None:
    export(made, "cvat", tmp_path / "cvat")
    videos = sorted((tmp_path / "cvat" / "video").iterdir())
    read = read_with("read_datumaro.py", "cvat", *videos)
    found = dict(zip((video.name for video in videos), read, strict=True))
    cameras = {(keyframe.drive, frame.camera) for keyframe, frame in made.frames()}
    assert set(found) == {f"{drive}_{camera}" for drive, camera in cameras}
    for drive, camera in cameras:
        items = {item["name"]: item["boxes"] for item in found[f"{drive}_{camera}"]}
        frames = [
            frame
            for keyframe, frame in made.frames()
            if (keyframe.drive, frame.camera) == (drive, camera)
        ]
        tracks = set()
        for number, frame in enumerate(frames):
            boxes = [one for one in items.get(f"frame_{number:06d}", []) if not one["outside"]]
            _same_boxes(_found(boxes), _recorded(frame))
            tracks |= {one["track_id"] for one in boxes if one.get("object_id") == "7"}
        assert len(tracks) == 1


def test_trackeval_reads_the_same_tracks_in_kitti_sequences(
    made: LabelledSet, tmp_path: Path
) -> None:
    labelled, folder = renamed(made, list(_TRACKEVAL_CLASSES)), tmp_path / "kitti-tracking"
    export(labelled, "kitti-tracking", folder)
    with (folder / "sequences.csv").open(encoding="utf-8") as stream:
        cameras = {row["sequence"]: row for row in csv.DictReader(stream)}
    compared = 0
    for split in ("train", "val"):
        sequences = _trackeval_sequences(folder, split)
        assert sequences
        for name, found in sequences.items():
            taken = (cameras[name]["drive"], cameras[name]["camera"], split)
            frames = [
                (keyframe, frame)
                for keyframe, frame in labelled.frames()
                if (keyframe.drive, frame.camera, keyframe.split) == taken
            ]
            for number, (keyframe, frame) in enumerate(frames):
                classes = found["gt_classes"][number].tolist()
                assert classes == [_TRACKEVAL_CLASSES[one] for one in frame.boxes.labels]
                wanted = [
                    _undistorted(labelled, keyframe, frame, row) for row in range(len(frame.boxes))
                ]
                sides = np.reshape(found["gt_dets"][number], (-1, 4))
                np.testing.assert_allclose(
                    sides, np.reshape(wanted, (-1, 4)), rtol=0, atol=_TOLERANCE_PX
                )
                tracks = np.where(frame.boxes.track_ids == 7, 7, 0)
                assert np.where(found["gt_ids"][number] == 7, 7, 0).tolist() == tracks.tolist()
                compared += len(sides)
    assert compared == sum(len(frame.boxes) for _, frame in labelled.frames())


def _trackeval_sequences(folder: Path, split: str) -> dict[str, Any]:
    """Return the sequences of a split as TrackEval reads them; it lives with percept."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from trackeval.datasets import Kitti2DBox
    config = {
        "GT_FOLDER": str(folder / "training"),
        "TRACKERS_FOLDER": str(folder),
        "TRACKERS_TO_EVAL": [],
        "SPLIT_TO_EVAL": split,
        "PRINT_CONFIG": False,
    }
    read = Kitti2DBox(config)
    return {name: read._load_raw_file("", name, is_gt=True) for name in read.seq_list}


def test_label_studio_validates_the_predictions_and_reads_the_same_boxes(
    made: LabelledSet, tmp_path: Path
) -> None:
    export(made, "label-studio", tmp_path / "studio")
    read = read_with("read_label_studio.py", tmp_path / "studio")
    coco = read["coco"]
    assert read["errors"] == []
    assert read["tasks"] == len(coco["images"]) == sum(1 for _ in made.frames())
    labels = {one["id"]: one["name"] for one in coco["categories"]}
    assert set(labels.values()) == set(_NAMES)
    files = {
        one["id"]: tmp_path / "studio" / _local_file(one["file_name"]) for one in coco["images"]
    }
    found: dict[str, _Boxes] = {file.stem: [] for file in files.values()}
    for one in coco["annotations"]:
        x, y, width, height = one["bbox"]
        box = (labels[one["category_id"]], [x, y, x + width, y + height])
        found[files[one["image_id"]].stem].append(box)
    images = {file.stem: file for file in files.values()}
    for _, frame in made.frames():
        assert images[frame.stem].samefile(made.folder / frame.file)
        _same_boxes(found[frame.stem], _recorded(frame))


def test_fastparquet_reads_the_same_tables(made: LabelledSet, tmp_path: Path) -> None:
    folder = tmp_path / "parquet"
    export(made, "parquet", folder)
    files = (folder / f"{name}.parquet" for name in ("frames", "boxes_2d", "boxes_3d"))
    frames, rectangles, solids = read_with("read_parquet.py", *files)
    for row, (keyframe, frame) in zip(frames, made.frames(), strict=True):
        assert (row["frame"], row["stamp_ns"], row["split"]) == (
            frame.frame, frame.stamp_ns, keyframe.split,
        )  # fmt: skip
        assert (folder / row["file"]).samefile(made.folder / frame.file)
        assert (folder / row["rectified_file"]).is_file()
        boxes = [one for one in rectangles if one["frame"] == frame.frame]
        _same_boxes([(one["label"], _sides(one)) for one in boxes], _recorded(frame), 1e-9)
        tracks = [track if track >= 0 else None for track in frame.boxes.track_ids.tolist()]
        assert [one["track_id"] for one in boxes] == tracks
        assert [one["source"] for one in boxes] == list(frame.boxes.sources)
    columns = ("x", "y", "z", "length", "width", "height", "yaw_rad")
    read = [[one[column] for column in columns] for one in solids]
    wanted = np.vstack([keyframe.solids.boxes_m for keyframe in made.keyframes])
    np.testing.assert_allclose(read, wanted, atol=1e-9)


def test_opencv_moves_boxes_as_the_wanted_ones_here(made: LabelledSet) -> None:
    # The wanted boxes of KITTI must be moved at all, or the test of it shows nothing.
    keyframe, frame = next(made.frames())
    moved = _undistorted(made, keyframe, frame, 0)
    assert np.abs(np.array(moved) - frame.boxes.boxes_px[0]).max() > 10 * _TOLERANCE_PX


def _box(
    made: LabelledSet, keyframe: Keyframe, frame: LabelledFrame, row: int, kind: _Kind
) -> tuple[str, list[float]]:
    sides = frame.boxes.boxes_px[row].tolist()
    if kind.rectified:
        sides = _undistorted(made, keyframe, frame, row)
    return kind.label(frame.boxes.labels[row]), sides


def _undistorted(
    made: LabelledSet, keyframe: Keyframe, frame: LabelledFrame, row: int
) -> list[float]:
    """Return a box in the image without distortion, by OpenCV, from the middles of its sides."""
    sensor = made.camera_of(keyframe, frame)
    assert sensor is not None
    fx, fy, cx, cy = sensor.K
    K: NDArray[np.float64] = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    x1, y1, x2, y2 = frame.boxes.boxes_px[row]
    x, y = (x1 + x2) / 2, (y1 + y2) / 2
    sides = np.array([[[x1, y]], [[x, y1]], [[x2, y]], [[x, y2]]]) - 0.5
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
    moved = cv2.undistortPoints(sides, K, np.array(sensor.distortion), P=K, criteria=criteria)
    left, top, right, bottom = moved[:, 0] + 0.5
    width, height = frame.image_size
    ends = [left[0], top[1], right[0], bottom[1]]
    cut: list[float] = np.clip(ends, 0, [width, height, width, height]).tolist()
    return cut


def _recorded(frame: LabelledFrame) -> _Boxes:
    return list(zip(frame.boxes.labels, frame.boxes.boxes_px.tolist(), strict=True))


def _found(boxes: Iterable[Mapping[str, Any]]) -> _Boxes:
    return [(one["label"], one["box"]) for one in boxes]


def _sides(row: Mapping[str, Any]) -> list[float]:
    return [row["x1_px"], row["y1_px"], row["x2_px"], row["y2_px"]]


def _local_file(url: str) -> str:
    (file,) = parse_qs(urlsplit(url).query)["d"]
    return file


def _number(value: Any) -> float:
    return np.nan if value in (None, "") else float(value)


def _same_boxes(found: _Boxes, wanted: _Boxes, tolerance_px: float = _TOLERANCE_PX) -> None:
    assert [label for label, _ in sorted(found)] == [label for label, _ in sorted(wanted)]
    for (_, one), (_, other) in zip(sorted(found), sorted(wanted), strict=True):
        assert np.abs(np.subtract(one, other)).max() <= tolerance_px
