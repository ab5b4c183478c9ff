"""What map and road disagree about as GeoJSON (RFC 7946), for JOSM, QGIS and MapRoulette."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.map_findings import Discrepancy

__all__ = ["write_discrepancies_geojson"]

_PLACES = 9  # digits of degrees: a tenth of a millimetre

Geodetic = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def write_discrepancies_geojson(
    path: Path,
    findings: Sequence[Discrepancy],
    evidence: Mapping[str, str],
    geodetic: Geodetic | None,
) -> None:
    """Write findings as a feature collection; the file gets its name when it is whole.

    A feature is what was seen, or for what is missing on the road the stretch of the map; its
    properties are the columns of `discrepancies.parquet`. Without a place on earth features have
    no geometry, as RFC 7946 (3.2) allows, and the points stay in `points_m`.

    Args:
        path: The file.
        findings: The findings.
        evidence: Picture by finding's id, relative to the file.
        geodetic: Makes (N, 3) degrees north, degrees east and metres of points (N, 3) of the map
            frame; None where nothing tells where the map lies.
    """
    features = [_feature(f, evidence.get(f.finding_id, ""), geodetic) for f in findings]
    collection = {"type": "FeatureCollection", "features": features}
    unfinished = path.with_name(f".{path.name}.unfinished")
    unfinished.write_text(
        json.dumps(collection, indent=1, allow_nan=False) + "\n", encoding="utf-8"
    )
    unfinished.replace(path)


def _feature(finding: Discrepancy, evidence: str, geodetic: Geodetic | None) -> dict[str, Any]:
    look = finding.looks[0] if finding.looks else None
    return {
        "type": "Feature",
        "id": finding.finding_id,
        "geometry": None if geodetic is None else _geometry(geodetic(finding.points_map)),
        "properties": {
            "kind": str(finding.kind),
            "map_element_id": finding.map_element_id,
            "along_m": round(finding.along_m, 3),
            "offset_m": _number(finding.offset_m),
            "length_m": round(finding.length_m, 3),
            "sd_m": _number(finding.sd_m),
            "observations": finding.observations,
            "visits": finding.visits,
            "confidence": round(finding.confidence, 4),
            "expected": finding.expected,
            "observed": finding.observed,
            "evidence": evidence,
            "status": str(finding.status),
            "points_m": np.round(finding.points_map, 3).tolist(),
            "points_expected_m": np.round(finding.points_expected_map, 3).tolist(),
            "drive": None if look is None else look.drive,
            "sensor": None if look is None else look.sensor,
            "stamp_ns": None if look is None else look.stamp_ns,
        },
    }


def _geometry(geodetic: NDArray[np.float64]) -> dict[str, Any] | None:
    """Return the geometry of points (N, 3): longitude first."""
    places = np.round(geodetic[:, [1, 0]], _PLACES).tolist()
    if not places:
        return None
    if len(places) == 1:
        return {"type": "Point", "coordinates": places[0]}
    return {"type": "LineString", "coordinates": places}


def _number(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None
