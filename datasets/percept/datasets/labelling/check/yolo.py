"""Checks YOLO: `data.yaml`, images, and a text file for each."""

from __future__ import annotations

import math
import posixpath
from collections.abc import Iterator, Mapping
from typing import Any

from percept.core.errors import ConfigError
from percept.core.settings import load_yaml_mapping
from percept.datasets.labelling.check.inspection import UNSPLIT, Inspection, Part, as_finite
from percept.datasets.labelling.check.pictures import IMAGE_SUFFIXES

__all__ = ["check_yolo", "holds_yolo"]

_ABOUT = ("data.yaml", "dataset.yaml", "data.yml")
_CLASSES = "classes.txt"
_SPLITS = ("train", "val", "test")
_COLUMNS = 5
_ROUNDING = 1e-6


def holds_yolo(inspection: Inspection, root: str) -> bool:
    """Return whether a folder holds YOLO."""
    files, folders = inspection.folder.files, inspection.folder.folders
    if any(f"{root}{name}" in files for name in _ABOUT):
        return True
    return {f"{root}labels/", f"{root}images/"} <= folders and bool(
        inspection.folder.below(f"{root}labels/", ".txt")
    )


def check_yolo(inspection: Inspection, root: str) -> None:
    """Check `data.yaml`, the images of each split, and the labels of each image."""
    _Yolo(inspection, inspection.part(root, "yolo")).check()


