"""Lines and stop lines of images as plain JSON, as a table, and drawn over their image."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from percept.core.lane_markings import LaneDetections, LaneLine, StopLineSeen
from percept.export.canvas import Image, Rgb, write_text

__all__ = ["LANES", "lane_document", "lane_overlay", "lane_rows"]

_SIDES: dict[str, Rgb] = {"left": (230, 70, 60), "right": (50, 190, 80), "other": (70, 150, 235)}
_STOP: Rgb = (225, 70, 225)
_GUESSED = 0.1  # confidence of a line that was placed beside another one

LANES = pa.schema(
    [
        ("image", pa.string()),
        ("stamp_ns", pa.int64()),
        ("line", pa.int64()),
        ("kind", pa.string()),
        ("side", pa.string()),
        ("type", pa.string()),
        ("colour", pa.string()),
        ("confidence", pa.float64()),
        ("u_px", pa.float64()),
        ("v_px", pa.float64()),
        ("x", pa.float64()),
        ("y", pa.float64()),
        ("sd_m", pa.float64()),
    ]
)
"""Columns of `lanes.parquet`: a row for each point of each line; `kind` is `line` or `stop_line`.

Places and spreads in metres are null where the scale is not known.
"""


def lane_document(found: LaneDetections) -> dict[str, Any]:
    """Return what was found in one image as values that JSON has; unknown ones are null."""
    return {
        "lines": [_line(line) for line in found.lines],
        "stop_lines": [_stop_line(stop) for stop in found.stop_lines],
        "lane_width_m": _number(found.lane_width_m),
        "pitch_deg": _number(float(np.degrees(found.pitch_rad))),
        "notes": list(found.notes),
    }


def _line(line: LaneLine) -> dict[str, Any]:
    return {
        "side": line.side,
        "points_px": _points(line.points_px, 2),
        "points_m": _points(line.points_m, 3),
        "colour": line.colour,
        "type": line.type,
        "sd_m": np.round(line.sd_m, 4).tolist(),
        "width_m": _number(line.width_m),
        "confidence": _number(line.confidence),
    }


def _stop_line(stop: StopLineSeen) -> dict[str, Any]:
    return {
        "points_px": _points(stop.points_px, 2),
        "points_m": _points(stop.points_m, 3) if np.isfinite(stop.points_m).all() else [],
        "distance_m": _number(stop.distance_m),
        "sd_m": _number(stop.sd_m),
        "width_m": _number(stop.width_m),
        "confidence": _number(stop.confidence),
    }


def _points(points: NDArray[np.float64], digits: int) -> list[list[float]]:
    rounded: list[list[float]] = np.round(points, digits).tolist()
    return rounded


def _number(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else round(float(value), 4)


def lane_rows(image: str, stamp_ns: int | None, found: LaneDetections) -> pa.RecordBatch:
    """Return what was found in one image as rows with the schema `LANES`."""
    rows: list[dict[str, Any]] = []
    for k, line in enumerate(found.lines):
        kind = {"line": k, "kind": "line", "side": line.side, "type": line.type}
        kind |= {"colour": line.colour, "confidence": line.confidence}
        rows += _point_rows(kind, line.points_px, line.points_m, line.sd_m)
    for k, stop in enumerate(found.stop_lines, start=len(found.lines)):
        kind = {"line": k, "kind": "stop_line", "confidence": stop.confidence}
        placed = stop.points_m if np.isfinite(stop.points_m).all() else np.zeros((0, 2))
        rows += _point_rows(kind, stop.points_px, placed, np.full(len(placed), stop.sd_m))
    named = [{"image": image, "stamp_ns": stamp_ns, **row} for row in rows]
    return pa.RecordBatch.from_pylist(named, schema=LANES)


def _point_rows(
    kind: dict[str, Any],
    points_px: NDArray[np.float64],
    points_m: NDArray[np.float64],
    sd_m: NDArray[np.float64],
) -> Iterable[dict[str, Any]]:
    for k, (u, v) in enumerate(points_px.tolist()):
        metres = (
            {"x": float(points_m[k, 0]), "y": float(points_m[k, 1]), "sd_m": float(sd_m[k])}
            if len(points_m)
            else {}
        )
        yield {**kind, "u_px": u, "v_px": v, **metres}


def lane_overlay(image: Image, found: LaneDetections) -> Image:
    """Return an image (H, W, 3) BGR with the lines, their types and colours, and stop lines.

    The left line is red, the right one green, others blue; a line that was placed beside another
    one without paint is thin.
    """
    drawn = image.copy()
    thick = max(2, image.shape[1] // 320)
    for line in found.lines:
        colour = _SIDES.get(line.side, _SIDES["other"])[::-1]
        course = np.round(line.points_px).astype(np.int32)[None]
        width = 1 if line.confidence <= _GUESSED else thick
        cv2.polylines(drawn, list(course), isClosed=False, color=colour, thickness=width)
    for stop in found.stop_lines:
        ends = [tuple(round(c) for c in point) for point in stop.points_px.tolist()]
        cv2.line(drawn, ends[0], ends[1], _STOP[::-1], thick, cv2.LINE_AA)
    for k, text in enumerate(_words(found)):
        write_text(drawn, text, (8, 18 + 16 * k))
    return drawn


def _words(found: LaneDetections) -> list[str]:
    lines = [
        f"{line.side}: {line.type} {line.colour}, {line.confidence:.2f}"
        for line in found.lines
        if line.side != "other"
    ]
    if found.lane_width_m is not None:
        lines.append(f"lane width {found.lane_width_m:.2f} m")
    return lines + [
        f"stop line at {stop.distance_m:.1f} m, sd {stop.sd_m:.1f} m"
        if np.isfinite(stop.distance_m)
        else "stop line"
        for stop in found.stop_lines
    ]
