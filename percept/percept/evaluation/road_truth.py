"""Paint of a road as a GeoJSON file tells it: `truth/markings.geojson` of synthetic drives."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError

__all__ = ["RoadMarking", "read_road_markings"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RoadMarking:
    """A line or stop line of the road.

    Attributes:
        kind: `line` or `stop_line`.
        type: Type of a line in the words of Lanelet2.
        colour: Its colour.
        points_map: (K, 3) float64 in the map frame: the middle of a line's paint, the near edge
            of a stop line.
    """

    kind: str
    type: str
    colour: str
    points_map: NDArray[np.float64]


def read_road_markings(path: Path) -> list[RoadMarking]:
    """Read the paint of a road.

    Raises:
        InputError: If the file is no such GeoJSON.
    """
    try:
        features = json.loads(path.read_text(encoding="utf-8"))["features"]
        return [_marking(feature["properties"]) for feature in features]
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=path) from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"holds no markings ({error})", where=path) from error


def _marking(properties: dict[str, object]) -> RoadMarking:
    points = np.array(properties["points_m"], dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2 or not np.isfinite(points).all():
        raise ValueError(f"points_m of {properties.get('map_element_id')} are no line")
    return RoadMarking(
        kind=str(properties["kind"]),
        type=str(properties["type"]),
        colour=str(properties["colour"]),
        points_map=points,
    )
