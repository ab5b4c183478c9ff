"""What was decided, for other programs: tables, and the edits of the map that follow from it."""

from __future__ import annotations

import csv
import json
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from percept.core.errors import InputError
from percept.core.lane_markings import LINE_TYPES
from percept.core.map_findings import Kind, Status
from percept.review.claims import claim
from percept.review.run import Finding, ReviewRun
from percept.review.store import Entry

__all__ = [
    "Standing",
    "TagChanges",
    "finding_tags",
    "places_of",
    "standing",
    "tag_changes",
    "write_decisions_csv",
    "write_decisions_json",
]

_WHOLE_WAY = 0.9
_COLOURS = frozenset({"white", "yellow"})
_EDITS: Mapping[Kind, tuple[str, frozenset[str]]] = {
    Kind.TYPE: ("subtype", LINE_TYPES),
    Kind.COLOUR: ("color", _COLOURS),
}
_COLUMNS = (
    "id", "status", "comment", "decided_at", "claim", "kind", "map_element_id", "along_m",
    "length_m", "offset_m", "sd_m", "confidence", "expected", "observed", "x", "y", "latitude",
    "longitude",
)  # fmt: skip
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


@dataclass(frozen=True, slots=True)
class Standing:
    """How a finding stands: what was said here last, or what an earlier review said."""

    finding: Finding
    status: Status
    comment: str
    decided_at: str


@dataclass(frozen=True, slots=True)
class TagChanges:
    """Edits of ways that a program can do.

    Attributes:
        tags: By way, the tags that it gets.
        left: Confirmed findings that are left to a person in an editor, by reason.
    """

    tags: Mapping[int, Mapping[str, str]]
    left: Counter[str]


def standing(run: ReviewRun, entries: Iterable[Entry]) -> list[Standing]:
    """Return the findings of a run that were decided, the most urgent first."""
    latest = {entry.decision.finding_id: entry for entry in entries}
    stands = []
    for finding in run.findings:
        entry = latest.get(finding.finding_id)
        if entry is None:
            stands.append(Standing(finding, finding.status, "", ""))
        else:
            said = entry.decision
            stands.append(Standing(finding, said.status, said.comment, entry.decided_at))
    return [one for one in stands if one.status is not Status.OPEN]


def write_decisions_json(path: Path, stands: Sequence[Standing]) -> None:
    """Write decisions as a JSON list; what is not known is null."""
    rows = [_row(one) for one in stands]
    text = json.dumps(rows, indent=2, allow_nan=False, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def write_decisions_csv(path: Path, stands: Sequence[Standing]) -> None:
    """Write decisions as CSV with a header; what is not known is empty.

    A text that a spreadsheet would take for a formula gets an apostrophe before it.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(_COLUMNS)
        for one in stands:
            writer.writerow([_cell(value) for value in _row(one).values()])


def places_of(folder: Path) -> dict[str, tuple[tuple[float, float], ...]]:
    """Return degrees north and east of findings by their ids, from `discrepancies.geojson`.

    Findings whose place on earth is not known are not among them.

    Raises:
        InputError: If the file is not as `percept map validate` writes it.
    """
    path = folder / "discrepancies.geojson"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return {
            str(feature["id"]): _degrees(feature["geometry"])
            for feature in content["features"]
            if feature["geometry"] is not None
        }
    except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise InputError(f"cannot be read as GeoJSON of findings ({error})", where=path) from error


def finding_tags(one: Standing) -> dict[str, str]:
    """Return the tags that a finding has in a layer of an editor."""
    finding = one.finding
    tags = {
        "percept:finding": finding.finding_id,
        "percept:kind": str(finding.kind),
        "percept:claim": claim(finding),
        "percept:expected": finding.expected,
        "percept:observed": finding.observed,
        "percept:way": str(finding.map_element_id) if finding.map_element_id else "",
        "percept:offset_m": _metres(finding.offset_m),
        "percept:sd_m": _metres(finding.sd_m),
        "percept:confidence": f"{finding.confidence:.3f}",
        "percept:comment": one.comment,
    }
    return {key: value for key, value in tags.items() if value}


def tag_changes(run: ReviewRun, confirmed: Iterable[Standing]) -> TagChanges:
    """Return the edits that need no hand: another type or colour along a whole way.

    A way of which only a part is different would have to be cut, and one that lies elsewhere
    shares its points with its neighbours: both are left to an editor.
    """
    lengths = {line.line_id: _length(line.points_m) for line in run.map.lines}
    wanted: defaultdict[tuple[int, str, str], list[Finding]] = defaultdict(list)
    left: Counter[str] = Counter()
    for one in confirmed:
        edit = _edit(one.finding)
        if edit is None:
            left[f"{one.finding.kind} is drawn by hand"] += 1
        else:
            wanted[one.finding.map_element_id, *edit].append(one.finding)
    keys = Counter((way, key) for way, key, _ in wanted)
    tags: defaultdict[int, dict[str, str]] = defaultdict(dict)
    for (way, key, value), findings in wanted.items():
        if keys[way, key] > 1:
            left["one way with two answers"] += len(findings)
        elif _covered(findings) < _WHOLE_WAY * lengths.get(way, math.inf):
            left["only a part of the way"] += len(findings)
        else:
            tags[way][key] = value
    return TagChanges(tags, left)


def _edit(finding: Finding) -> tuple[str, str] | None:
    """Return the tag that a finding asks for, and its value."""
    if finding.kind not in _EDITS or not finding.map_element_id:
        return None
    key, words = _EDITS[finding.kind]
    found = [word for word in finding.observed.replace(",", " ").split() if word in words]
    return (key, found[0]) if len(found) == 1 else None


def _covered(findings: Iterable[Finding]) -> float:
    """Return how many metres of a way stretches cover, what they share counted once."""
    covered = reached = 0.0
    for start, end in sorted((f.along_m, f.along_m + f.length_m) for f in findings):
        covered += max(0.0, end - max(start, reached))
        reached = max(reached, end)
    return covered


def _length(points: Sequence[tuple[float, float]]) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(points))


def _degrees(geometry: Any) -> tuple[tuple[float, float], ...]:  # noqa: ANN401 - JSON
    pairs = geometry["coordinates"]
    if geometry["type"] == "Point":
        pairs = [pairs]
    return tuple((float(pair[1]), float(pair[0])) for pair in pairs)


def _row(one: Standing) -> dict[str, str | float | None]:
    finding = one.finding
    values = (
        finding.finding_id,
        str(one.status),
        one.comment,
        one.decided_at,
        claim(finding),
        str(finding.kind),
        finding.map_element_id,
        finding.along_m,
        finding.length_m,
        _known(finding.offset_m),
        _known(finding.sd_m),
        finding.confidence,
        finding.expected,
        finding.observed,
        _known(finding.x_m),
        _known(finding.y_m),
        _known(finding.latitude_deg),
        _known(finding.longitude_deg),
    )
    return dict(zip(_COLUMNS, values, strict=True))


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _metres(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else ""


def _cell(value: str | float | None) -> str | float | None:
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value
