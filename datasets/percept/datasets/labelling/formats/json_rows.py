"""Long lists of JSON, written row by row."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any, TextIO

__all__ = ["write_rows"]


def write_rows(file: TextIO, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write a list of objects, one a line, without holding them all.

    Letters beyond ASCII are escaped: pycocotools and others open files in the encoding of the
    machine that they run on.

    Args:
        file: Where to.
        rows: The objects; none of their numbers may be NaN or infinite.
    """
    file.write("[")
    for count, row in enumerate(rows):
        file.write(",\n" if count else "\n")
        file.write(json.dumps(row, allow_nan=False))
    file.write("\n]")
