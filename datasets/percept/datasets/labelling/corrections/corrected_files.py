"""Files that came back from a labelling tool, found again among the images of a set."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.labels import LabelledImage, LabelSet
from percept.datasets.labelling.formats.kitti_boxes import kitti_types
from percept.datasets.labelling.formats.xml_text import xml_text
from percept.datasets.labelling.labelled_set import LabelledFrame, LabelledSet
from percept.datasets.labelling.names import safe_name
from percept.datasets.labels.coco import read_coco
from percept.datasets.labels.cvat import read_cvat
from percept.datasets.labels.kitti import read_kitti
from percept.datasets.labels.label_studio import label_studio_file, read_label_studio
from percept.datasets.labels.open import label_format
from percept.datasets.labels.yolo import read_yolo

__all__ = ["CorrectedFormat", "FoundImages", "corrected_format", "find_images"]

CorrectedFormat = Literal["coco", "yolo", "kitti", "cvat", "label-studio"]
"""The formats that corrected labels are read from."""

_MOST_BOXES = 5_000
_NAMED = 5
_LONGEST_NAME = 80
_FOREIGN = "images that are not in the data set"
_OTHER_SIZE = "images of another size than in the data set"
_IGNORED = "regions to ignore, of which a data set has none"

_NUMBERED = re.compile(r"^\d{6}_")  # what the images of a video begin with


@dataclass(slots=True)
class FoundImages:
    """Images of a set with what the files say of them.

    Attributes:
        by_frame: Labels of each image by its number in the set; class names are those of the set.
        dropped: What was not taken, counted by reason.
        notes: Names of what was not taken.
        files: The files that were read.
    """

    by_frame: dict[int, LabelledImage] = field(default_factory=dict)
    dropped: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    files: tuple[Path, ...] = ()


def corrected_format(path: Path) -> CorrectedFormat:
    """Return the format of corrected labels by looking at them.

    Raises:
        InputError: If there is nothing, or it looks like none of the formats.
    """
    if path.is_dir() and _coco_files(path):
        return "coco"
    if path.is_dir() and label_studio_file(path).is_file():
        return "label-studio"
    found = label_format(path)
    if found != "parquet":
        return found
    raise InputError(
        f"looks like {found}, which labelling tools do not write",
        where=path,
        remedy=f"Pass --format with one of {', '.join(get_args(CorrectedFormat))}",
    )


def find_images(path: Path, name: CorrectedFormat, original: LabelledSet) -> FoundImages:
    """Read files and say which image of the set each of theirs is.

    An image is known by its file name without folders and suffix; one of KITTI by its number, one
    of a video of CVAT by the video and its place in it. Names are compared and never opened.

    Args:
        path: The file or folder.
        name: Its format.
        original: The set that was exported.

    Raises:
        InputError: If the files cannot be read, hold one image twice, or none of the set.
    """
    found = FoundImages()
    frame_of = _frames(name, original)
    names = _class_names(name, original)
    foreign: list[str] = []
    resized: list[str] = []
    files: list[Path] = []
    for labels in _label_sets(path, name, original):
        files += labels.files
        found.dropped.update(labels.dropped)
        for image in labels.images:
            frame = frame_of(image.name)
            if frame is None:
                foreign.append(image.name)
            elif frame.frame in found.by_frame:
                raise InputError(f"image '{_short(image.name)}' comes twice", where=path)
            elif image.image_size not in (None, frame.image_size):
                resized.append(image.name)
            else:
                found.by_frame[frame.frame] = _usable(image, names, found.dropped, path)
    found.files = tuple(files)
    _tell(found, _FOREIGN, foreign)
    _tell(found, _OTHER_SIZE, resized)
    if not found.by_frame:
        raise InputError(
            f"holds labels of no image of {original.folder}",
            where=path,
            remedy="Give the folder that was exported as --of"
            + ("" if foreign else ", and labels that somebody has saved"),
        )
    return found


def _label_sets(path: Path, name: CorrectedFormat, original: LabelledSet) -> Iterator[LabelSet]:
    match name:
        case "coco":
            for file in _coco_files(path) or (path,):
                yield read_coco(file, from_tool=True)
        case "yolo":
            sizes = {frame.stem: frame.image_size for _, frame in original.frames()}
            yield read_yolo(path, size_of=lambda name: sizes.get(PurePosixPath(name).name))
        case "kitti":
            yield read_kitti(path)
        case "cvat":
            yield read_cvat(path)
        case "label-studio":
            yield read_label_studio(path)


def _coco_files(path: Path) -> tuple[Path, ...]:
    """Return the files of instances in the folder of an export."""
    for folder in (path / "annotations", path):
        if path.is_dir() and (files := sorted(folder.glob("instances*.json"))):
            return tuple(files)
    return ()


def _frames(name: CorrectedFormat, original: LabelledSet) -> Callable[[str], LabelledFrame | None]:
    """Return what finds an image of the set by the name that a format has for it."""
    if name == "kitti":
        by_number = {f"{frame.frame:06d}": frame for _, frame in original.frames()}
        return by_number.get
    by_stem = {frame.stem: frame for _, frame in original.frames()}
    videos: dict[str, list[LabelledFrame]] = {}
    for keyframe, frame in original.frames():
        videos.setdefault(f"{keyframe.drive}_{safe_name(frame.camera)}", []).append(frame)
    by_place = {
        f"{video}/{place}": frame
        for video, frames in videos.items()
        for place, frame in enumerate(sorted(frames, key=lambda one: one.stamp_ns))
    }

    def find(image: str) -> LabelledFrame | None:
        stem = PurePosixPath(image.replace("\\", "/")).stem
        by_name = by_stem.get(stem) or by_stem.get(_NUMBERED.sub("", stem))
        return by_name or (by_place.get(image) if name == "cvat" else None)

    return find


def _class_names(name: CorrectedFormat, original: LabelledSet) -> Mapping[str, str]:
    """Return the classes of a set by the words that a format has for them."""
    if name == "kitti":
        return {word: label for label, word in kitti_types(original.categories).items()}
    if name in ("cvat", "label-studio"):
        return {xml_text(label): label for label in original.categories}
    return {}


def _usable(
    image: LabelledImage, names: Mapping[str, str], dropped: Counter[str], path: Path
) -> LabelledImage:
    """Return an image with the class names of the set and without regions to ignore."""
    if len(image) > _MOST_BOXES:
        raise InputError(
            f"image '{_short(image.name)}' has {len(image):,} boxes; {_MOST_BOXES:,} is most",
            where=path,
        )
    rows: NDArray[np.intp] = np.flatnonzero(~image.ignore)
    if len(rows) < len(image):
        dropped[_IGNORED] += len(image) - len(rows)
    return LabelledImage.of(
        image.name,
        image.boxes_px[rows],
        [names.get(image.labels[row], image.labels[row]) for row in rows],
        image_size=image.image_size,
        box_ids=image.box_ids[rows],
        track_ids=image.track_ids[rows],
    )


def _tell(found: FoundImages, reason: str, names: Iterable[str]) -> None:
    listed = [_short(name) for name in names]
    if listed:
        found.dropped[reason] += len(listed)
        more = f" and {len(listed) - _NAMED} more" if len(listed) > _NAMED else ""
        found.notes.append(f"{reason}: {', '.join(listed[:_NAMED])}{more}")


def _short(name: str) -> str:
    shown = "".join(letter if letter.isprintable() else "?" for letter in name)
    return shown if len(shown) <= _LONGEST_NAME else f"{shown[: _LONGEST_NAME - 3]}..."
