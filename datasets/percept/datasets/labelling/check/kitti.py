"""Checks KITTI: the object benchmark and the tracking benchmark."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence

from percept.datasets.labelling.check.inspection import UNSPLIT, Inspection, Part, as_finite
from percept.datasets.labelling.check.pictures import IMAGE_SUFFIXES

__all__ = ["check_kitti", "check_kitti_tracking", "holds_kitti", "holds_kitti_tracking"]

_TYPES = frozenset(
    ("Car", "Van", "Truck", "Pedestrian", "Person_sitting", "Person", "Cyclist", "Tram", "Misc")
)
_IGNORED = "DontCare"
_COLUMNS = 15
_UNKNOWN_SOLID = (-1.0, -1.0, -1.0)
_CALIBRATION = {"P2": 12}
_MOST_LINES = 1_000_000


def holds_kitti(inspection: Inspection, root: str) -> bool:
    """Return whether a folder holds the object benchmark."""
    return _training(inspection, root, "label_2") is not None


def holds_kitti_tracking(inspection: Inspection, root: str) -> bool:
    """Return whether a folder holds the tracking benchmark."""
    return _training(inspection, root, "label_02") is not None


def check_kitti(inspection: Inspection, root: str) -> None:
    """Check samples: image, labels, calibration and scan of each."""
    _Samples(inspection, inspection.part(root, "kitti")).check()


def check_kitti_tracking(inspection: Inspection, root: str) -> None:
    """Check sequences: images, labels, calibration and scans of each."""
    _Sequences(inspection, inspection.part(root, "kitti-tracking")).check()


def _training(inspection: Inspection, root: str, labels: str) -> str | None:
    """Return the folder that holds labels: `training/`, or the folder itself."""
    places = (f"{root}training/", root)
    return next((p for p in places if f"{p}{labels}/" in inspection.folder.folders), None)


class _Rows:
    """What lines of both benchmarks have in common."""

    def __init__(self, inspection: Inspection, part: Part, labels: str) -> None:
        self._inspection = inspection
        self._folder = inspection.folder
        self._part = part
        self._top = _training(inspection, part.root, labels) or part.root
        self._types = self._read_types()

    def _read_types(self) -> dict[str, str] | None:
        """Return our name of each type of `classes.csv`; None where there is no such file."""
        name = f"{self._part.root}classes.csv"
        if name not in self._folder.files:
            return None
        self._folder.named.add(name)
        lines = self._folder.text(name).splitlines()[:_MOST_LINES]
        try:
            rows = [row for row in csv.reader(lines) if row]
        except csv.Error:
            rows = []
        if not rows or rows[0] != ["type", "label"] or any(len(row) != 2 for row in rows):
            self._inspection.add("malformed", name, "no table of types and labels")
            return None
        self._inspection.check_unique(name, (row[0] for row in rows[1:]), "type")
        self._part.classes[name] = tuple(row[1] for row in rows[1:])
        return {row[0]: row[1] for row in rows[1:]}

    def _check_row(
        self, where: str, words: Sequence[str], size: tuple[int, int] | None, split: str
    ) -> None:
        """Check the 15 columns of a box, and the score behind them."""
        values = [as_finite(word) for word in words[1:]]
        if any(map(math.isnan, values)):
            self._inspection.add("not-a-number", where, " ".join(words))
            return
        self._check_type(where, words[0], split)
        self._inspection.check_box(where, values[3:7], size)
        if words[0] != _IGNORED and tuple(values[7:10]) != _UNKNOWN_SOLID:
            self._inspection.check_solid(where, [*values[10:13], *values[7:10], values[13]])
            self._part.solids += 1

    def _check_type(self, where: str, word: str, split: str) -> None:
        if word == _IGNORED:
            return
        if self._types is not None and word not in self._types:
            self._inspection.add("unknown-class", where, f"type '{word}' is not in classes.csv")
        elif self._types is None and word not in _TYPES:
            self._inspection.add("other-class", where, f"type '{word}'")
        self._part.count_box((self._types or {}).get(word, word), split)

    def _check_calibration(self, name: str, where: str) -> None:
        if not self._folder.need(name, where):
            return
        found = {}
        for line, words in self._folder.rows(name):
            found[words[0].rstrip(":")] = len(words) - 1
            if any(math.isnan(as_finite(word)) for word in words[1:]):
                self._inspection.add("not-a-number", f"{name} line {line}", words[0])
        for key, number in _CALIBRATION.items():
            if found.get(key) != number:
                told = f"{key} has {found.get(key, 0)} numbers, not {number}"
                self._inspection.add("malformed", name, told)

    def _check_scan(self, name: str, where: str) -> None:
        if self._folder.need(name, where) and self._folder.files[name].size % 16:
            self._inspection.add("malformed", name, "is no rows of four float32")

    def _has(self, folder: str) -> bool:
        return f"{self._top}{folder}/" in self._folder.folders

    def _stems(self, folder: str, *suffixes: str) -> dict[str, str]:
        start = f"{self._top}{folder}/"
        names = self._folder.below(start, *suffixes)
        return {name[len(start) :].rpartition(".")[0]: name for name in names}


class _Samples(_Rows):
    def __init__(self, inspection: Inspection, part: Part) -> None:
        super().__init__(inspection, part, "label_2")

    def check(self) -> None:
        """Check everything."""
        splits = self._read_splits()
        labels, images = self._stems("label_2", ".txt"), self._stems("image_2", *IMAGE_SUFFIXES)
        for stem in sorted({*labels, *images, *splits}):
            split = splits.get(stem, UNSPLIT)
            image = images.get(stem, f"{self._top}image_2/{stem}.png")
            where = f"{self._part.name} sample {stem}"
            self._inspection.list_image(self._part, image, split, where)
            if stem not in labels:
                self._inspection.add("missing-label", where, "label_2 has no such file")
            else:
                self._check_labels(labels[stem], image, split)
            if self._has("calib"):
                self._check_calibration(f"{self._top}calib/{stem}.txt", where)
            if self._has("velodyne"):
                self._check_scan(f"{self._top}velodyne/{stem}.bin", where)
        for image in self._folder.below(f"{self._part.root}testing/", *IMAGE_SUFFIXES, ".bin"):
            self._folder.named.add(image)  # without labels by intention

    def _read_splits(self) -> dict[str, str]:
        """Return the split of each sample; one in two is reported."""
        start = f"{self._part.root}ImageSets/"
        splits: dict[str, str] = {}
        for name in self._folder.below(start, ".txt"):
            split = name[len(start) :].removesuffix(".txt")
            if split == "trainval":
                continue
            self._part.stated.add(split)
            for line, words in self._folder.rows(name):
                known = splits.setdefault(words[0], split)
                if known != split:
                    told = f"{words[0]} is of {known} too"
                    self._inspection.add("split-differs", f"{name} line {line}", told)
        return splits

    def _check_labels(self, name: str, image: str, split: str) -> None:
        size = self._inspection.size_of(image)
        seen: set[tuple[str, ...]] = set()
        for line, words in self._folder.rows(name):
            where = f"{name} line {line}"
            if len(words) not in (_COLUMNS, _COLUMNS + 1):
                told = f"{len(words)} columns; a box has 15, and 16 with its score"
                self._inspection.add("wrong-columns", where, told)
                continue
            if tuple(words) in seen:
                self._inspection.add("duplicate-row", where, " ".join(words[:8]))
            seen.add(tuple(words))
            self._check_row(where, words, size, split)


class _Sequences(_Rows):
    def __init__(self, inspection: Inspection, part: Part) -> None:
        super().__init__(inspection, part, "label_02")

    def check(self) -> None:
        """Check everything."""
        splits = self._read_splits()
        labels = self._stems("label_02", ".txt")
        images = self._stems("image_02", *IMAGE_SUFFIXES)
        scans = self._stems("velodyne", ".bin")
        frames_of: dict[str, list[str]] = {}
        for stem in images:
            frames_of.setdefault(stem.partition("/")[0], []).append(stem)
        for name in sorted({*frames_of, *labels}):
            split, where = splits.get(name, UNSPLIT), f"{self._part.name} sequence {name}"
            frames = frames_of.get(name, [])
            for stem in frames:
                self._inspection.list_image(self._part, images[stem], split, where)
                if self._has("velodyne"):
                    self._check_scan(scans.get(stem, f"{self._top}velodyne/{stem}.bin"), where)
            if self._has("calib"):
                self._check_calibration(f"{self._top}calib/{name}.txt", where)
            if name not in labels:
                self._inspection.add("missing-label", where, "label_02 has no such file")
            elif not frames:
                self._inspection.add("stray-label", labels[name], "image_02 has no such sequence")
            else:
                by_frame = {stem.partition("/")[2]: images[stem] for stem in frames}
                self._check_labels(labels[name], by_frame, split)
        self._part.splits.clear()  # each sequence numbers its images from 0

    def _read_splits(self) -> dict[str, str]:
        start = f"{self._top}evaluate_tracking.seqmap."
        splits: dict[str, str] = {}
        for name in self._folder.below(start):
            split = name[len(start) :]
            self._part.stated.add(split)
            splits |= {words[0]: split for _, words in self._folder.rows(name)}
        return splits

    def _check_labels(self, name: str, images: dict[str, str], split: str) -> None:
        sizes = {stem: self._inspection.size_of(image) for stem, image in images.items()}
        seen: set[tuple[str, str]] = set()
        for line, words in self._folder.rows(name):
            where = f"{name} line {line}"
            if len(words) not in (_COLUMNS + 2, _COLUMNS + 3):
                told = f"{len(words)} columns; a box has 17, and 18 with its score"
                self._inspection.add("wrong-columns", where, told)
                continue
            frame, track = words[0], words[1]
            stem = f"{frame:0>6}"
            if stem not in images:
                self._inspection.add("unknown-id", where, f"frame {frame} has no image")
            if words[2] != _IGNORED and (frame, track) in seen:
                self._inspection.add("duplicate-id", where, f"track {track} in frame {frame}")
            seen.add((frame, track))
            self._check_row(where, words[2:], sizes.get(stem), split)