class _Yolo:
    def __init__(self, inspection: Inspection, part: Part) -> None:
        self._inspection = inspection
        self._folder = inspection.folder
        self._part = part
        self._about = ""
        self._classes: dict[int, str] | None = None

    def check(self) -> None:
        """Check everything."""
        splits = self._read_about()
        labels: set[str] = set()
        for split, images in splits:
            self._part.stated.add(split)
            for image in images:
                where = f"{self._about} {split}" if self._about else image
                self._inspection.list_image(self._part, image, split, where)
                label = _label_of(image)
                labels.add(label)
                self._check_labels(label, image, split)
        for name in self._folder.below(self._part.root, ".txt"):
            if name not in labels and "/labels/" in f"/{name}":
                self._inspection.add("stray-label", name, "there is no image of this name")

    def _read_about(self) -> list[tuple[str, list[str]]]:
        """Read classes and splits; return the images of each split."""
        root, files = self._part.root, self._folder.files
        self._about = next((root + name for name in _ABOUT if root + name in files), "")
        if not self._about:
            self._read_class_lines()
            return self._splits_of_folders()
        try:
            content = load_yaml_mapping(self._folder.path(self._about))
        except (ConfigError, ValueError) as error:  # ValueError: dates and numbers that are none
            told = error.what if isinstance(error, ConfigError) else f"no YAML ({error})"
            self._inspection.add("unreadable-file", self._about, told)
            return self._splits_of_folders()
        self._read_names(content)
        return list(self._splits_of(content))

    def _read_names(self, content: Mapping[str, Any]) -> None:
        names, count = content.get("names"), content.get("nc")
        pairs = dict(enumerate(names)) if isinstance(names, list) else names
        if not isinstance(pairs, dict) or not all(
            isinstance(k, int) and isinstance(name, str) for k, name in pairs.items()
        ):
            told = "'names' are no texts, in a list or by number"
            self._inspection.add("malformed", self._about, told)
            return
        self._set_classes(pairs)
        if count is not None and count != len(pairs):
            told = f"nc is {count}, and there are names of {len(pairs)} classes"
            self._inspection.add("malformed", self._about, told)
        if sorted(pairs) != list(range(len(pairs))):
            self._inspection.add("bad-id", self._about, "classes are not numbered from 0 on")

    def _set_classes(self, pairs: dict[int, str]) -> None:
        self._classes = pairs
        self._part.classes[self._about] = tuple(pairs[number] for number in sorted(pairs))
        self._inspection.check_unique(self._about, pairs.values(), "class")

    def _read_class_lines(self) -> None:
        for name in (f"{self._part.root}{_CLASSES}", f"{self._part.root}labels/{_CLASSES}"):
            if name in self._folder.files:
                self._about = name
                rows = enumerate(words for _, words in self._folder.rows(name))
                self._set_classes({number: " ".join(words) for number, words in rows})
                return
        told = "neither data.yaml nor classes.txt names the classes"
        self._inspection.add("missing-file", self._part.root or ".", told)

    def _splits_of(self, content: Mapping[str, Any]) -> Iterator[tuple[str, list[str]]]:
        above = content.get("path")
        base = self._part.root
        if isinstance(above, str) and above not in ("", "."):
            found = self._folder.resolve(base, above, f"{self._about} path")
            base = f"{found}/" if found and found != "." else base
        for split in _SPLITS:
            named = content.get(split, content.get("valid") if split == "val" else None)
            places = named if isinstance(named, list) else [named]
            images = [
                image
                for place in places
                if place is not None
                for image in self._images(base, place, f"{self._about} {split}")
            ]
            if named is not None:
                yield split, images

    def _images(self, base: str, place: object, where: str) -> list[str]:
        """Return the images of a folder, or of a list of images, that `data.yaml` names."""
        if isinstance(place, str):
            # Roboflow writes ../train/images and means train/images; trainers know.
            shorter = posixpath.normpath(base + place.removeprefix("../"))
            if place.startswith("../") and f"{shorter}/" in self._folder.folders:
                place = place.removeprefix("../")
        name = self._folder.resolve(base, place, where)
        if name is None:
            return []
        if name.endswith(".txt"):
            return self._listed(name, where)
        if name != "." and f"{name}/" not in self._folder.folders:
            self._inspection.add("missing-file", where, f"{name} is not there")
        return self._folder.below(f"{name}/" if name != "." else "", *IMAGE_SUFFIXES)

    def _listed(self, name: str, where: str) -> list[str]:
        if not self._folder.need(name, where):
            return []
        found = (
            self._folder.resolve(self._part.root, " ".join(words), f"{name} line {line}")
            for line, words in self._folder.rows(name)
        )
        return [image for image in found if image is not None]

    def _splits_of_folders(self) -> list[tuple[str, list[str]]]:
        """Return the images of each folder of `images/`; all are one split if there is none."""
        start = f"{self._part.root}images/"
        splits: dict[str, list[str]] = {}
        for image in self._folder.below(start, *IMAGE_SUFFIXES):
            split, slash, _ = image.removeprefix(start).partition("/")
            splits.setdefault(split if slash else UNSPLIT, []).append(image)
        return list(splits.items())

    def _check_labels(self, name: str, image: str, split: str) -> None:
        if name not in self._folder.files:
            if image in self._folder.files:
                self._inspection.add("missing-label", image, f"{name} is not there")
            return
        seen: set[tuple[str, ...]] = set()
        for line, words in self._folder.rows(name):
            where = f"{name} line {line}"
            if len(words) != _COLUMNS:
                told = f"{len(words)} columns; a box has a class, cx, cy, w, h"
                self._inspection.add("wrong-columns", where, told)
                continue
            if tuple(words) in seen:
                self._inspection.add("duplicate-row", where, " ".join(words))
            seen.add(tuple(words))
            self._check_class(where, words[0], split)
            self._check_sides(where, words[1:])

    def _check_class(self, where: str, word: str, split: str) -> None:
        if not (word.isascii() and word.isdecimal() and len(word) <= 9):
            self._inspection.add("bad-id", where, f"class '{word}' is no whole number from 0")
        elif self._classes is not None and int(word) not in self._classes:
            told = f"class {int(word)}; there are {len(self._classes)}, from 0"
            self._inspection.add("unknown-class", where, told)
        else:
            names = self._classes or {}
            self._part.count_box(names.get(int(word), f"class {int(word)}"), split)

    def _check_sides(self, where: str, words: list[str]) -> None:
        values = [as_finite(word) for word in words]
        if any(map(math.isnan, values)):
            self._inspection.add("not-a-number", where, " ".join(words))
        elif max(values) > 1 + _ROUNDING or min(values) < -_ROUNDING:
            self._inspection.add("share-range", where, f"{' '.join(words)} is not in 0..1")
        else:
            cx, cy, w, h = values
            self._inspection.check_shares(where, (cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2))


def _label_of(image: str) -> str:
    """Return the labels of an image: the last `images` of its path is `labels` there."""
    stem = image.rpartition(".")[0]
    above, found, below = f"/{stem}".rpartition("/images/")
    return (f"{above}/labels/{below}" if found else f"/{stem}").removeprefix("/") + ".txt"
