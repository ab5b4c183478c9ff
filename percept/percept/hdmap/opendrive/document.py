"""OpenDRIVE files as trees of elements, without document types, and the numbers in them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from lxml import etree

from percept.core.errors import InputError
from percept.hdmap.osm import parse_file

__all__ = ["Numbers", "read_document"]


def read_document(path: Path) -> etree._Element:
    """Return the root of a file; names of elements are without their namespace.

    Raises:
        InputError: If the file cannot be read, has a document type, or is no OpenDRIVE file.
    """
    target = _Tree(path)
    parse_file(path, target)
    return target.root()


class _Tree:
    """Builds the tree of a file, and refuses it at once where it is not what it has to be."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._builder = etree.TreeBuilder()
        self._depth = 0

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Refuse the document: a map needs no document type, an attack does."""
        del name, public, system
        raise InputError("has a document type, which maps do not have", where=self._path)

    def start(self, tag: str, attributes: Mapping[str | bytes, str | bytes]) -> None:
        """Begin an element; the root has to be `OpenDRIVE`."""
        name = tag.rpartition("}")[2]
        if not self._depth and name != "OpenDRIVE":
            raise InputError(f"is no OpenDRIVE file; its root is <{name}>", where=self._path)
        self._depth += 1
        self._builder.start(name, dict(attributes))

    def end(self, tag: str) -> None:
        """End an element."""
        self._depth -= 1
        self._builder.end(tag.rpartition("}")[2])

    def data(self, data: str) -> None:
        """Take text: a georeference is one."""
        self._builder.data(data)

    def close(self) -> None:
        """End the document, whether it is whole or was refused."""

    def root(self) -> etree._Element:
        """Return the root once the document has ended."""
        return self._builder.close()


class Numbers:
    """Reads numbers of elements, and says where one is none.

    Args:
        path: The file, for messages.
        place: Such as `road 7`.
    """

    def __init__(self, path: Path, place: str) -> None:
        self._path = path
        self._place = place

    def number(self, element: etree._Element, name: str, default: float | None = None) -> float:
        """Return an attribute as a finite number; the default where it is not there.

        Raises:
            InputError: If it is no number, or not there and has no default.
        """
        text = element.get(name)
        if text is None and default is not None:
            return default
        try:
            number = float(text or "")
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise self.error(f"{element.tag} {name}='{(text or '')[:40]}' is no number")
        return number

    def numbers(self, element: etree._Element, names: str) -> tuple[float, ...]:
        """Return several attributes, their names parted by blanks; 0 for what is not there."""
        return tuple(self.number(element, name, 0.0) for name in names.split())

    def error(self, what: str) -> InputError:
        """Return an error that names the file and the place in it."""
        return InputError(f"{self._place}: {what}", where=self._path)
