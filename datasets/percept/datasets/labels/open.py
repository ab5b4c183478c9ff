"""Opens labels and detections of whatever format, told by what the files look like."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Literal, get_args

from percept.core.errors import InputError, UsageError
from percept.core.labels import LabelSet
from percept.datasets.labels.boxes import read_text_lines
from percept.datasets.labels.coco import holds_coco_results, read_coco, read_coco_results
from percept.datasets.labels.cvat import cvat_files, read_cvat
from percept.datasets.labels.kitti import kitti_folder, looks_like_kitti, read_kitti
from percept.datasets.labels.label_studio import is_label_studio, read_label_studio
from percept.datasets.labels.parquet import read_box_table, table_file
from percept.datasets.labels.yolo import looks_like_yolo, read_yolo, yolo_class_names

__all__ = ["LabelFormat", "label_format", "read_detections", "read_labels"]

LabelFormat = Literal["coco", "yolo", "kitti", "cvat", "label-studio", "parquet"]
"""The formats that are read."""

_Size = tuple[int, int]
_LOOKED_AT = 200


def label_format(path: Path) -> LabelFormat:
    """Return the format of labels or detections by looking at them.

    Raises:
        InputError: If there is nothing, or it looks like none of the formats, or like two.
    """
    if not path.exists():
        raise InputError("does not exist", where=path)
    if table_file(path) is not None:
        return "parquet"
    if path.suffix.lower() == ".json":
        return "label-studio" if is_label_studio(path) else "coco"
    if path.suffix.lower() == ".xml" or (path.is_dir() and cvat_files(path)):
        return "cvat"
    if (path / "run.json").is_file():
        raise InputError(
            "is a run without 2D boxes", where=path, remedy="Run percept detect with --model"
        )
    looks = set(_looks_of_text(path))
    if len(looks) == 1:
        return looks.pop()
    raise InputError(
        "looks like " + (" and ".join(sorted(looks)) if looks else "none of the known formats"),
        where=path,
        remedy=f"Pass --format with one of {', '.join(get_args(LabelFormat))}",
    )


def read_labels(
    path: Path,
    label_format: LabelFormat,
    *,
    image_size: _Size | None = None,
) -> LabelSet:
    """Read labels.

    Args:
        path: The file or folder.
        label_format: Its format.
        image_size: (width, height) of images whose size nothing else tells (YOLO).

    Raises:
        InputError: If the files cannot be used.
    """
    match label_format:
        case "coco":
            if holds_coco_results(path):
                raise InputError(
                    "is a list of COCO results, not labels",
                    where=path,
                    remedy="Give the file of instances",
                )
            return read_coco(path)
        case "yolo":
            return read_yolo(path, image_size=image_size)
        case "kitti":
            return read_kitti(path)
        case "cvat":
            return read_cvat(path)
        case "label-studio":
            return read_label_studio(path)
        case "parquet":
            return read_box_table(path)


def read_detections(
    path: Path,
    label_format: LabelFormat,
    truth: LabelSet,
    *,
    image_size: _Size | None = None,
    model: str | None = None,
) -> LabelSet:
    """Read detections; an image that is not among them has none, unless a run lists its images.

    Args:
        path: The file or folder.
        label_format: Its format.
        truth: The labels, which name what the detections give as numbers.
        image_size: (width, height) of images whose size nothing else tells (YOLO).
        model: The network whose boxes to take, of a run with several.

    Raises:
        InputError: If the files cannot be used.
        UsageError: If the run has no such network, or the format is one of labels only.
    """
    if label_format in ("cvat", "label-studio"):
        raise UsageError(f"{label_format} holds labels, not detections", where=path)
    if label_format == "parquet":
        return read_box_table(path, model=model)
    if label_format == "kitti":
        found = read_kitti(path)
    elif label_format == "yolo":
        found = _yolo_detections(path, truth, image_size)
    else:
        found = read_coco_results(path, truth) if holds_coco_results(path) else read_coco(path)
    ranked = {image.confidences is not None for image in found.images if len(image)}
    if len(ranked) > 1:
        raise InputError("some images have confidences and others do not", where=path)
    return replace(found, complete=False)


def _yolo_detections(path: Path, truth: LabelSet, image_size: _Size | None) -> LabelSet:
    """Read YOLO's files; what they do not tell is taken from the labels, names with a note."""
    # COCO's numbers of categories mostly count from 1, YOLO's classes from 0.
    names = None if truth.image_ids else truth.categories or None
    found = read_yolo(path, class_names=names, image_size=image_size, size_of=_sizes(truth))
    if names is None or yolo_class_names(path) is not None:
        return found
    note = "the detections have no names of classes: the numbers are taken for those of the labels"
    return replace(found, notes=(*found.notes, note))


def _sizes(truth: LabelSet) -> Callable[[str], _Size | None]:
    """Return what gives an image's size by the last part of its name, where that is one size."""
    sizes: dict[str, set[_Size | None]] = {}
    for image in truth.images:
        sizes.setdefault(PurePosixPath(image.name).stem, set()).add(image.image_size)

    def size_of(name: str) -> _Size | None:
        known = sizes.get(PurePosixPath(name).name, set())
        return next(iter(known)) if len(known) == 1 else None

    return size_of


def _looks_of_text(path: Path) -> list[LabelFormat]:
    """Return what the first lines of the text files in a folder look like."""
    folder = path / "labels" if (path / "labels").is_dir() else kitti_folder(path)
    looks: list[LabelFormat] = []
    for file in sorted(folder.rglob("*.txt"))[:_LOOKED_AT]:
        words = next((words for _, words in read_text_lines(file)), [])
        looks += ["kitti"] if looks_like_kitti(words) else []
        looks += ["yolo"] if looks_like_yolo(words) else []
    return looks
