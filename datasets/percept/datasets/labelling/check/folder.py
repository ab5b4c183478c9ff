"""The files of a folder, listed once: names from strangers are looked up, never followed."""

from __future__ import annotations

import json
import os
import posixpath
import re
from bisect import bisect_left
from collections.abc import Iterator
from itertools import islice, takewhile
from pathlib import Path
from typing import NamedTuple

from percept.core.errors import InputError
from percept.datasets.labelling.check.problems import Problems
from percept.datasets.labels.boxes import read_text_lines

__all__ = ["Folder", "Listed"]

_LARGEST_JSON_BYTES = 1 << 30
_LARGEST_TEXT_BYTES = 1 << 26
_DRIVE_LETTER = re.compile(r"^[A-Za-z]:")


class Listed(NamedTuple):
    """A file of the folder.

    Attributes:
        size: In bytes.
        place: Device and number: names that share them are one file.
    """

    size: int
    place: tuple[int, int]


class Folder:
    """All files below a folder.

    Links to files inside are files; those that lead outside are reported and not opened. Links to
    folders are not followed.

    Args:
        path: The folder.
        problems: Where to tell.

    Attributes:
        files: What is known of each file, by its name below the folder.
        folders: Names of the folders below it, each with `/` behind.
        named: Files that an entry named, or that were read.

    Raises:
        InputError: If there is no such folder.
    """

    def __init__(self, path: Path, problems: Problems) -> None:
        if not path.is_dir():
            raise InputError("is no folder", where=path)
        self._root = path.resolve()
        self._problems = problems
        self.folders = {""}
        self.files = dict(sorted(self._listed()))
        self._names = list(self.files)
        self.named: set[str] = set()

    def _listed(self) -> Iterator[tuple[str, Listed]]:
        for above, folders, names in os.walk(self._root, onerror=self._unread):
            base = Path(above).relative_to(self._root).as_posix()
            for name in folders:
                where = posixpath.normpath(f"{base}/{name}")
                if Path(above, name).is_symlink():
                    self._problems.add("outside-folder", where, "a link to a folder")
                else:
                    self.folders.add(f"{where}/")
            for name in names:
                inside = posixpath.normpath(f"{base}/{name}")
                if self._is_inside(Path(above, name), inside):
                    known = Path(above, name).stat()
                    yield inside, Listed(known.st_size, (known.st_dev, known.st_ino))

    def _unread(self, error: OSError) -> None:
        name = Path(str(error.filename)).name
        self._problems.add("unreadable-file", name, f"the folder cannot be read ({error.strerror})")

    def _is_inside(self, path: Path, name: str) -> bool:
        try:
            if path.is_symlink() and not path.resolve().is_relative_to(self._root):
                self._problems.add("outside-folder", name, "a link that leads out of the folder")
                return False
            return path.is_file()
        except (OSError, RuntimeError):  # links that lead to themselves
            return False

    def path(self, name: str) -> Path:
        """Return the path of a file that is listed."""
        if name not in self.files:
            raise KeyError(name)
        return self._root / name

    def below(self, start: str, *suffixes: str) -> list[str]:
        """Return the files whose names begin with `start`, with one of the suffixes if given."""
        first = bisect_left(self._names, start)
        alike = takewhile(lambda name: name.startswith(start), islice(self._names, first, None))
        return [name for name in alike if not suffixes or name.lower().endswith(suffixes)]

    def resolve(self, base: str, name: object, where: str) -> str | None:
        """Return the name below the folder of a file that an entry names, or report it.

        Args:
            base: What the name is relative to: empty, or ends with `/`.
            name: What the entry says.
            where: The entry.

        Returns:
            The name; None where it leads out of the folder, or is none.
        """
        if not isinstance(name, str) or not name or "\0" in name:
            self._problems.add("malformed", where, f"'{name}' is no name of a file")
            return None
        slashed = name.replace("\\", "/")
        inside = posixpath.normpath(base + slashed)
        if slashed.startswith("/") or _DRIVE_LETTER.match(name) or inside.split("/")[0] == "..":
            self._problems.add("outside-folder", where, f"'{name}'")
            return None
        return inside

    def need(self, name: str, where: str) -> bool:
        """Return whether a file is there that an entry names; report it if not."""
        self.named.add(name)
        if name in self.files:
            return True
        self._problems.add("missing-file", where, f"{name} is not there")
        return False

    def json(self, name: str) -> object:
        """Return the content of a JSON file; None, and a report, where there is none."""
        self.named.add(name)
        try:
            if self.files[name].size > _LARGEST_JSON_BYTES:
                raise ValueError("is larger than 1 GiB")
            content: object = json.loads(self.path(name).read_bytes())
            return content
        except KeyError:
            self._problems.add("missing-file", name, "is not there")
        except RecursionError:
            self._problems.add("unreadable-file", name, "has lists in lists without end")
        except (OSError, ValueError) as error:
            self._problems.add("unreadable-file", name, f"no JSON ({error})")
        return None

    def text(self, name: str) -> str:
        """Return the content of a text file; empty, and a report, where it is none."""
        self.named.add(name)
        try:
            if self.files[name].size > _LARGEST_TEXT_BYTES:
                raise ValueError("is larger than 64 MiB")
            return self.path(name).read_text("utf-8-sig")
        except KeyError:
            self._problems.add("missing-file", name, "is not there")
        except (OSError, ValueError) as error:
            self._problems.add("unreadable-file", name, f"no text ({error})")
        return ""

    def rows(self, name: str) -> list[tuple[int, list[str]]]:
        """Return the lines of a text file that are not empty: number from 1, and words."""
        self.named.add(name)
        try:
            return read_text_lines(self.path(name))
        except KeyError:
            self._problems.add("missing-file", name, "is not there")
        except InputError as error:
            self._problems.add("unreadable-file", name, error.what)
        return []
