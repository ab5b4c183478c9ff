"""The lines of a map and the ways of the drives, for the page on which findings are decided."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.trajectory import Trajectory
from percept.hdmap.elements import MapMarking

__all__ = ["write_map_lines"]

_STEP_M = 1.0


def write_map_lines(
    path: Path, markings: Sequence[MapMarking], ways: Sequence[Trajectory], reach_m: float = 200.0
) -> None:
    """Write `map_lines.json`, metres in the map frame; it gets its name when it is whole.

    Args:
        path: The file.
        markings: Lines and bars of the map.
        ways: `T_map_base` of each drive.
        reach_m: Lines that are further from every way are left out.
    """
    paths = [_thinned(way.matrices[:, :2, 3]) for way in ways]
    lines = [
        {
            "id": marking.element_id,
            "kind": marking.kind,
            "type": marking.type,
            "colour": marking.colour,
            "painted": marking.painted,
            "points": np.round(marking.points_map[:, :2], 3).tolist(),
        }
        for marking in markings
        if _is_near(marking.points_map[:, :2], paths, reach_m)
    ]
    content = {
        "lines": lines,
        "paths": [
            {"drive": number, "points": np.round(points, 3).tolist()}
            for number, points in enumerate(paths)
        ],
    }
    unfinished = path.with_name(f".{path.name}.unfinished")
    unfinished.write_text(json.dumps(content, allow_nan=False) + "\n", encoding="utf-8")
    unfinished.replace(path)


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points of a way about a metre apart, and its last one."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    keep = np.unique(np.searchsorted(along, np.arange(0.0, along[-1], _STEP_M)))
    return np.vstack([points[keep], points[-1:]])


def _is_near(
    points: NDArray[np.float64], paths: Sequence[NDArray[np.float64]], reach_m: float
) -> bool:
    """Return whether the rectangles around a line and around a way are near; yes without ways."""
    low, high = points.min(axis=0) - reach_m, points.max(axis=0) + reach_m
    return not paths or any(
        bool((path.max(axis=0) >= low).all() and (path.min(axis=0) <= high).all()) for path in paths
    )
