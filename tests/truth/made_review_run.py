"""A made run of `percept map validate`: a bending road, findings along it, pictures of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from percept.core.map_findings import Kind
from percept.export.discrepancy_table import DISCREPANCIES

__all__ = ["make_review_run"]

_LINES = (  # way, metres left of the road's middle, type, colour, painted
    (101, -8.2, "curbstone", "unknown", False),
    (102, -7.0, "solid", "white", True),
    (103, -3.5, "dashed", "white", True),
    (104, 0.0, "solid_solid", "yellow", True),
    (105, 3.5, "dashed", "white", True),
    (106, 7.0, "solid", "white", True),
    (107, 8.2, "curbstone", "unknown", False),
)
_WORDS = {
    Kind.MISSING_ON_ROAD: ("white dashed line", "no paint"),
    Kind.MISSING_IN_MAP: ("no line", "white solid line"),
    Kind.MOVED: ("white dashed line where the map has it", "0.42 m to the left of the map's line"),
    Kind.TYPE: ("solid", "dashed"),
    Kind.COLOUR: ("yellow", "white"),
    Kind.STOP_LINE_MISSING: ("a stop line", "no bar of paint"),
    Kind.STOP_LINE_MOVED: ("a stop line where the map has it", "a bar 0.80 m beyond it"),
    Kind.LANE_WIDTH: ("lanelet 7 is 3.50 m wide", "3.12 m between its lines"),
    Kind.TRAFFIC_LIGHT_MISSING: ("a traffic light", "none in 14 of 14 looks"),
    Kind.GLOBAL_OFFSET: ("paint where the map has it", "all paint lies 0.31 m to the left"),
}
_LENGTH_M = 1500.0


def make_review_run(
    folder: Path,
    *,
    findings: int = 300,
    pictures: bool = True,
    rows: list[dict[str, Any]] | None = None,
) -> Path:
    """Write a run folder and return it.

    Args:
        folder: Made if it does not exist.
        findings: How many there are.
        pictures: Whether most of them have evidence.
        rows: Values that replace those of the first findings.
    """
    (folder / "evidence").mkdir(parents=True, exist_ok=True)
    made = [_row(number, pictures=pictures) for number in range(findings)]
    for row, values in zip(made, rows or [], strict=False):
        row.update(values)
    if pictures:
        for kind in _WORDS:
            cv2.imwrite(str(folder / "evidence" / f"{kind}.png"), _picture(kind))
    table = pa.Table.from_pylist(made, schema=DISCREPANCIES)
    pq.write_table(table, folder / "discrepancies.parquet")
    (folder / "map_lines.json").write_text(json.dumps({"lines": _lines(), "paths": [_way()]}))
    (folder / "discrepancies.geojson").write_text(json.dumps(_on_earth(made)))
    counts = {"seen_m": 533.4, "not_seen_m": {"out of view": 644.0, "too dark": 80.2}}
    (folder / "run.json").write_text(json.dumps({"inputs": [], "counts": counts}))
    return folder


def _road(along: NDArray[np.float64], left: float) -> NDArray[np.float64]:
    """Return points (K, 2) beside the middle of a road that bends to both sides."""
    y = 60 * np.sin(along / 190)
    slope = 60 / 190 * np.cos(along / 190)
    normal = np.column_stack([-slope, np.ones_like(slope)]) / np.hypot(1, slope)[:, None]
    points: NDArray[np.float64] = np.column_stack([along, y]) + left * normal
    return points


def _lines() -> list[dict[str, Any]]:
    along = np.arange(0.0, _LENGTH_M, 5.0)
    lines: list[dict[str, Any]] = [
        {
            "id": way,
            "kind": "line",
            "type": kind,
            "colour": colour,
            "painted": painted,
            "points": _rounded(_road(along, left)),
        }
        for way, left, kind, colour, painted in _LINES
    ]
    for number, place in enumerate(np.arange(90.0, _LENGTH_M, 120.0)):
        ends = np.vstack([_road(np.array([place]), left) for left in (-6.9, -0.3)])
        lines.append(
            {
                "id": 200 + number,
                "kind": "stop_line",
                "type": "solid",
                "colour": "white",
                "painted": True,
                "points": _rounded(ends),
            }
        )
    return lines


def _way() -> dict[str, Any]:
    return {"drive": 0, "points": _rounded(_road(np.arange(0.0, _LENGTH_M, 2.0), -5.25))}


def _row(number: int, *, pictures: bool) -> dict[str, Any]:
    rng = np.random.default_rng(number)
    kinds = list(_WORDS)
    kind = kinds[-1] if number == 0 else kinds[number % (len(kinds) - 1)]
    expected, observed = _WORDS[kind]
    way, left = [(101 + i, line[1]) for i, line in enumerate(_LINES)][int(rng.integers(1, 6))]
    start, length = rng.uniform(0, _LENGTH_M - 60), rng.uniform(6, 55)
    shift = float(rng.normal(0, 0.5)) if kind is Kind.MOVED else float(rng.normal(0, 0.03))
    along = np.linspace(start, start + length, 12)
    if "stop" in kind:
        way, length = 200 + number % 12, 6.6
        bar = 90.0 + 120.0 * (number % 12) + shift
        points = np.vstack([_road(np.array([bar]), side) for side in (-6.9, -0.3)])
        says = points - [shift, 0.0]
    else:
        points, says = _road(along, left + shift), _road(along, left)
    if kind is Kind.TRAFFIC_LIGHT_MISSING:
        way, length = 300 + number, 0.0
        points = says = _road(np.array([start]), -9.5)
    if kind is Kind.MISSING_IN_MAP:
        way, says = 0, np.zeros((0, 2))
    if kind is Kind.GLOBAL_OFFSET:
        points, says, length, way = np.zeros((0, 2)), np.zeros((0, 2)), 0.0, 0
    middle = points[len(points) // 2] if len(points) else np.full(2, np.nan)
    return {
        "id": f"{kind}-{way}-{number:04d}",
        "kind": str(kind),
        "map_element_id": way,
        "along_m": float(start),
        "offset_m": shift if kind in (Kind.MOVED, Kind.TYPE, Kind.STOP_LINE_MOVED) else None,
        "length_m": float(length),
        "sd_m": 0.04 if kind in (Kind.MOVED, Kind.TYPE, Kind.STOP_LINE_MOVED) else None,
        "observations": int(rng.integers(3, 60)),
        "visits": int(rng.integers(1, 4)),
        "confidence": float(rng.uniform(0.5, 0.99)),
        "expected": expected,
        "observed": observed,
        "evidence": f"evidence/{kind}.png" if pictures and number % 7 != 6 else "",
        "status": "open",
        "x": None if np.isnan(middle[0]) else float(middle[0]),
        "y": None if np.isnan(middle[1]) else float(middle[1]),
        "latitude": None if np.isnan(middle[0]) else _degrees(*middle)[0],
        "longitude": None if np.isnan(middle[0]) else _degrees(*middle)[1],
        "points": json.dumps(_rounded(points)),
        "points_expected": json.dumps(_rounded(says)),
        "drive": int(rng.integers(0, 2)),
        "sensor": "front",
        "stamp_ns": 1_760_000_000_000_000_000 + number * 1_234_000_000,
    }


def _on_earth(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the findings as GeoJSON; the road lies east and north of a place."""
    features = []
    for row in rows:
        places = [_degrees(*point)[::-1] for point in json.loads(row["points"])]
        kind = "Point" if len(places) == 1 else "LineString"
        shape = {"type": kind, "coordinates": places[0] if len(places) == 1 else places}
        features.append({"id": row["id"], "geometry": shape if places else None})
    return {"type": "FeatureCollection", "features": features}


