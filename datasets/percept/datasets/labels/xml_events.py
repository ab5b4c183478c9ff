"""XML of strangers, element by element: without entities, without the network, without a tree."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol
from xml.parsers import expat

from percept.core.errors import InputError

__all__ = ["ElementHandler", "read_elements"]

_LARGEST_FILE_BYTES = 1 << 30
_LONGEST_TEXT = 1 << 16
_DEEPEST = 100


class ElementHandler(Protocol):
    """What is told of each element; a path is the names from the root to the element."""

    def begins(self, path: tuple[str, ...], attributes: Mapping[str, str]) -> None:
        """Take the beginning of an element."""

    def ends(self, path: tuple[str, ...], text: str) -> None:
        """Take the end of an element, and the text that stands after its last child."""


def read_elements(file: Path, handler: ElementHandler) -> None:
    """Give the elements of a file to a handler, in their order.

    A document type is refused: with it go all entities, and with these all bombs and all other
    files.

    Raises:
        InputError: If the file cannot be read, is larger than 1 GiB, is no XML, or has a document
            type.
    """
    events = _Events(file, handler)
    try:
        if file.stat().st_size > _LARGEST_FILE_BYTES:
            raise InputError("is larger than 1 GiB", where=file, remedy="Split it")
        with file.open("rb") as stream:
            events.parser.ParseFile(stream)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=file) from error
    except (expat.ExpatError, ValueError, LookupError) as error:  # encodings that are none
        raise InputError(f"is no XML ({error})", where=file) from error


class _Events:
    def __init__(self, file: Path, handler: ElementHandler) -> None:
        self._file = file
        self._handler = handler
        self._path: list[str] = []
        self._text: list[str] = []
        self._length = 0
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._begin
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._take
        self.parser.StartDoctypeDeclHandler = self._refuse

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        self._path.append(name)
        if len(self._path) > _DEEPEST:
            raise InputError(f"has elements more than {_DEEPEST} deep", where=self._file)
        self._clear()
        self._handler.begins(tuple(self._path), attributes)

    def _end(self, _name: str) -> None:
        self._handler.ends(tuple(self._path), "".join(self._text).strip())
        self._path.pop()
        self._clear()

    def _take(self, text: str) -> None:
        self._length += len(text)
        if self._length <= _LONGEST_TEXT:
            self._text.append(text)

    def _clear(self) -> None:
        self._text.clear()
        self._length = 0

    def _refuse(self, *_: object) -> None:
        raise InputError(
            "has a document type, which labels have not and which can hide other files",
            where=self._file,
        )
