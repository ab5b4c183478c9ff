"""A map as GeoJSON (RFC 7946): longitude, latitude and altitude on WGS 84."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.hdmap import Georeference, HdMap

__all__ = ["map_geojson"]

_F64 = NDArray[np.float64]
_DIGITS = 9  # 0.1 mm
_NO_TAGS: Mapping[str, str] = {}


def map_geojson(hd_map: HdMap) -> str:
    """Return the markings, lanelets, areas and lights of a map as one FeatureCollection.

    Properties are `element`, `id`, what it is, and `tags` as the map has them.

    Raises:
        InputError: If the map does not say where it lies.
    """
    if hd_map.georeference is None:
        raise InputError(
            "the map does not say where on the earth it lies, which GeoJSON needs",
            remedy="Give the origin of its frame with --origin LAT,LON,ALT",
        )
    features = [*_features(hd_map, hd_map.georeference)]
    document = {"type": "FeatureCollection", "features": features}
    return json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n"


def _features(hd_map: HdMap, georeference: Georeference) -> Iterator[dict[str, Any]]:
    for marking in hd_map.markings:
        tags = hd_map.line_strings[marking.element_id].tags
        line = _positions(georeference, marking.points_map)
        yield _feature(
            {"type": "LineString", "coordinates": line},
            "marking",
            marking.element_id,
            tags,
            kind=marking.kind,
            type=marking.type,
            colour=marking.colour,
            painted=marking.painted,
            width_m=None if math.isnan(marking.width_m) else marking.width_m,
            name=marking.name,
        )
    for lanelet in hd_map.lanelets.values():
        ring = _ring(georeference, np.concatenate([lanelet.right_map, lanelet.left_map[::-1]]))
        yield _feature(ring, "lanelet", lanelet.lanelet_id, lanelet.tags, subtype=lanelet.subtype)
    for area in hd_map.areas.values():
        yield _feature(_ring(georeference, area.outer_map), "area", area.area_id, area.tags)
    for light in hd_map.lights:
        face = _positions(georeference, light.corners_map.mean(axis=0)[None])
        yield _feature(
            {"type": "Point", "coordinates": face[0]},
            "traffic_light",
            light.light_id,
            hd_map.line_strings[light.light_id].tags,
            bulbs=list(light.bulbs),
            rules=list(light.group_ids),
        )


def _feature(
    geometry: dict[str, Any],
    element: str,
    identity: int,
    tags: Mapping[str, str] = _NO_TAGS,
    **said: object,
) -> dict[str, Any]:
    properties = {"element": element, "id": identity, **said, "tags": dict(tags)}
    return {"type": "Feature", "id": identity, "geometry": geometry, "properties": properties}


def _positions(georeference: Georeference, points_map: _F64) -> list[list[float]]:
    geodetic = georeference.geodetic(points_map)[:, [1, 0, 2]]
    rounded: list[list[float]] = np.column_stack(
        [np.round(geodetic[:, :2], _DIGITS), np.round(geodetic[:, 2], 3)]
    ).tolist()
    return rounded


def _ring(georeference: Georeference, outline_map: _F64) -> dict[str, Any]:
    """Return an outline (K, 3) as a polygon: closed, and counterclockwise as RFC 7946 has it."""
    x, y = outline_map[:, 0] - outline_map[0, 0], outline_map[:, 1] - outline_map[0, 1]
    if float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) < 0:
        outline_map = outline_map[::-1]
    closed = np.concatenate([outline_map, outline_map[:1]])
    return {"type": "Polygon", "coordinates": [_positions(georeference, closed)]}
