"""How a fault is planted into a data set: files changed as hands and tools change them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

__all__ = [
    "Fault",
    "Plant",
    "change_file",
    "change_json",
    "change_table",
    "change_text",
    "cut_off",
    "put",
    "put_same",
    "scale_down",
    "word",
]

Plant = Callable[[Path], object]
"""What plants a fault into a folder."""


class Fault(NamedTuple):
    """A fault: what is done to a folder, which code has to be found, and where."""

    code: str
    where: str
    plant: Plant


def change_json(name: str, change: Callable[[Any], object]) -> Plant:
    """Return what changes a JSON file; what `change` returns is the new content, if it does."""

    def plant(folder: Path) -> None:
        path = next(iter(sorted(folder.glob(name))))
        content = json.loads(path.read_text("utf-8"))
        changed = change(content)
        new = changed if isinstance(changed, dict | list) else content
        path.write_text(json.dumps(new), "utf-8")

    return plant


def change_table(name: str, change: Callable[[list[dict[str, Any]]], object]) -> Plant:
    def plant(folder: Path) -> None:
        path = folder / f"{name}.parquet"
        table = pq.read_table(path)
        rows = table.to_pylist()
        change(rows)
        pq.write_table(pa.Table.from_pylist(rows, schema=table.schema), path)

    return plant


def change_text(name: str, change: Callable[[str], str]) -> Plant:
    def plant(folder: Path) -> None:
        # The first that is not empty: an image without boxes has an empty file.
        path = next(path for path in sorted(folder.glob(name)) if path.stat().st_size)
        path.write_text(change(path.read_text("utf-8")), "utf-8")

    return plant


def change_file(name: str, change: Callable[[Path], object]) -> Plant:
    return lambda folder: change(next(iter(sorted(folder.glob(name)))))


def cut_off(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])


def scale_down(path: Path) -> None:
    cv2.imwrite(str(path), cv2.resize(_pixels(path), (160, 100)))


def put_same(source: str, target: str, *, change: bool = False) -> Plant:
    """Return what puts the first image of one place in the place of the first of another."""

    def plant(folder: Path) -> None:
        first, other = sorted(folder.glob(source))[0], sorted(folder.glob(target))[-1]
        if not change:
            other.write_bytes(first.read_bytes())
            return
        pixels = _pixels(first).astype(np.int16)
        noise = np.random.default_rng(3).integers(-3, 4, pixels.shape)
        cv2.imwrite(str(other), np.clip(pixels + noise + 4, 0, 255).astype(np.uint8))

    return plant


def word(number: int, word: str) -> Callable[[str], str]:
    """Return what replaces a word of the first line; an empty one goes."""

    def change(text: str) -> str:
        first, *rest = text.splitlines()
        words = first.split()
        words[number] = word
        return "\n".join([" ".join(w for w in words if w), *rest]) + "\n"

    return change


def put(row: Any, key: Any, value: object) -> None:
    row[key] = value


def _pixels(path: Path) -> NDArray[np.uint8]:
    return np.asarray(cv2.imread(str(path)), np.uint8)
