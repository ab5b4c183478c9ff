"""Faults for the tables of a prepared data set, and for COCO."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from planting import (
    Fault,
    change_file,
    change_json,
    change_table,
    cut_off,
    put,
    put_same,
    scale_down,
)

__all__ = ["COCO", "TABLES"]

_COCO_TRAIN = "annotations/instances_train.json"


def _as_import(folder: Path) -> None:
    for name in ("images", "rectified", "scans", "coco"):
        shutil.rmtree(folder / name)
    record = {"config": {"of": "set", "split": {"margin_m": 20.0}}}
    (folder / "run.json").write_text(json.dumps(record))


def _moved_in_coco(folder: Path) -> None:
    """Put an image of `train` into `val`, as a hand does."""
    train, val = (folder / f"coco/annotations/instances_{s}.json" for s in ("train", "val"))
    source, target = json.loads(train.read_text()), json.loads(val.read_text())
    target["images"].append(source["images"].pop())  # the one without boxes
    name = target["images"][-1]["file_name"]
    (folder / "coco/images/train" / name).rename(folder / "coco/images/val" / name)
    train.write_text(json.dumps(source))
    val.write_text(json.dumps(target))


def _two_splits(folder: Path) -> None:
    """Give all moments to one drive."""
    for name in ("frames", "keyframes"):
        change_table(name, lambda rows: [row.update(drive="drive-000000") for row in rows])(folder)


def _zero_category(content: dict[str, Any]) -> None:
    content["categories"][0]["id"] = 0
    for one in content["annotations"]:
        one["category_id"] = 0 if one["category_id"] == 1 else one["category_id"]


def _swap(categories: list[dict[str, Any]]) -> None:
    categories[0]["name"], categories[1]["name"] = categories[1]["name"], categories[0]["name"]


def _emptied(folder: Path) -> None:
    shutil.rmtree(folder / "images/test")
    change_json("annotations/*test*", lambda c: c.update(images=[], annotations=[]))(folder)


TABLES = [
    Fault("missing-file", "frames.parquet 0", change_file("images/*", Path.unlink)),
    Fault(
        "missing-file",
        "frames.parquet 0",
        change_table("frames", lambda rows: put(rows[0], "rectified_file", "rectified/none.png")),
    ),
    Fault("missing-file", "the data set", change_file("boxes_3d.parquet", Path.unlink)),
    Fault("missing-file", "keyframes.parquet 0", change_file("scans/*", Path.unlink)),
    Fault("unreadable-image", "images/", change_file("images/*", cut_off)),
    Fault("unreadable-image", "rectified/", change_file("rectified/*", cut_off)),
    Fault("unreadable-image", "images/", change_file("images/*", lambda p: p.write_bytes(b""))),
    Fault(
        "unreadable-image",
        "images/",
        change_file("images/*", lambda p: p.write_bytes(b"GIF89a" * 9)),
    ),
    Fault("image-size", "frames.parquet 0", change_file("images/*", scale_down)),
    Fault("stray-file", "images/more.jpg", lambda f: (f / "images/more.jpg").write_bytes(b"x")),
    Fault("stray-file", "scans/more.bin", lambda f: (f / "scans/more.bin").write_bytes(b"x")),
    Fault(
        "outside-folder",
        "frames.parquet 0",
        change_table("frames", lambda rows: put(rows[0], "rectified_file", "../../secret.png")),
    ),
    Fault(
        "outside-folder",
        "keyframes.parquet 0",
        change_table("keyframes", lambda rows: put(rows[0], "scan_file", "/etc/passwd")),
    ),
    Fault("outside-folder", "link", lambda f: (f / "link").symlink_to("/etc/passwd")),
    Fault("outside-folder", "images/link", lambda f: (f / "images/link").symlink_to("/etc")),
    Fault(
        "unreadable-file", "dataset.json", change_file("dataset.json", lambda p: p.write_text("{"))
    ),
    Fault(
        "unreadable-file",
        "dataset.json",
        change_file("dataset.json", lambda p: p.write_text("[" * 200_000)),
    ),
    Fault(
        "unreadable-file",
        "boxes_2d.parquet",
        change_file("boxes_2d.parquet", lambda p: pq.write_table(pa.table({"box": ["a"]}), p)),
    ),
    Fault("unreadable-file", "frames.parquet", change_file("frames.parquet", cut_off)),
    Fault(
        "malformed", "dataset.json", change_json("dataset.json", lambda c: put(c, "categories", 3))
    ),
    Fault(
        "malformed",
        "keyframes.parquet 0",
        change_file("scans/*", lambda p: p.write_bytes(b"12345")),
    ),
    Fault(
        "table-mismatch",
        "frames.parquet",
        change_table("frames", lambda rows: rows.append({**rows[0], "frame": 99, "file": None})),
    ),
    Fault(
        "table-mismatch", "dataset.json", change_json("dataset.json", lambda c: put(c, "name", 3))
    ),
    Fault(
        "duplicate-id", "boxes_2d.parquet", change_table("boxes_2d", lambda r: put(r[1], "box", 1))
    ),
    Fault(
        "unknown-id",
        "boxes_2d.parquet 1",
        change_table("boxes_2d", lambda r: put(r[0], "frame", 77)),
    ),
    Fault(
        "unknown-id",
        "boxes_3d.parquet",
        change_table("boxes_3d", lambda r: put(r[2], "keyframe", 7)),
    ),
    Fault(
        "unknown-id", "frames.parquet", change_table("frames", lambda r: put(r[5], "keyframe", 77))
    ),
    Fault(
        "unknown-id",
        "keyframes.parquet",
        change_table("keyframes", lambda r: put(r[0], "drive", "x")),
    ),
    Fault(
        "unknown-class", "boxes_2d", change_table("boxes_2d", lambda r: put(r[0], "label", "cat"))
    ),
    Fault(
        "unknown-class", "boxes_3d", change_table("boxes_3d", lambda r: put(r[0], "label", "cat"))
    ),
    Fault("unknown-split", "frames", change_table("frames", lambda r: put(r[0], "split", "dev"))),
    Fault("split-differs", "frames", change_table("frames", lambda r: put(r[1], "split", "test"))),
    Fault(
        "box-outside",
        "boxes_2d.parquet 1",
        change_table("boxes_2d", lambda r: put(r[0], "x2_px", 321)),
    ),
    Fault(
        "box-outside",
        "boxes_2d.parquet 1",
        change_table("boxes_2d", lambda r: put(r[0], "y1_px", -1)),
    ),
    Fault(
        "box-empty",
        "boxes_2d.parquet 1",
        change_table("boxes_2d", lambda r: put(r[0], "x2_px", 10)),
    ),
    Fault(
        "box-empty", "boxes_3d.parquet 1", change_table("boxes_3d", lambda r: put(r[0], "width", 0))
    ),
    Fault(
        "not-a-number", "boxes_2d", change_table("boxes_2d", lambda r: put(r[0], "x2_px", np.nan))
    ),
    Fault("not-a-number", "boxes_3d", change_table("boxes_3d", lambda r: put(r[0], "x", np.inf))),
    Fault(
        "class-order",
        "coco/annotations",
        change_json("dataset.json", lambda c: c["categories"].reverse()),
    ),
    Fault(
        "leak-distance",
        "images/",
        change_table("frames", lambda rows: put(rows[2], "latitude", rows[0]["latitude"] + 1e-4)),
    ),
    Fault("leak-same-file", "images/", put_same("images/*000000_front*", "images/*000001_front*")),
    Fault(
        "leak-near-duplicate",
        "images/",
        put_same("images/*000000_front*", "images/*000001_front*", change=True),
    ),
    Fault("no-record", "run.json", change_file("run.json", Path.unlink)),
    Fault("images-elsewhere", "frames.parquet", lambda f: _as_import(f)),
    Fault(
        "margin-unknown",
        "frames.parquet",
        change_table("frames", lambda rows: put(rows[0], "latitude", None)),
    ),
    Fault(
        "margin-unknown", "frames.parquet", change_json("run.json", lambda c: put(c, "config", 3))
    ),
    Fault("split-differs", "coco: drive", lambda f: _moved_in_coco(f)),
    Fault("track-in-splits", "drive-000000, track 8", lambda f: _two_splits(f)),
]


COCO = [
    Fault("missing-file", _COCO_TRAIN, change_file("images/train/*", Path.unlink)),
    Fault("unreadable-image", "images/train", change_file("images/train/*", cut_off)),
    Fault("image-size", "images[0]", change_file("images/train/*", scale_down)),
    Fault("stray-file", "images/val/new.png", lambda f: (f / "images/val/new.png").touch()),
    Fault("malformed", _COCO_TRAIN, change_json(_COCO_TRAIN, lambda c: [c])),
    Fault(
        "malformed", "images[1]", change_json(_COCO_TRAIN, lambda c: put(c["images"], 1, "image"))
    ),
    Fault(
        "malformed",
        "images[0]",
        change_json(_COCO_TRAIN, lambda c: put(c["images"][0], "width", 0)),
    ),
    Fault(
        "malformed",
        "annotations[0]",
        change_json(_COCO_TRAIN, lambda c: put(c["annotations"][0], "bbox", 3)),
    ),
    Fault("unreadable-file", _COCO_TRAIN, change_file(_COCO_TRAIN, cut_off)),
    Fault(
        "outside-folder",
        "images[1]",
        change_json(
            _COCO_TRAIN, lambda c: put(c["images"][1], "file_name", "../../../../etc/passwd")
        ),
    ),
    Fault(
        "outside-folder",
        "images[1]",
        change_json(_COCO_TRAIN, lambda c: put(c["images"][1], "file_name", "C:\\x.jpg")),
    ),
    Fault(
        "bad-id",
        "annotations[0]",
        change_json(_COCO_TRAIN, lambda c: put(c["annotations"][0], "id", 0)),
    ),
    Fault(
        "bad-id",
        "annotations[0]",
        change_json(_COCO_TRAIN, lambda c: put(c["annotations"][0], "id", "a")),
    ),
    Fault(
        "duplicate-id",
        "coco",
        change_json(_COCO_TRAIN, lambda c: put(c["annotations"][0], "id", 2)),
    ),
    Fault(
        "duplicate-id",
        _COCO_TRAIN,
        change_json(_COCO_TRAIN, lambda c: c["images"].append(c["images"][0])),
    ),
    Fault("id-zero", "categories[0]", change_json("annotations/*", lambda c: _zero_category(c))),
    Fault(
        "unknown-class",
        "annotations[0]",
        change_json(_COCO_TRAIN, lambda c: put(c["annotations"][0], "category_id", 9)),
    ),
    Fault(
        "unknown-id",
        "annotations[0]",
        change_json(_COCO_TRAIN, lambda c: put(c["annotations"][0], "image_id", 9)),
    ),
    Fault(
        "box-outside",
        "annotations[0]",
        change_json(_COCO_TRAIN, lambda c: put(c["annotations"][0], "bbox", [300, 10, 30, 10])),
    ),
    Fault(
        "box-empty",
        "annotations[0]",
        change_json(_COCO_TRAIN, lambda c: put(c["annotations"][0], "bbox", [30, 10, 0, 10])),
    ),
    Fault(
        "box-empty",
        "annotations[0]",
        change_json(_COCO_TRAIN, lambda c: put(c["annotations"][0], "bbox", [30, 10, 5, -10])),
    ),
    Fault(
        "not-a-number",
        "annotations[0]",
        change_json(_COCO_TRAIN, lambda c: put(c["annotations"][0], "bbox", [30, "a", 5, 10])),
    ),
    Fault(
        "class-order",
        "instances_val",
        change_json("annotations/*val*", lambda c: _swap(c["categories"])),
    ),
    Fault("leak-same-file", "images/val", put_same("images/train/*", "images/val/*")),
    Fault("same-file", "images/train", put_same("images/train/*", "images/train/*")),
    Fault(
        "near-duplicate", "images/train", put_same("images/train/*", "images/train/*", change=True)
    ),
    Fault(
        "leak-near-duplicate", "images/val", put_same("images/train/*", "images/val/*", change=True)
    ),
    Fault("empty-split", "coco", lambda f: _emptied(f)),
]
