"""What map and road disagree about, as a table: `discrepancies.parquet`."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from percept.core.map_findings import Discrepancy, Kind, Status
from percept.export.table_reader import read_batches

__all__ = [
    "DISCREPANCIES",
    "DiscrepancyRow",
    "degrees_of",
    "discrepancy_rows",
    "middle_of",
    "read_discrepancies",
]

_MAY_LACK = ("offset_m", "sd_m", "latitude", "longitude")

DISCREPANCIES = pa.schema(
    [
        ("id", pa.string()),
        ("kind", pa.string()),
        ("map_element_id", pa.int64()),
        *((name, pa.float64()) for name in ("along_m", "offset_m", "length_m", "sd_m")),
        ("observations", pa.int64()),
        ("visits", pa.int64()),
        ("confidence", pa.float64()),
        ("expected", pa.string()),
        ("observed", pa.string()),
        ("evidence", pa.string()),
        ("status", pa.string()),
        *((name, pa.float64()) for name in ("x", "y", "latitude", "longitude")),
        ("points", pa.string()),
        ("points_expected", pa.string()),
        ("drive", pa.int64()),
        ("sensor", pa.string()),
        ("stamp_ns", pa.int64()),
    ]
)
"""Columns of `discrepancies.parquet`: a row for each finding, the surest first.

Metres in the map frame; see `percept.core.map_findings.Discrepancy`. `map_element_id` is 0 where
the map has no such element. `offset_m` and `sd_m` are null where they mean nothing, `latitude` and
`longitude` where nothing tells where the map lies. `evidence` is a picture beside the table, empty
where there is none. `x`, `y` are the middle of the finding; `points` and `points_expected` are JSON
lists of `[x, y]`: what was seen, and what the map says. `drive`, `sensor` and `stamp_ns` are
the look at which it is seen best; without one they are -1, empty and 0.
"""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DiscrepancyRow:
    """A row of the table, read back.

    Attributes:
        finding_id: Its `id`.
        kind: In what way map and road disagree.
        map_element_id: 0 where the map has no such element.
        along_m: From the start of the element.
        offset_m: NaN where it means nothing.
        length_m: Length of the stretch.
        confidence: 0..1.
        x_m: Middle of the finding in the map frame.
        y_m: The same.
        status: What a person said.
        points_m: (K, 2) float64 what was seen, in the map frame.
    """

    finding_id: str
    kind: Kind
    map_element_id: int
    along_m: float
    offset_m: float
    length_m: float
    confidence: float
    x_m: float
    y_m: float
    status: Status
    points_m: NDArray[np.float64]


def discrepancy_rows(
    findings: Sequence[Discrepancy],
    evidence: Mapping[str, str],
    places: NDArray[np.float64] | None,
) -> pa.RecordBatch:
    """Return findings as rows with the schema `DISCREPANCIES`, in their order.

    Args:
        findings: N findings.
        evidence: Picture by finding's id, relative to the table.
        places: (N, 2) degrees north and east of their middles; None where that is not known.
    """
    middles = np.array([middle_of(finding) for finding in findings]).reshape(-1, 3)
    degrees = np.full((len(findings), 2), np.nan) if places is None else places
    first = [finding.looks[0] if finding.looks else None for finding in findings]
    values = [
        [f.finding_id for f in findings],
        [str(f.kind) for f in findings],
        [f.map_element_id for f in findings],
        *([getattr(f, name) for f in findings] for name in DISCREPANCIES.names[3:10]),
        [f.expected for f in findings],
        [f.observed for f in findings],
        [evidence.get(f.finding_id, "") for f in findings],
        [str(f.status) for f in findings],
        *middles.T[:2],
        *degrees.T,
        [_as_json(f.points_map) for f in findings],
        [_as_json(f.points_expected_map) for f in findings],
        [-1 if look is None else look.drive for look in first],
        ["" if look is None else look.sensor for look in first],
        [0 if look is None else look.stamp_ns for look in first],
    ]
    arrays = [
        pa.array(column, type=field.type, from_pandas=True)  # NaN, which means nothing, is null
        for column, field in zip(values, DISCREPANCIES, strict=True)
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=DISCREPANCIES)


def degrees_of(
    findings: Sequence[Discrepancy],
    geodetic: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None,
) -> NDArray[np.float64] | None:
    """Return latitude and longitude (N, 2) of the middles of findings; None where not known.

    Args:
        findings: N findings.
        geodetic: Makes (N, 3) degrees north, degrees east and metres of points (N, 3) of the map.
    """
    if geodetic is None:
        return None
    middles = np.array([middle_of(finding) for finding in findings]).reshape(-1, 3)
    return geodetic(middles)[:, :2]


def middle_of(finding: Discrepancy) -> NDArray[np.float64]:
    """Return the middle (3,) of a finding in the map frame."""
    points = finding.points_map if len(finding.points_map) else finding.points_expected_map
    if not len(points):
        return np.full(3, np.nan)
    steps = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    middle: NDArray[np.float64] = np.array(
        [np.interp(along[-1] / 2, along, points[:, axis]) for axis in range(3)]
    )
    return middle


def read_discrepancies(path: Path) -> list[DiscrepancyRow]:
    """Return the rows of a `discrepancies.parquet`.

    Raises:
        InputError: If the file is no such table.
    """
    rows = [
        row
        for batch in read_batches(path, DISCREPANCIES, may_lack=_MAY_LACK)
        for row in batch.to_pylist()
    ]
    return [
        DiscrepancyRow(
            finding_id=row["id"],
            kind=Kind(row["kind"]),
            map_element_id=row["map_element_id"],
            along_m=row["along_m"],
            offset_m=np.nan if row["offset_m"] is None else row["offset_m"],
            length_m=row["length_m"],
            confidence=row["confidence"],
            x_m=row["x"],
            y_m=row["y"],
            status=Status(row["status"]),
            points_m=np.array(json.loads(row["points"]), dtype=np.float64).reshape(-1, 2),
        )
        for row in rows
    ]


def _as_json(points_map: NDArray[np.float64]) -> str:
    return json.dumps(np.round(points_map[:, :2], 3).tolist(), separators=(",", ":"))
