"""YOLO's text files: the numbers in them, and what trainers and datumaro refuse."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from made_labelled_set import make_labelled_set
from renamed_labelled_set import HARD_NAMES, renamed

from percept.datasets.labelling.formats import export
from percept.datasets.labelling.labelled_set import ImageBoxes, LabelledSet
from percept.datasets.labels.yolo import read_yolo

_LARGE = (8192, 4320)


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    made = renamed(make_labelled_set(tmp_path_factory.mktemp("yolo_set"), drives=3, keyframes=2))
    export(made, "yolo", made.folder / "yolo")
    return made


def test_lines_are_the_boxes_of_their_image(labelled: LabelledSet) -> None:
    names = yaml.safe_load((labelled.folder / "yolo/data.yaml").read_text("ascii"))["names"]
    assert names == dict(enumerate(HARD_NAMES))
    for keyframe, frame in labelled.frames():
        folder = labelled.folder / "yolo/images" / keyframe.split
        assert (folder / Path(frame.file).name).samefile(labelled.folder / frame.file)
        file = labelled.folder / "yolo/labels" / keyframe.split / f"{frame.stem}.txt"
        lines = file.read_text("ascii").splitlines()
        assert len(lines) == len(frame.boxes)
        for line, label, box in zip(lines, frame.boxes.labels, frame.boxes.boxes_px, strict=True):
            number, *shares = line.split(" ")
            assert names[int(number)] == label
            # datumaro takes digits and points only, trainers nothing below 0 or above 1.
            assert all(re.fullmatch(r"\d\.\d{8}", share) for share in shares)
            cx, cy, w, h = (float(share) for share in shares)
            assert max(cx, cy, w, h) <= 1
            corners = np.array([cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2])
            np.testing.assert_allclose(corners * (320, 200, 320, 200), box, rtol=0, atol=1e-4)


def test_an_image_without_boxes_has_an_empty_file(labelled: LabelledSet) -> None:
    empty = [(k.split, f.stem) for k, f in labelled.frames() if not len(f.boxes)]
    assert len(empty) == 3
    for split, stem in empty:
        assert (labelled.folder / "yolo/labels" / split / f"{stem}.txt").read_bytes() == b""


def test_the_description_names_no_path(labelled: LabelledSet) -> None:
    about = yaml.safe_load((labelled.folder / "yolo/data.yaml").read_text("ascii"))
    assert list(about) == ["train", "val", "test", "names"]
    for split in ("train", "val", "test"):
        assert any((labelled.folder / "yolo" / about[split]).iterdir())


def test_trainers_find_train_and_val_even_where_there_are_no_images(tmp_path: Path) -> None:
    export(make_labelled_set(tmp_path, drives=1, keyframes=1), "yolo", tmp_path / "yolo")
    about = yaml.safe_load((tmp_path / "yolo/data.yaml").read_text("ascii"))
    assert list(about) == ["train", "val", "names"]
    assert not any((tmp_path / "yolo" / about["val"]).iterdir())
    assert any((tmp_path / "yolo" / about["train"]).iterdir())


def test_eight_thousand_pixels_keep_a_hundredth(tmp_path: Path) -> None:
    made = make_labelled_set(tmp_path, drives=1, keyframes=1, cameras=("front",))
    keyframe = made.keyframes[0]
    random = np.random.default_rng(2)
    first = random.uniform(0, 0.999, (500, 2)) * _LARGE
    boxes_px = np.hstack([first, first + random.uniform(0, 1, (500, 2)) * (_LARGE - first)])
    boxes_px[0] = (0, 0, *_LARGE)
    frame = replace(keyframe.frames[0], image_size=_LARGE, boxes=_person_drew(boxes_px))
    made = replace(made, keyframes=(replace(keyframe, frames=(frame,)),))
    export(made, "yolo", tmp_path / "yolo")
    lines = (tmp_path / f"yolo/labels/train/{frame.stem}.txt").read_text().splitlines()
    cx, cy, w, h = np.array([line.split()[1:] for line in lines], dtype=np.float64).T
    back = np.column_stack([cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2]) * (_LARGE * 2)
    assert np.abs(back - boxes_px).max() < 0.001


def _person_drew(boxes_px: np.ndarray) -> ImageBoxes:
    count = len(boxes_px)
    nothing = np.full(count, np.nan)
    return ImageBoxes(
        ids=np.arange(1, count + 1),
        boxes_px=boxes_px,
        labels=("car",) * count,
        confidences=nothing,
        sources=("",) * count,
        track_ids=np.full(count, -1),
        solids=np.zeros(count, np.int64),
        truncated=nothing,
        occluded=nothing,
    )


def test_our_reader_takes_them_back(labelled: LabelledSet) -> None:
    back = {image.name: image for image in read_yolo(labelled.folder / "yolo").images}
    assert len(back) == sum(1 for _ in labelled.frames())
    for keyframe, frame in labelled.frames():
        image = back[f"{keyframe.split}/{frame.stem}"]
        assert image.labels == frame.boxes.labels
        np.testing.assert_allclose(image.boxes_px, frame.boxes.boxes_px, rtol=0, atol=1e-4)
