"""Every fault that `percept dataset check` knows, planted into a set that has none."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from made_labelled_set import make_labelled_set
from planted_format_faults import (
    CVAT,
    KITTI,
    NUSCENES,
    OPENLABEL,
    STUDIO,
    SUSTECH,
    TRACKING,
    YOLO,
)
from planted_set_faults import COCO, TABLES
from planting import Fault, change_json

from percept.core.errors import InputError
from percept.core.results import Verdict
from percept.datasets.labelling.check.dataset import check_dataset
from percept.datasets.labelling.check.problems import CODES
from percept.datasets.labelling.formats import EXPORTERS, export

_COCO_TRAIN = "annotations/instances_train.json"
_PLANTED = {
    "": TABLES, "coco": COCO, "yolo": YOLO, "kitti": KITTI, "kitti-tracking": TRACKING,
    "cvat": CVAT, "label-studio": STUDIO, "nuscenes": NUSCENES, "openlabel": OPENLABEL,
    "sustech": SUSTECH,
}  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set of three splits in all formats, without a fault."""
    folder = tmp_path_factory.mktemp("whole") / "set"
    labelled = make_labelled_set(folder, drives=3, keyframes=1, rectified_suffix=".png")
    for name in EXPORTERS:
        export(labelled, name, folder / name)
    record = {"config": {"split": {"margin_m": 20.0}}}
    (folder / "run.json").write_text(json.dumps(record))
    return folder


def _copied(whole: Path, tmp_path: Path, part: str) -> Path:
    """Return a copy of a format, or of the tables with their files, in which files are apart."""
    target = tmp_path / "copy"
    shutil.copytree(
        whole / part,
        target,
        ignore=None if part else lambda *_: [name for name in EXPORTERS if name != "coco"],
    )
    return target


@pytest.mark.parametrize(
    ("part", "fault"),
    [
        pytest.param(part, fault, id=f"{part or 'tables'}-{number}-{fault.code}")
        for part, faults in _PLANTED.items()
        for number, fault in enumerate(faults)
    ],
)
def test_a_planted_fault_is_found(whole: Path, tmp_path: Path, part: str, fault: Fault) -> None:
    folder = _copied(whole, tmp_path, part)
    fault.plant(folder)
    result = check_dataset(folder)
    assert fault.code in result.found
    places = [one.where for one in result.problems if one.code == fault.code]
    assert any(fault.where in place for place in places), places
    assert (result.verdict is Verdict.BAD) == any(
        CODES[code].severity == "error" for code in result.found
    )


def test_every_code_has_a_planted_fault() -> None:
    assert {fault.code for faults in _PLANTED.values() for fault in faults} == set(CODES)


def test_a_whole_set_has_no_problem(whole: Path) -> None:
    result = check_dataset(whole)
    assert result.problems == ()
    assert result.verdict is Verdict.GOOD
    assert result.images == {"train": 2, "val": 2, "test": 2}
    assert result.histogram["car"] == {"train": 1, "val": 1, "test": 1}
    assert set(result.formats) >= {"tables", "parquet", "coco", "yolo", "sustech"}


@pytest.mark.parametrize("name", [name for name in EXPORTERS if name != "parquet"])
def test_a_format_alone_has_no_problem(whole: Path, name: str) -> None:
    result = check_dataset(whole / name)
    assert {code: n for code, n in result.found.items() if CODES[code].severity != "info"} == {}
    assert result.counts["images"] == 6


def test_a_folder_without_a_data_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no data set that is known"):
        check_dataset(tmp_path)
    with pytest.raises(InputError, match="is no folder"):
        check_dataset(tmp_path / "none")


def test_texts_of_strangers_come_out_in_one_printable_line(whole: Path, tmp_path: Path) -> None:
    folder = _copied(whole, tmp_path, "coco")
    hostile = "\ud800\x1b[31m\n" + "x" * 10_000

    def change(content: Any) -> None:
        content["images"][1]["file_name"] = hostile
        content["categories"][0]["name"] = hostile

    change_json(_COCO_TRAIN, change)(folder)
    result = check_dataset(folder)
    texts = [*result.histogram, *(t for one in result.problems for t in one)]
    assert "missing-file" in result.found
    assert all(text.isprintable() and len(text) <= 300 for text in texts)


def test_of_a_kind_a_thousand_are_kept_and_all_are_counted(whole: Path, tmp_path: Path) -> None:
    folder = _copied(whole, tmp_path, "coco")
    change_json(_COCO_TRAIN, lambda c: c["annotations"].extend([3] * 1500))(folder)
    result = check_dataset(folder)
    assert result.found["malformed"] == 1500
    assert len(result.problems) == 1000


def test_nothing_outside_is_opened(whole: Path, tmp_path: Path) -> None:
    folder = _copied(whole, tmp_path, "yolo")
    pipe = tmp_path / "pipe.jpg"
    os.mkfifo(pipe)  # whoever opens it waits for ever
    (folder / "images/train/link.jpg").symlink_to(pipe)
    os.mkfifo(folder / "images/train/own.jpg")
    result = check_dataset(folder)
    assert [one.where for one in result.problems if one.code == "outside-folder"] == [
        "images/train/link.jpg"
    ]


@pytest.mark.parametrize("margin", [10**400, float("inf"), float("nan"), -1, True, "20", None])
def test_a_margin_that_is_none_is_not_taken(whole: Path, tmp_path: Path, margin: object) -> None:
    folder = _copied(whole, tmp_path, "")
    record = {"config": {"split": {"margin_m": margin}}}
    (folder / "run.json").write_text(json.dumps(record))
    assert set(check_dataset(folder).found) == {"margin-unknown"}
    # The data card states it too.
    stated = "- least distance between splits that was asked for: 20000 m\n"
    (folder / "README.md").write_text(stated)
    assert set(check_dataset(folder).found) == {"leak-distance"}


@pytest.mark.parametrize("file", ["_annotations.coco.json", "labels.json"])
def test_coco_beside_its_images_is_found(whole: Path, tmp_path: Path, file: str) -> None:
    folder = tmp_path / "other"
    for split in ("train", "val"):
        shutil.copytree(whole / "coco/images" / split, folder / split)
        source = whole / f"coco/annotations/instances_{split}.json"
        shutil.copyfile(source, folder / split / file)
    (folder / "notes.json").write_text('{"images": 3, "boxes": []}')
    result = check_dataset(folder)
    assert result.found == {}
    assert result.images == {"train": 2, "val": 2}
    assert result.histogram["car"] == {"train": 1, "val": 1}
