"""Faults for the formats of labelling tools, but COCO."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from planting import (
    Fault,
    change_file,
    change_json,
    change_text,
    put,
    put_same,
    scale_down,
    word,
)

__all__ = ["CVAT", "KITTI", "NUSCENES", "OPENLABEL", "STUDIO", "SUSTECH", "TRACKING", "YOLO"]


def _region(tasks: Any) -> Any:
    return tasks[0]["predictions"][0]["result"][0]


def _first(document: Any, key: str) -> Any:
    objects = document["openlabel"]["frames"]["0"]["objects"].values()
    return next(one["object_data"][key][0] for one in objects if key in one["object_data"])


_LABEL = "labels/train/*.txt"
YOLO = [
    Fault("share-range", "line 1", change_text(_LABEL, word(1, "1.2"))),
    Fault("share-range", "line 1", change_text(_LABEL, word(3, "-0.2"))),
    Fault("box-outside", "line 1", change_text(_LABEL, word(1, "0.99"))),
    Fault("box-empty", "line 1", change_text(_LABEL, word(3, "0"))),
    Fault("unknown-class", "line 1", change_text(_LABEL, word(0, "3"))),
    Fault("bad-id", "line 1", change_text(_LABEL, word(0, "car"))),
    Fault("wrong-columns", "line 1", change_text(_LABEL, word(4, ""))),
    Fault("not-a-number", "line 1", change_text(_LABEL, word(2, "nan"))),
    Fault("duplicate-row", "line 4", change_text(_LABEL, lambda t: t + t.splitlines()[0])),
    Fault("missing-label", "images/train", change_file(_LABEL, Path.unlink)),
    Fault("stray-label", "labels/val/x.txt", lambda f: (f / "labels/val/x.txt").write_text("")),
    Fault("malformed", "data.yaml", change_text("data.yaml", lambda t: t + "nc: 7\n")),
    Fault("malformed", "data.yaml", change_text("data.yaml", lambda t: t.split("names")[0])),
    Fault(
        "outside-folder",
        "data.yaml test",
        change_text("data.yaml", lambda t: t.replace("images/test", "../../x")),
    ),
    Fault("bad-id", "data.yaml", change_text("data.yaml", lambda t: t.replace("  2:", "  5:"))),
    Fault(
        "split-differs",
        "data.yaml val",
        change_text("data.yaml", lambda t: t.replace("images/val", "images/train")),
    ),
    Fault("empty-split", "yolo", lambda f: shutil.rmtree(f / "images/test")),
    Fault("leak-same-file", "images/val", put_same("images/train/*", "images/val/*")),
]
_ROW = "training/label_2/*.txt"
KITTI = [
    Fault("wrong-columns", "line 1", change_text(_ROW, word(14, ""))),
    Fault("not-a-number", "line 1", change_text(_ROW, word(11, "inf"))),
    Fault("unknown-class", "line 1", change_text(_ROW, word(0, "Cat"))),
    Fault("other-class", "label_2", lambda f: (f / "classes.csv").unlink()),
    Fault("box-outside", "line 1", change_text(_ROW, word(6, "321"))),
    Fault("box-empty", "line 1", change_text(_ROW, word(6, "1"))),
    Fault("box-empty", "line 1", change_text(_ROW, word(8, "0"))),
    Fault("duplicate-row", "line", change_text(_ROW, lambda t: t + t.splitlines()[0])),
    Fault("missing-label", "kitti sample 000000", change_file(_ROW, Path.unlink)),
    Fault("missing-file", "kitti sample 000000", change_file("training/calib/*", Path.unlink)),
    Fault("missing-file", "kitti sample 000000", change_file("training/velodyne/*", Path.unlink)),
    Fault("missing-file", "kitti sample 000000", change_file("training/image_2/*", Path.unlink)),
    Fault(
        "malformed",
        "calib/000000",
        change_text("training/calib/*", lambda t: t.replace("P2:", "P2: 1")),
    ),
    Fault(
        "malformed",
        "velodyne/000000",
        change_file("training/velodyne/*", lambda p: p.write_bytes(b"1")),
    ),
    Fault("malformed", "classes.csv", change_text("classes.csv", lambda _: "car\n")),
    Fault("split-differs", "ImageSets", change_text("ImageSets/val.txt", lambda t: t + "000000\n")),
]
TRACKING = [
    Fault("wrong-columns", "line 1", change_text("training/label_02/*", word(5, ""))),
    Fault("unknown-id", "line 1", change_text("training/label_02/*", word(0, "9"))),
    Fault(
        "duplicate-id", "line", change_text("training/label_02/*", lambda t: t + t.splitlines()[0])
    ),
    Fault("missing-label", "sequence 0000", change_file("training/label_02/*", Path.unlink)),
    Fault("stray-label", "0099.txt", lambda f: (f / "training/label_02/0099.txt").touch()),
    Fault("missing-file", "sequence 0000", change_file("training/velodyne/0000/*", Path.unlink)),
]
CVAT = [
    Fault(
        "box-outside",
        "image 0",
        change_text("images/annotations.xml", lambda t: t.replace('xbr="160.7500"', 'xbr="400"')),
    ),
    Fault(
        "unknown-class",
        "image 0",
        change_text(
            "images/annotations.xml", lambda t: t.replace('box label="car"', 'box label="cat"', 1)
        ),
    ),
    Fault(
        "not-a-number",
        "image 0",
        change_text("images/annotations.xml", lambda t: t.replace('xbr="160.7500"', "")),
    ),
    Fault(
        "duplicate-id",
        "images/annotations.xml",
        change_text("images/annotations.xml", lambda t: t.replace('id="1"', 'id="0"')),
    ),
    Fault("missing-file", "image 0", change_file("images/images/train/*", Path.unlink)),
    Fault(
        "malformed",
        "image 0",
        change_text("images/annotations.xml", lambda t: t.replace('width="320"', "", 1)),
    ),
    Fault(
        "unknown-id",
        "track 0 frame 5",
        change_text("video/*/annotations.xml", lambda t: t.replace('frame="0"', 'frame="5"', 1)),
    ),
    Fault(
        "bad-id",
        "track 0 frame",
        change_text("video/*/annotations.xml", lambda t: t.replace('frame="0"', 'frame="a"', 1)),
    ),
    Fault(
        "unreadable-file",
        "annotations.xml",
        change_text("images/annotations.xml", lambda t: "<!DOCTYPE a>" + t[39:]),
    ),
    Fault(
        "outside-folder",
        "image 0",
        change_text(
            "images/annotations.xml", lambda t: t.replace('subset="train"', 'subset="../../.."', 1)
        ),
    ),
]
STUDIO = [
    Fault(
        "share-range",
        "task 0",
        change_json("tasks.json", lambda c: put(_region(c)["value"], "x", 130.0)),
    ),
    Fault(
        "box-outside",
        "task 0",
        change_json("tasks.json", lambda c: put(_region(c)["value"], "x", 90.0)),
    ),
    Fault(
        "not-a-number",
        "task 0",
        change_json("tasks.json", lambda c: put(_region(c)["value"], "x", "a")),
    ),
    Fault(
        "unknown-class",
        "task 0",
        change_json("tasks.json", lambda c: put(_region(c)["value"], "rectanglelabels", [])),
    ),
    Fault(
        "duplicate-id",
        "task 0",
        change_json("tasks.json", lambda c: put(_region(c), "id", "box-2")),
    ),
    Fault("malformed", "task 0", change_json("tasks.json", lambda c: put(_region(c), "value", 3))),
    Fault(
        "malformed", "task 0", change_json("tasks.json", lambda c: put(c[0], "predictions", [3]))
    ),
    Fault("malformed", "tasks.json", change_json("tasks.json", lambda _: {"tasks": 1})),
    Fault(
        "missing-file",
        "task 1",
        change_json("tasks.json", lambda c: put(c[1]["data"], "image", "x.jpg")),
    ),
    Fault(
        "outside-folder",
        "task 1",
        change_json("tasks.json", lambda c: put(c[1]["data"], "image", "http://x/y")),
    ),
    Fault("image-size", "task 0", change_file("images/*000000_front*", scale_down)),
]
NUSCENES = [
    Fault(
        "unknown-id",
        "sample.json",
        change_json("*/sample.json", lambda c: put(c[0], "scene_token", "x")),
    ),
    Fault(
        "unknown-id",
        "log.json [0]",
        change_json("*/map.json", lambda c: put(c[0], "log_tokens", [])),
    ),
    Fault("duplicate-id", "sensor.json", change_json("*/sensor.json", lambda c: c.append(c[0]))),
    Fault("missing-file", "attribute.json", change_file("*/attribute.json", Path.unlink)),
    Fault("missing-file", "map.json", change_file("maps/*", Path.unlink)),
    Fault("missing-file", "sample_data.json", change_file("samples/LIDAR_TOP/*", Path.unlink)),
    Fault(
        "malformed",
        "sample_data.json",
        change_file("samples/LIDAR_TOP/*", lambda p: p.write_bytes(b"1")),
    ),
    Fault(
        "box-empty",
        "sample_annotation.json [0]",
        change_json("*/sample_annotation.json", lambda c: put(c[0], "size", [1, 0, 1])),
    ),
    Fault(
        "malformed",
        "ego_pose.json [0]",
        change_json("*/ego_pose.json", lambda c: put(c[0], "rotation", [2, 0, 0, 0])),
    ),
    Fault(
        "not-a-number",
        "ego_pose.json [0]",
        change_json("*/ego_pose.json", lambda c: put(c[0], "translation", [None] * 3)),
    ),
    Fault(
        "malformed", "visibility.json [4]", change_json("*/visibility.json", lambda c: c.append(3))
    ),
]
OPENLABEL = [
    Fault(
        "malformed", "train/", change_json("train/*", lambda c: put(c["openlabel"], "metadata", {}))
    ),
    Fault(
        "malformed",
        "objects",
        change_json(
            "train/*", lambda c: next(iter(c["openlabel"]["objects"].values())).pop("type")
        ),
    ),
    Fault(
        "unknown-id",
        "frame 0 object",
        change_json("train/*", lambda c: c["openlabel"]["objects"].popitem()),
    ),
    Fault("missing-file", "stream", change_file("scans/*", Path.unlink)),
    Fault(
        "malformed",
        "frame 0",
        change_json("train/*", lambda c: put(_first(c, "bbox"), "val", [1, 2])),
    ),
    Fault(
        "box-empty",
        "frame 0",
        change_json("train/*", lambda c: put(_first(c, "bbox"), "val", [9, 9, 0, 5])),
    ),
    Fault(
        "box-empty",
        "frame 0",
        change_json("train/*", lambda c: put(_first(c, "cuboid")["val"], 9, 0)),
    ),
    Fault(
        "malformed",
        "frame 0",
        change_json("train/*", lambda c: put(_first(c, "cuboid")["val"], 6, 9.0)),
    ),
]
SUSTECH = [
    Fault("missing-label", "lidar/", change_file("data/*/label/*", Path.unlink)),
    Fault(
        "stray-label",
        "label/",
        change_file("data/*/lidar/*", lambda p: p.rename(p.with_suffix(".xyz"))),
    ),
    Fault("malformed", "label/", change_json("data/*/label/*", lambda c: put(c[0], "psr", 3))),
    Fault("malformed", "label/", change_json("data/*/label/*", lambda _: {"a": 1})),
    Fault(
        "malformed",
        "calib/",
        change_json("data/*/calib/camera/*.json", lambda c: put(c, "extrinsic", [1])),
    ),
    Fault(
        "box-empty",
        "label/",
        change_json("data/*/label/*", lambda c: put(c[0]["psr"]["scale"], "x", 0)),
    ),
    Fault("missing-file", "camera/", change_file("data/*/calib/camera/*.json", Path.unlink)),
    Fault(
        "box-outside",
        "label_fusion",
        change_json("data/*/label_fusion/*/*/*", lambda c: put(c["objs"][0]["rect"], "x2", 999)),
    ),
]
