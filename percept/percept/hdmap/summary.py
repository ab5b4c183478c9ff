"""What a map holds, as numbers."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.polyline import length_m
from percept.hdmap.elements import Lanelet
from percept.hdmap.georeference import Georeference
from percept.hdmap.map import HdMap
from percept.hdmap.participants import may_pass

__all__ = ["summarise_map"]

_F64 = NDArray[np.float64]
_YES = ("yes", "true")


def summarise_map(hd_map: HdMap) -> dict[str, Any]:
    """Return what a map holds: counts, lengths in metres, where it lies, and what was left out.

    A line string or lanelet that could not be used is not counted but named in `dropped`.
    """
    ways = hd_map.line_strings.values()
    points = hd_map.points.xyz_map
    return {
        "points": len(points),
        "linestrings": len(hd_map.line_strings),
        "polygons": sum(way.tags.get("area") in _YES for way in ways),
        "lanelets": len(hd_map.lanelets),
        "areas": len(hd_map.areas),
        "regulatory_elements": len(hd_map.rules),
        "traffic_lights": len(hd_map.lights),
        "linestrings_by_type": _counts(way.tags for way in ways),
        "lanelets_by_subtype": _sorted(Counter(ll.subtype for ll in hd_map.lanelets.values())),
        "regulatory_elements_by_subtype": _sorted(
            Counter(rule.subtype for rule in hd_map.rules.values())
        ),
        "markings": _markings(hd_map),
        "lane_km": round(sum(map(_length_of_lane, hd_map.lanelets.values())) / 1000, 4),
        "extent_m": _extent(points, "xyz", 3),
        "extent_deg": _extent_on_earth(hd_map.georeference, points),
        "origin": _place(hd_map.georeference) if hd_map.origin is not None else None,
        "georeference": _georeference(hd_map.georeference),
        "dropped": dict(hd_map.dropped.most_common()),
    }


def _counts(tags: Iterable[Mapping[str, str]]) -> dict[str, int]:
    words = (f"{one.get('type', '')} {one.get('subtype', '')}".strip() for one in tags)
    return _sorted(Counter(words))


def _sorted(counts: Counter[str]) -> dict[str, int]:
    return {word or "none": count for word, count in counts.most_common()}


def _markings(hd_map: HdMap) -> list[dict[str, Any]]:
    """Return numbers and lengths of markings by what they are, the longest first."""
    numbers: Counter[tuple[str, str, str, bool]] = Counter()
    lengths: defaultdict[tuple[str, str, str, bool], float] = defaultdict(float)
    for marking in hd_map.markings:
        key = marking.kind, marking.type, marking.colour, marking.painted
        numbers[key] += 1
        lengths[key] += length_m(marking.points_map)
    names = ("kind", "type", "colour", "painted")
    return [
        {
            **dict(zip(names, key, strict=True)),
            "count": numbers[key],
            "length_m": round(lengths[key], 2),
        }
        for key in sorted(lengths, key=lambda key: -lengths[key])
    ]


def _length_of_lane(lanelet: Lanelet) -> float:
    """Return the length of a lanelet for vehicles, 0 of others."""
    return lanelet.length_m if may_pass(lanelet.tags, "vehicle") else 0.0


def _extent(points: _F64, names: Iterable[str], digits: int) -> dict[str, list[float]]:
    low, high = points.min(axis=0), points.max(axis=0)
    ends = np.round(np.column_stack([low, high]), digits).tolist()
    return dict(zip(names, ends, strict=False))


def _extent_on_earth(
    georeference: Georeference | None, points: _F64
) -> dict[str, list[float]] | None:
    if georeference is None:
        return None
    return _extent(georeference.geodetic(points)[:, :2], ("latitude", "longitude"), 7)


def _place(georeference: Georeference | None) -> dict[str, float] | None:
    if georeference is None:
        return None
    frame = georeference.frame
    return {
        "latitude": frame.latitude_deg,
        "longitude": frame.longitude_deg,
        "altitude": frame.altitude_m,
    }


def _georeference(georeference: Georeference | None) -> dict[str, Any] | None:
    place = _place(georeference)
    if georeference is None or place is None:
        return None
    return {
        **place,
        "rotation_deg": float(np.degrees(georeference.rotation_rad)),
        "scale": georeference.scale,
        "residual_m": georeference.residual_m,
        "points": georeference.points,
    }
