"""The ways in which a table of numbers could be boxes, and what speaks against each.

The shape of a table allows some readings, by the number of grid cells that a network of its input
size has. What it holds for a plain grey and for a textured picture rules out the wrong ones: boxes
of negative size, probabilities above one, hundreds of objects in plain grey. Where it holds objects
even for these, they are looked at before the background is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.detection.networks.cells import STRIDES, count_cells

__all__ = ["Reading", "objection", "possible_readings", "two_classes_at_once"]

Table = NDArray[np.float64]

_MAX_LISTED = 1000  # rows of a list of finished boxes; grids have more, unless the input is small
_TOLERANCE = 2e-3  # of a probability in half precision
_SEEN = 0.25  # score of an object that would be reported
_MAX_SEEN = 20, 0.02  # objects in plain grey, and as a share of all cells
_MAX_ID = 10_000  # of a class
_MAX_NEGATIVE = 0.25  # share of boxes of negative size
_MAX_SHARE = 1.5  # of the picture; a box in pixels is larger
_MAX_OFFSET = 8.0  # cells, that nearly all raw boxes lie within
_MAX_LOG = 6.0  # of a raw box's size in cells: exp(6) cells are thousands of pixels


@dataclass(frozen=True, slots=True)
class Reading:
    """One way to read a table.

    Attributes:
        name: Of the layout.
        class_count: Number of classes that it then has; None where the table does not tell.
        why: What the shape says for it.
    """

    name: str
    class_count: int | None
    why: str


def possible_readings(shape: Sequence[int], size: tuple[int, int]) -> list[Reading]:
    """Return the readings that the (A, B) shape of a table allows.

    Args:
        shape: Of the table without its batch axis.
        size: (width, height) of the network's input.
    """
    rows, columns = shape
    found: dict[tuple[str, int | None], Reading] = {}

    def add(name: str, class_count: int | None, why: str) -> None:
        if class_count is None or class_count > 0:
            found.setdefault((name, class_count), Reading(name, class_count, why))

    for strides in STRIDES:
        cells = count_cells(size, strides)
        grid = f"the {cells} cells of the strides {', '.join(map(str, strides))}"
        if columns == cells:
            add("v8", rows - 4, f"a column for each of {grid}")
        if rows == cells:
            add("v8-last", columns - 4, f"a row for each of {grid}")
            add("v5", columns - 5, f"a row for each of {grid}, and an objectness")
            add("yolox", columns - 5, f"a row for each of {grid}, and raw offsets")
        if rows == 3 * cells:
            add("v5", columns - 5, f"a row for each of three anchors in {grid}")
    if rows <= _MAX_LISTED:
        if columns == 6:
            add("end2end", None, f"{rows} finished boxes")
            add("rt-detr-end2end", None, f"{rows} finished boxes in shares of the picture")
        if not any(name == "v8" for name, _ in found):  # whose cells are no classes
            add("rt-detr", columns - 4, f"{rows} boxes in shares of the picture")
    return list(found.values())


def objection(reading: Reading, grey: Table, textured: Table, size: tuple[int, int]) -> str | None:
    """Return what speaks against a reading, or None.

    Args:
        reading: One of `possible_readings`.
        grey: The table for a plain grey picture, (A, B).
        textured: The same for a textured one.
        size: (width, height) of the network's input.
    """
    if reading.name == "v8":
        grey, textured = grey.T, textured.T
    for table in (grey, textured):
        if not np.isfinite(table).all():
            return "it holds infinite numbers or none at all"
        if against := _OBJECTIONS[reading.name](table, size):
            return against
    return None if reading.class_count is None else _sees_in_grey(reading.name, grey)


def _improbable(values: Table, what: str) -> str | None:
    if values.min() >= -_TOLERANCE and values.max() <= 1 + _TOLERANCE:
        return None
    return f"its {what} would be {values.min():.3g} to {values.max():.3g}"


def _no_boxes(table: Table, scores: Table, size: tuple[int, int]) -> str | None:
    """Object to boxes that are not centre, width and height in pixels.

    Objects are larger than a logarithm of their size, or a share of the picture, could be. Where
    there are none, the boxes of the background still lie all over the picture.
    """
    if _mostly_negative(table[:, 2:4]):
        return f"its boxes would have sizes down to {table[:, 2:4].min():.3g} pixels"
    if (seen := scores > _SEEN).any():
        largest = table[seen, 2:4].max()
        return f"its boxes would reach only {largest:.3g} pixels" if largest <= _MAX_LOG else None
    reach = table[:, :2].max(axis=0)
    if (reach < np.array(size) / 4).any():
        return f"its boxes would reach only to {reach[0]:.3g}, {reach[1]:.3g} pixels"
    return None


def _mostly_negative(sizes: Table) -> bool:
    """Tell whether no network would put out such sizes; some do for background (YOLO26)."""
    return bool((sizes < 0).any(axis=1).mean() > _MAX_NEGATIVE)


def _against_v8(table: Table, size: tuple[int, int]) -> str | None:
    boxes_at_fault = _no_boxes(table, table[:, 4:].max(axis=1), size)
    return _improbable(table[:, 4:], "class probabilities") or boxes_at_fault


def _against_v5(table: Table, size: tuple[int, int]) -> str | None:
    boxes_at_fault = _no_boxes(table, _with_objectness(table), size)
    return _improbable(table[:, 4:], "probabilities") or boxes_at_fault


def _against_yolox(table: Table, _: tuple[int, int]) -> str | None:
    offset = float(np.quantile(np.abs(table[:, :2]), 0.95))
    if offset > _MAX_OFFSET:
        return f"its offsets would be {offset:.3g} cells"
    if table[:, 2:4].max() > _MAX_LOG:
        return f"its boxes would be exp({table[:, 2:4].max():.3g}) cells large"
    if table[:, :4].min() >= 0 and table[:, :4].max() <= 1:
        return "its offsets and logarithms of sizes would all lie in 0..1"
    return _improbable(table[:, 4:], "probabilities")


def _are_numbers(ids: Table) -> bool:
    """Tell whether a column may hold class numbers."""
    return bool((ids == np.rint(ids)).all() and ids.min() >= 0 and ids.max() < _MAX_ID)


def _against_end2end(table: Table, _: tuple[int, int]) -> str | None:
    if not _are_numbers(table[:, 5]):
        return "its last column is no class number"
    if 0 < table[:, :4].max() <= _MAX_SHARE:
        return f"its boxes would all lie in the first {table[:, :4].max():.3g} pixels"
    if _mostly_negative(table[:, 2:4] - table[:, :2]):
        return "its boxes would have negative sizes"
    return _improbable(table[:, 4], "scores")


def _against_rt_detr(table: Table, _: tuple[int, int]) -> str | None:
    if table.shape[1] == 6 and _are_numbers(table[:, 5]):
        return "its last column holds class numbers"
    return _no_shares(table) or _improbable(table[:, 4:], "class probabilities")


def _against_rt_detr_end2end(table: Table, _: tuple[int, int]) -> str | None:
    if not _are_numbers(table[:, 5]):
        return "its last column is no class number"
    return _no_shares(table) or _improbable(table[:, 4], "scores")


def _no_shares(table: Table) -> str | None:
    if not table[:, :4].any():
        return "its boxes would all be empty"
    if table[:, :4].min() < -0.1 or table[:, :4].max() > _MAX_SHARE:
        return f"its boxes reach to {table[:, :4].max():.3g}, which is no share of a picture"
    return None


def _sees_in_grey(name: str, grey: Table) -> str | None:
    """Object to a reading by which there are objects all over a plain grey picture.

    So an angle (in a network for rotated boxes) is told from a class probability, and an
    objectness from a class: where it is low, the class probabilities mean nothing.
    """
    scores = _with_objectness(grey) if name in ("v5", "yolox") else grey[:, 4:].max(axis=1)
    seen = int((scores > _SEEN).sum())
    if seen <= max(_MAX_SEEN[0], _MAX_SEEN[1] * len(scores)):
        return None
    return f"it would see {seen} objects in a plain grey picture"


def _with_objectness(table: Table) -> Table:
    scores: Table = table[:, 4] * table[:, 5:].max(axis=1)
    return scores


def two_classes_at_once(table: Table) -> bool:
    """Tell whether the first or last class is none, by the objects in an (N, 4 + classes) table.

    Where each object would be of this class and of another, with probabilities that add up to
    more than one, it is an objectness (the first one) or an angle (the last).
    """
    scores = table[:, 4:]
    seen = scores[scores.max(axis=1) > _SEEN]
    if not len(seen) or seen.shape[1] < 2:
        return False
    for one, others in ((seen[:, 0], seen[:, 1:]), (seen[:, -1], seen[:, :-1])):
        best = others.max(axis=1)
        if ((np.minimum(one, best) > _SEEN) & (one + best > 1)).all():
            return True
    return False


_OBJECTIONS: dict[str, Callable[[Table, tuple[int, int]], str | None]] = {
    "v8": _against_v8,
    "v8-last": _against_v8,
    "v5": _against_v5,
    "yolox": _against_yolox,
    "end2end": _against_end2end,
    "rt-detr": _against_rt_detr,
    "rt-detr-end2end": _against_rt_detr_end2end,
}
