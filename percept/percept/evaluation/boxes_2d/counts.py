"""Precision and recall at one confidence threshold, and where a class has its best F1."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from percept.evaluation.bands import RANGE_BANDS, range_band
from percept.evaluation.boxes_2d.coco import SIZES
from percept.evaluation.boxes_2d.result import Counts
from percept.evaluation.boxes_2d.tables import Compared, DetectionTable, TruthTable

__all__ = [
    "HEIGHT_BANDS",
    "best_threshold",
    "counts_by_height",
    "counts_by_range",
    "counts_by_size",
    "counts_of",
]

_HEIGHT_EDGES_PX = (10.0, 25.0, 40.0, 80.0, 160.0)  # 25 and 40 are where KITTI begins to count
HEIGHT_BANDS = ("0-10 px", "10-25 px", "25-40 px", "40-80 px", "80-160 px", "160+ px")
"""Bands of the height of a box; an edge belongs to the band above it."""

_UNKNOWN = "unknown"
_Table = TruthTable | DetectionTable


def counts_of(compared: Compared, label: int | None) -> Counts:
    """Return the counts of a class, or of all together (None)."""
    made, wanted = compared.made, compared.truth.counted
    if label is not None:
        made = made & (compared.found.label == label)
        wanted = wanted & (compared.truth.label == label)
    return Counts(int(wanted.sum()), int(made.sum()), int((made & compared.hit).sum()))


def counts_by_size(compared: Compared) -> dict[str, Counts]:
    """Return the counts by COCO's sizes."""
    edges = [high for _, high in SIZES.values()][:-1]

    def names(table: _Table) -> list[str]:
        sides = table.boxes_px[:, 2:] - table.boxes_px[:, :2]
        return [[*SIZES][bisect.bisect_left(edges, area)] for area in sides[:, 0] * sides[:, 1]]

    return _by_band(compared, names, tuple(SIZES))


def counts_by_height(compared: Compared) -> dict[str, Counts]:
    """Return the counts by `HEIGHT_BANDS`."""

    def names(table: _Table) -> list[str]:
        heights = table.boxes_px[:, 3] - table.boxes_px[:, 1]
        return [HEIGHT_BANDS[bisect.bisect_right(_HEIGHT_EDGES_PX, h)] for h in heights]

    return _by_band(compared, names, HEIGHT_BANDS)


def counts_by_range(compared: Compared) -> dict[str, Counts]:
    """Return the counts by distance; empty where no object has one."""
    if not np.isfinite(compared.truth.range_m[compared.truth.counted]).any():
        return {}

    def names(table: _Table) -> list[str]:
        return [range_band(r) if math.isfinite(r) else _UNKNOWN for r in table.range_m]

    counts = _by_band(compared, names, (*RANGE_BANDS, _UNKNOWN))
    if np.isfinite(compared.found.range_m).any():
        return counts
    # Only those that are an object have a place here: a precision of 1 would be a lie.
    return {
        band: n if band == _UNKNOWN else Counts(n.objects, None, n.hits)
        for band, n in counts.items()
    }


def best_threshold(compared: Compared, label: int) -> tuple[float, float]:
    """Return the confidence with the highest F1 of a class, and F1; NaN where there is none."""
    wanted = int((compared.truth.counted & (compared.truth.label == label)).sum())
    rows = np.flatnonzero(compared.matches.counted & (compared.found.label == label))
    if not wanted or not len(rows):
        return float("nan"), float("nan")
    rows = rows[np.argsort(-compared.found.score[rows], kind="stable")]
    scores = compared.found.score[rows]
    f1 = 2 * np.cumsum(compared.hit[rows]) / (wanted + np.arange(1, len(rows) + 1))
    last_of_tie = np.append(scores[1:] < scores[:-1], True)
    best = int(np.argmax(np.where(last_of_tie, f1, -1.0)))
    return float(scores[best]), float(f1[best])


def _by_band(
    compared: Compared, names: Callable[[_Table], list[str]], bands: tuple[str, ...]
) -> dict[str, Counts]:
    """Count by the band of the object, and of the detection where that is no object."""
    wanted: NDArray[np.str_] = np.array(names(compared.truth), dtype=str)
    band_of: NDArray[np.str_] = np.array(names(compared.found), dtype=str)
    made, hit = compared.made, compared.hit
    band_of[hit] = wanted[compared.matches.truth[hit]]
    counts = {
        band: Counts(
            int((compared.truth.counted & (wanted == band)).sum()),
            int((made & (band_of == band)).sum()),
            int((made & hit & (band_of == band)).sum()),
        )
        for band in bands
    }
    return {band: n for band, n in counts.items() if n.objects or n.detections}