def _degrees(x: float, y: float) -> tuple[float, float]:
    return 43.7822 + y / 111_120, -79.4661 + x / 80_330


def _rounded(points: NDArray[np.float64]) -> list[list[float]]:
    rounded: list[list[float]] = np.round(points, 3).tolist()
    return rounded


def _picture(kind: Kind) -> NDArray[np.uint8]:
    """Return a road in perspective and from above, side by side (418, 1286, 3) BGR."""
    image = np.full((418, 1286, 3), (26, 20, 16), np.uint8)
    camera, above = image[18:, :640], image[18:, 646:]
    camera[:170], camera[170:] = (196, 178, 158), (86, 84, 82)
    above[:] = (86, 84, 82)
    cv2.putText(image, f"{kind}: made", (8, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (200,) * 3, 1)
    white, map_colour, seen = (235, 238, 240), (255, 220, 0), (210, 70, 255)
    for left in (-9.0, -3.0, 3.0, 9.0):
        for near in np.arange(4.0, 60.0, 4.0 if abs(left) < 5 else 2.0):
            far = near + 2.0
            ends = [(int(320 + 420 * left / d), int(170 + 420 * 1.6 / d)) for d in (near, far)]
            cv2.line(camera, ends[0], ends[1], white, max(1, int(30 / near)), cv2.LINE_AA)
        cv2.line(above, (int(320 + 22 * left), 0), (int(320 + 22 * left), 400), white, 3)
    for colour, left in ((map_colour, -2.6), (seen, -3.0)):
        ends = [(int(320 + 420 * left / d), int(170 + 420 * 1.6 / d)) for d in (6.0, 40.0)]
        cv2.line(camera, ends[0], ends[1], colour, 2, cv2.LINE_AA)
        cv2.line(above, (int(320 + 22 * left), 40), (int(320 + 22 * left), 360), colour, 2)
    return image
