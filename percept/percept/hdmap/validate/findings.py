"""Findings as they are built: places, looks and words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.map_findings import Discrepancy, Kind, Look
from percept.hdmap.validate.stations import MapLine, Stations

__all__ = ["Reporter", "best_looks", "chance_beyond", "finding_id", "looks_factor"]

_MOST_LOOKS = 3
_ID_STEP_M = 5.0
_POINT_EVERY = 4


@dataclass(frozen=True, slots=True)
class Reporter:
    """Makes findings about stretches of lines of the map.

    Attributes:
        stations: Of the map's lines.
        sensors: Names of the sensors by number.
    """

    stations: Stations
    sensors: Sequence[str]

    def on_line(
        self,
        kind: Kind,
        line: MapLine,
        span: tuple[int, int],
        rows: NDArray[np.void],
        *,
        confidence: float,
        expected: str,
        observed: str,
        offset_m: float = math.nan,
        sd_m: float = math.nan,
    ) -> Discrepancy:
        """Return a finding about the stations `span` of a line.

        Args:
            kind: Of the finding.
            line: Of the map.
            span: First and one past the last station, counted from the line's first.
            rows: Sums of all stations of the line.
            confidence: How sure it is.
            expected: What the map says.
            observed: What was seen.
            offset_m: Of the paint to the left of the line.
            sd_m: Spread of that.
        """
        first, last = span
        chosen = np.arange(first, last)[::_POINT_EVERY]
        chosen = np.unique([*chosen.tolist(), last - 1]) + line.first
        expected_points = self.stations.points[chosen]
        seen = expected_points.copy()
        if math.isfinite(offset_m):
            seen[:, :2] += offset_m * self.stations.normals[chosen]
        along = first * line.step_m
        return Discrepancy(
            finding_id=finding_id(kind, line.marking.element_id, along),
            kind=kind,
            map_element_id=line.marking.element_id,
            along_m=along,
            offset_m=offset_m,
            length_m=(last - first) * line.step_m,
            sd_m=sd_m,
            observations=int(np.median(rows["looks"][first:last])),
            visits=int(rows["passes"][first:last].max()),
            confidence=float(np.clip(confidence, 0.0, 1.0)),
            expected=expected,
            observed=observed,
            points_map=seen,
            points_expected_map=expected_points,
            looks=best_looks(rows[first:last], self.sensors),
        )


def finding_id(kind: Kind, element_id: int, *place_m: float) -> str:
    """Return a name that is the same in another run for the same thing at the same place."""
    rounded = [str(round(value / _ID_STEP_M)) for value in place_m]
    return "-".join([kind.value, str(element_id), *rounded])


def best_looks(rows: NDArray[np.void], sensors: Sequence[str]) -> tuple[Look, ...]:
    """Return the looks that saw the places of rows best: the middle first, then both ends."""
    seen = np.flatnonzero(rows["looks"] > 0)
    if not len(seen):
        return ()
    wanted = [seen[len(seen) // 2], seen[0], seen[-1]]
    looks = [
        Look(
            int(rows["best_drive"][row]),
            sensors[int(rows["best_sensor"][row])],
            int(rows["best_ns"][row]),
            float(rows["best_range_m"][row]),
        )
        for row in wanted
    ]
    return tuple(dict.fromkeys(looks))[:_MOST_LOOKS]


def chance_beyond(value: float, limit: float, sd: float) -> float:
    """Return the probability that what was measured as `value` is beyond a limit."""
    return 0.5 * (1.0 + math.erf((abs(value) - limit) / (math.sqrt(2.0) * max(sd, 1e-6))))


def looks_factor(looks: float) -> float:
    """Return how far so many looks are to be trusted, 0..1."""
    return looks / (looks + 1.0)
