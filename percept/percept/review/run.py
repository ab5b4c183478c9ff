"""A run of `percept map validate` as the review needs it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from percept.core.errors import InputError
from percept.core.map_findings import Decision, Kind, Status

__all__ = ["Finding", "Line", "MapLines", "ReviewRun", "read_run"]

_REMEDY = "Give the --out folder of a finished `percept map validate`"
_TEXTS = ("id", "kind", "expected", "observed", "evidence", "status", "points", "points_expected",
          "sensor")  # fmt: skip
_WHOLE = ("map_element_id", "observations", "visits", "drive", "stamp_ns")
_NUMBERS = ("along_m", "offset_m", "length_m", "sd_m", "confidence", "x", "y", "latitude",
            "longitude")  # fmt: skip
_MAY_LACK = ("offset_m", "sd_m", "x", "y", "latitude", "longitude")
_MOST_FINDINGS = 100_000

_Points = tuple[tuple[float, float], ...]

_SEVERITY: Mapping[Kind, float] = {
    Kind.GLOBAL_OFFSET: 1.0,  # everything else depends on it
    Kind.TRAFFIC_LIGHT_MISSING: 1.0,
    Kind.TRAFFIC_LIGHT_MISSING_IN_MAP: 1.0,
    Kind.STOP_LINE_MISSING: 0.9,
    Kind.STOP_LINE_MISSING_IN_MAP: 0.9,
    Kind.STOP_LINE_MOVED: 0.9,
    Kind.MOVED: 0.8,
    Kind.MISSING_ON_ROAD: 0.7,
    Kind.MISSING_IN_MAP: 0.7,
    Kind.TYPE: 0.7,  # who may change lanes
    Kind.LANE_WIDTH: 0.6,
    Kind.COLOUR: 0.5,
}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Finding:
    """A row of `discrepancies.parquet`; metres in the map frame.

    Attributes:
        finding_id: Stable over runs.
        kind: In what way map and road disagree.
        map_element_id: 0 where the map has no such element.
        along_m: From the start of the element to the start of the stretch.
        offset_m: See `percept.core.map_findings.Discrepancy`; NaN where it means nothing.
        length_m: Length of the stretch.
        sd_m: NaN where it means nothing.
        observations: Looks at the place.
        visits: Drives, or passes of one, that saw it.
        confidence: 0..1.
        expected: What the map says, in words.
        observed: What was seen, in words.
        evidence: Picture, relative to the run; empty without one.
        status: What an earlier review said.
        x_m: Middle of it; NaN for one without a place.
        y_m: The same.
        latitude_deg: Of the middle; NaN where that is not known.
        longitude_deg: The same.
        points_m: K pairs x, y of what was seen, or of the map where the road has nothing.
        points_expected_m: K pairs x, y of what the map says.
        drive: Of the best look, from 0; -1 without one.
        sensor: Of the best look.
        stamp_ns: Of the best look, since 1970; 0 without one.
    """

    finding_id: str
    kind: Kind
    map_element_id: int
    along_m: float
    offset_m: float
    length_m: float
    sd_m: float
    observations: int
    visits: int
    confidence: float
    expected: str
    observed: str
    evidence: str
    status: Status
    x_m: float
    y_m: float
    latitude_deg: float
    longitude_deg: float
    points_m: _Points
    points_expected_m: _Points
    drive: int
    sensor: str
    stamp_ns: int

    @property
    def urgency(self) -> float:
        """Confidence times how bad a mistake of this kind is, 0..1: the order of the list."""
        return self.confidence * _SEVERITY[self.kind]

    def decided(self, status: Status, comment: str) -> Decision:
        """Return a decision about it, with what it is known again by in another run."""
        return Decision(
            finding_id=self.finding_id,
            status=status,
            comment=comment,
            kind=self.kind,
            map_element_id=self.map_element_id,
            along_m=self.along_m,
            length_m=self.length_m,
            x_m=0.0 if math.isnan(self.x_m) else self.x_m,
            y_m=0.0 if math.isnan(self.y_m) else self.y_m,
            offset_m=self.offset_m,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A line of the map: its id, what it is (`line`, `stop_line`, ...) and K pairs x, y in m."""

    line_id: int
    kind: str
    type: str
    colour: str
    painted: bool
    points_m: _Points


@dataclass(frozen=True, slots=True)
class MapLines:
    """What `map_lines.json` holds: lines of the map, and the way of each drive as pairs x, y."""

    lines: tuple[Line, ...]
    paths: tuple[_Points, ...]


