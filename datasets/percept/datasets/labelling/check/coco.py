"""Checks COCO: files of instances, and their images."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from percept.datasets.labelling.check.inspection import Inspection, Part
from percept.datasets.labels.boxes import as_number

__all__ = ["check_coco", "holds_coco"]

_LISTS = ("images", "annotations", "categories")
_PREFIX, _FOLDER = "instances_", "annotations"
_SNIFFED = 1 << 16
_LIST = re.compile(rb'"(images|annotations|categories)"\s*:\s*\[')
_LARGEST_SIDE = 1_000_000


def holds_coco(inspection: Inspection, root: str) -> bool:
    """Return whether a folder holds COCO."""
    return bool(_documents(inspection, root))


def check_coco(inspection: Inspection, root: str) -> None:
    """Check the files of instances in a folder, and the images that they list."""
    part = inspection.part(root, "coco")
    ids: list[object] = []
    for name in _documents(inspection, root):
        ids += _Document(inspection, part, name).check()
    inspection.check_unique(part.name, ids, "annotation id")


def _documents(inspection: Inspection, root: str) -> list[str]:
    """Return `annotations/*.json`; else the JSON files beside images that begin as COCO does."""
    below = inspection.folder.below(root, ".json")
    found = [name for name in below if name[len(root) :].startswith(f"{_FOLDER}/")]
    if found:
        return found
    shallow = [name for name in below if name[len(root) :].count("/") <= 1]
    return [name for name in shallow if _begins_as_coco(inspection, name)]


def _begins_as_coco(inspection: Inspection, name: str) -> bool:
    if "coco" in name.lower() or name.rpartition("/")[2].startswith(_PREFIX):
        return True
    try:
        with inspection.folder.path(name).open("rb") as file:
            head = file.read(_SNIFFED)
    except OSError:
        return False
    return _LIST.search(head) is not None


class _Document:
    def __init__(self, inspection: Inspection, part: Part, name: str) -> None:
        self._inspection = inspection
        self._part = part
        self._name = name
        self._split = _split_of(name, part.root)
        part.stated.add(self._split)
        self._images: dict[object, tuple[int, int] | None] = {}
        self._categories: dict[object, str] = {}

    def check(self) -> list[object]:
        """Check the document; return the ids of its annotations."""
        document = self._inspection.folder.json(self._name)
        if document is None:
            return []
        if not isinstance(document, dict) or not all(
            isinstance(document.get(key), list) for key in _LISTS
        ):
            told = "no object with lists of images, annotations and categories"
            self._inspection.add("malformed", self._name, told)
            return []
        self._read_categories(document)
        self._read_images(document)
        return [
            self._annotation(where, one) for where, one in self._entries(document, "annotations")
        ]

    def _entries(self, document: dict[str, Any], key: str) -> Iterator[tuple[str, dict[str, Any]]]:
        for index, entry in enumerate(document[key]):
            where = f"{self._name} {key}[{index}]"
            if isinstance(entry, dict):
                yield where, entry
            else:
                self._inspection.add("malformed", where, "is no object")

    def _id(self, where: str, entry: dict[str, Any]) -> object:
        """Return the id of an entry: a whole number; None where it has none that can be used."""
        number = entry.get("id")
        if isinstance(number, bool) or not isinstance(number, int) or number < 0:
            self._inspection.add("bad-id", where, f"id {number!r} is no whole number from 1")
            return None
        return number

    def _read_categories(self, document: dict[str, Any]) -> None:
        found = []
        for where, entry in self._entries(document, "categories"):
            number, label = self._id(where, entry), entry.get("name")
            if not isinstance(label, str):
                self._inspection.add("malformed", where, "has no name")
            elif number is not None:
                self._zero(where, number)
                self._categories[number] = label
                found.append(number)
        self._inspection.check_unique(self._name, found, "category id")
        self._inspection.check_unique(self._name, self._categories.values(), "category")
        order = sorted(self._categories, key=lambda number: as_number(number))
        self._part.classes[self._name] = tuple(self._categories[number] for number in order)

    def _zero(self, where: str, number: object) -> None:
        if number == 0:
            self._inspection.add("id-zero", where, "id 0")

    def _read_images(self, document: dict[str, Any]) -> None:
        ids, names = [], []
        for where, entry in self._entries(document, "images"):
            number, size = self._id(where, entry), self._size(where, entry)
            if number is not None:
                self._zero(where, number)
                self._images[number] = size
                ids.append(number)
            file = self._locate(where, entry.get("file_name"))
            if file is not None:
                self._inspection.list_image(self._part, file, self._split, where, size=size)
                names.append(file)
        self._inspection.check_unique(self._name, ids, "image id")
        self._inspection.check_unique(self._name, names, "image")

    def _size(self, where: str, entry: dict[str, Any]) -> tuple[int, int] | None:
        sides = entry.get("width"), entry.get("height")
        width, height = map(as_number, sides)
        if 1 <= width <= _LARGEST_SIDE and 1 <= height <= _LARGEST_SIDE:
            return int(width), int(height)
        self._inspection.add("malformed", where, "has no width and height above 0")
        return None

    def _locate(self, where: str, name: object) -> str | None:
        """Return the file of an image: in the folder of the split, of images, or beside."""
        root, beside = self._part.root, self._name.rpartition("/")[0]
        bases = [f"{root}images/{self._split}/", f"{root}images/", f"{root}{self._split}/", root]
        bases.append(f"{beside}/" if beside else "")
        first = self._inspection.folder.resolve(bases[0], name, where)
        if first is None or not isinstance(name, str):
            return None
        files = self._inspection.folder.files
        return next((b + name for b in bases if b + name in files), first)

    def _annotation(self, where: str, entry: dict[str, Any]) -> object:
        number, category = self._id(where, entry), entry.get("category_id")
        if number == 0:
            told = "id 0: pycocotools takes its matches for none"
            self._inspection.add("bad-id", where, told)
        image = entry.get("image_id")
        known = isinstance(image, int | str) and image in self._images
        if not known:
            self._inspection.add("unknown-id", where, f"image_id {image!r}")
        label = self._categories.get(category) if isinstance(category, int | str) else None
        if label is None:
            self._inspection.add("unknown-class", where, f"category_id {category!r}")
        else:
            self._part.count_box(label, self._split)
        self._box(where, entry.get("bbox"), self._images[image] if known else None)
        return where if number is None else number

    def _box(self, where: str, box: object, size: tuple[int, int] | None) -> None:
        if not isinstance(box, list) or len(box) != 4:
            self._inspection.add("malformed", where, "bbox is no list of x, y, width, height")
            return
        x, y, width, height = map(as_number, box)
        self._inspection.check_box(where, (x, y, x + width, y + height), size)


def _split_of(name: str, root: str) -> str:
    """Return the split that a file's name says; beside images, the folder's."""
    above, _, last = name[len(root) :].rpartition("/")
    if above and above != _FOLDER:
        return above
    return last.rpartition(".")[0].removeprefix(_PREFIX)