@dataclass(frozen=True, eq=False)
class ReviewRun:
    """A finished run.

    Attributes:
        folder: Where it lies.
        findings: The most urgent first.
        map: Lines of the map and ways of the drives.
        info: Content of `run.json`.
    """

    folder: Path
    findings: tuple[Finding, ...]
    map: MapLines
    info: Mapping[str, Any]

    @cached_property
    def by_id(self) -> Mapping[str, Finding]:
        """The findings by their ids."""
        return {finding.finding_id: finding for finding in self.findings}


def read_run(folder: Path) -> ReviewRun:
    """Read a run; nothing in it is changed.

    Raises:
        InputError: If the folder holds no finished validation, or a file of it is not as it
            should be.
    """
    needed = [folder / name for name in ("run.json", "discrepancies.parquet", "map_lines.json")]
    for path in needed:
        if not path.is_file():
            what = f"is no finished validation of a map; it has no {path.name}"
            raise InputError(what, where=folder, remedy=_REMEDY)
    info = _json(needed[0])
    if not isinstance(info, dict):
        raise InputError("is no object", where=needed[0])
    findings = sorted(_findings(needed[1]), key=lambda f: (-f.urgency, f.finding_id))
    if len({finding.finding_id for finding in findings}) < len(findings):
        raise InputError("holds two findings of one id", where=needed[1])
    return ReviewRun(folder, tuple(findings), _map_lines(needed[2]), info)


def _json(path: Path) -> Any:  # noqa: ANN401 - whatever the file holds
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"cannot be read as JSON ({error})", where=path) from error


def _findings(path: Path) -> list[Finding]:
    try:
        table = pq.read_table(path, columns=None)
        missing = {*_TEXTS, *_WHOLE, *_NUMBERS} - set(table.column_names)
        if missing:
            raise InputError(f"has no column {', '.join(sorted(missing))}", where=path)
        columns = [
            table.column(name).cast(kind)
            for names, kind in ((_TEXTS, pa.string()), (_WHOLE, pa.int64()))
            for name in names
        ] + [table.column(name).cast(pa.float64()) for name in _NUMBERS]
        rows = pa.table(columns, names=[*_TEXTS, *_WHOLE, *_NUMBERS]).to_pylist()
    except (pa.ArrowException, OSError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"cannot be read as a table of findings ({reason})", where=path) from error
    if len(rows) > _MOST_FINDINGS:
        raise InputError(f"holds {len(rows)} findings; a review takes {_MOST_FINDINGS}", where=path)
    return [_finding(row, number, path) for number, row in enumerate(rows)]


def _finding(row: dict[str, Any], number: int, path: Path) -> Finding:
    empty = [name for name in row if row[name] is None and name not in _MAY_LACK]
    if empty:
        raise InputError(f"row {number}: {', '.join(empty)} is empty", where=path)
    numbers = {name: math.nan if row[name] is None else row[name] for name in _NUMBERS}
    strange = [n for n in _NUMBERS if n not in _MAY_LACK and not math.isfinite(numbers[n])]
    if strange:
        raise InputError(f"row {number}: {', '.join(strange)} is not finite", where=path)
    try:
        return Finding(
            finding_id=row["id"],
            kind=Kind(row["kind"]),
            status=Status(row["status"]),
            x_m=numbers["x"],
            y_m=numbers["y"],
            latitude_deg=numbers["latitude"],
            longitude_deg=numbers["longitude"],
            points_m=_points(json.loads(row["points"])),
            points_expected_m=_points(json.loads(row["points_expected"])),
            map_element_id=row["map_element_id"],
            along_m=numbers["along_m"],
            offset_m=numbers["offset_m"],
            length_m=numbers["length_m"],
            sd_m=numbers["sd_m"],
            observations=row["observations"],
            visits=row["visits"],
            confidence=numbers["confidence"],
            expected=row["expected"],
            observed=row["observed"],
            evidence=row["evidence"],
            drive=row["drive"],
            sensor=row["sensor"],
            stamp_ns=row["stamp_ns"],
        )
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        raise InputError(f"row {number}: {error}", where=path) from error


def _map_lines(path: Path) -> MapLines:
    content = _json(path)
    try:
        lines = tuple(
            Line(
                line_id=int(line["id"]),
                kind=str(line["kind"]),
                type=str(line["type"]),
                colour=str(line["colour"]),
                painted=bool(line["painted"]),
                points_m=_points(line["points"]),
            )
            for line in content["lines"]
        )
        return MapLines(lines, tuple(_points(way["points"]) for way in content["paths"]))
    except (LookupError, TypeError, ValueError) as error:
        raise InputError(f"holds no map lines ({error!r})", where=path) from error


def _points(pairs: Any) -> _Points:  # noqa: ANN401 - JSON that is checked here
    points = tuple((float(pair[0]), float(pair[1])) for pair in pairs)
    if not all(math.isfinite(x) and math.isfinite(y) for x, y in points):
        raise ValueError("a point is not finite")
    return points
