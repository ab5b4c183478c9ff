"""Findings about a map against the changes that were planted into it.

A finding meets a change of its own kind: by the element of the map that both name, or, where one
of them names none, by their place. Each finding meets at most one change and each change at most
one finding, as many as possible, the nearest first. All other findings are false.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.map_findings import Kind, Status
from percept.core.polyline import nearest_place
from percept.core.results import Verdict

__all__ = ["KindCounts", "MapScores", "PlacedFinding", "planted_changes", "score_findings"]

_F64 = NDArray[np.float64]
_REACH_M = 3.0
_WIDTH_REACH_M = 4.0
_FAR = 1e6
_FEW_CHANGES, _FEW_KM = 10, 1.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlacedFinding:
    """A finding, or a planted change told as the finding that it is to give.

    Attributes:
        finding_id: What it is called; empty for a planted change.
        kind: In what way map and road disagree.
        map_element_id: Element of the map; 0 where the map has none.
        offset_m: Of the road's paint from the map's; NaN where it means nothing.
        middle_m: Its middle x and y in the map frame.
        points_m: (K, 2) float64 the stretch in the map frame; (0, 2) takes its middle.
        status: What a person said of it.
    """

    finding_id: str
    kind: Kind
    map_element_id: int
    offset_m: float
    middle_m: tuple[float, float]
    points_m: _F64
    status: Status = Status.OPEN

    def summary(self) -> dict[str, Any]:
        """Return what a reader needs to find it."""
        named = {"id": self.finding_id} if self.finding_id else {}
        x, y = (round(value, 3) for value in self.middle_m)
        return named | {"kind": str(self.kind), "map_element_id": self.map_element_id} | {
            "x": x, "y": y
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class KindCounts:
    """What was counted; of several kinds it adds up.

    Attributes:
        planted: Changes.
        found: Changes that a finding met.
        false: Findings that met none.
        offset_errors_m: Of the changes found, the finding's offset less the true one.
    """

    planted: int = 0
    found: int = 0
    false: int = 0
    offset_errors_m: tuple[float, ...] = ()

    def __add__(self, other: KindCounts) -> KindCounts:
        return KindCounts(
            self.planted + other.planted,
            self.found + other.found,
            self.false + other.false,
            self.offset_errors_m + other.offset_errors_m,
        )

    @property
    def precision(self) -> float | None:
        """Share of the findings that are right; None without any."""
        return _share(self.found, self.found + self.false)

    @property
    def recall(self) -> float | None:
        """Share of the changes that were found; None without any."""
        return _share(self.found, self.planted)

    @property
    def f1(self) -> float | None:
        """Harmonic mean of both; None where there is neither a change nor a finding."""
        return _share(2 * self.found, self.planted + self.found + self.false)

    def document(self) -> dict[str, Any]:
        """Return the figures by name; None where there is nothing to divide by."""
        errors = self.offset_errors_m
        mean = sum(abs(error) for error in errors) / len(errors) if errors else None
        return {
            "planted": self.planted,
            "found": self.found,
            "missed": self.planted - self.found,
            "false": self.false,
            "precision": self.precision,
            "recall": self.recall,
            "f1": self.f1,
            "offset_error_m": mean,
        }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MapScores:
    """How well findings tell what was planted.

    Attributes:
        by_kind: Counts of each kind that was planted or found.
        missed: Changes that no finding met.
        false: Findings that met no change.
        driven_km: How far the vehicle drove; None where that is not known.
        dropped: Findings that were left out, by reason.
    """

    by_kind: Mapping[Kind, KindCounts]
    missed: tuple[PlacedFinding, ...]
    false: tuple[PlacedFinding, ...]
    driven_km: float | None
    dropped: Counter[str] = field(default_factory=Counter)

    @property
    def total(self) -> KindCounts:
        """The counts of all kinds together."""
        return sum(self.by_kind.values(), KindCounts())

    @property
    def false_per_km(self) -> float | None:
        """False findings a kilometre that was driven."""
        return None if not self.driven_km else self.total.false / self.driven_km

    @property
    def verdict(self) -> Verdict:
        """How far the figures can be trusted; it does not judge the findings."""
        if not self.total.planted and not self.driven_km:
            return Verdict.BAD
        return Verdict.DOUBTFUL if self.why else Verdict.GOOD

    @property
    def why(self) -> tuple[str, ...]:
        """Reasons for the verdict."""
        planted, km = self.total.planted, self.driven_km
        if not planted and not km:
            return ("no change was planted, and how far the vehicle drove is not known",)
        why = []
        if 0 < planted < _FEW_CHANGES:
            why.append(f"{planted} changes are few, from {_FEW_CHANGES} on figures count")
        if km is None:
            why.append("how far the vehicle drove is not known: no false findings a km")
        elif km < _FEW_KM:
            why.append(f"{km:.2f} km are few, from {_FEW_KM:g} km on false findings a km count")
        return tuple(why)

    def document(self) -> dict[str, Any]:
        """Return all figures by name."""
        return {
            **self.total.document(),
            "driven_km": self.driven_km,
            "false_per_km": self.false_per_km,
            "by_kind": {str(kind): one.document() for kind, one in self.by_kind.items()},
            "missed_changes": [change.summary() for change in self.missed],
            "false_findings": [finding.summary() for finding in self.false],
            "verdict": str(self.verdict),
            "why": list(self.why),
            "dropped": dict(self.dropped),
        }


def planted_changes(rows: object, where: object) -> list[PlacedFinding]:
    """Return the changes of a `map_changes.json`, which is a list of rows.

    Args:
        rows: What the file holds.
        where: The file, for messages.

    Raises:
        InputError: If it is no such list.
    """
    if not isinstance(rows, list):
        raise InputError("is no list of changes", where=where)
    return [_planted(row, f"{where}: change {number}") for number, row in enumerate(rows)]


def score_findings(
    findings: Sequence[PlacedFinding],
    planted: Sequence[PlacedFinding],
    driven_km: float | None = None,
) -> MapScores:
    """Match findings with planted changes, one to one.

    Findings that a person has rejected are left out; so are lane widths beside a line that was
    moved in the map, since those widths are wrong, too.

    Args:
        findings: The findings.
        planted: The changes.
        driven_km: How far the vehicle drove, where that is known.
    """
    dropped: Counter[str] = Counter()
    kept = [finding for finding in findings if not _left_out(finding, planted, dropped)]
    by_kind, missed, false = {}, list[PlacedFinding](), list[PlacedFinding]()
    present = {one.kind for one in (*kept, *planted)}
    for kind in (kind for kind in Kind if kind in present):
        ours = [one for one in kept if one.kind is kind]
        real = [one for one in planted if one.kind is kind]
        pairs = _pairs(ours, real)
        errors = [ours[i].offset_m - real[k].offset_m for i, k in pairs]
        by_kind[kind] = KindCounts(
            planted=len(real),
            found=len(pairs),
            false=len(ours) - len(pairs),
            offset_errors_m=tuple(error for error in errors if not math.isnan(error)),
        )
        missed += [one for k, one in enumerate(real) if k not in {pair[1] for pair in pairs}]
        false += [one for i, one in enumerate(ours) if i not in {pair[0] for pair in pairs}]
    return MapScores(
        by_kind=by_kind,
        missed=tuple(missed),
        false=tuple(false),
        driven_km=driven_km,
        dropped=dropped,
    )


def _left_out(
    finding: PlacedFinding, planted: Sequence[PlacedFinding], dropped: Counter[str]
) -> bool:
    if finding.status is Status.REJECTED:
        dropped["findings that a person rejected"] += 1
        return True
    if finding.kind is Kind.LANE_WIDTH and any(
        change.kind is Kind.MOVED and _distance(finding, change) <= _WIDTH_REACH_M
        for change in planted
    ):
        dropped["lane widths beside a line that was moved"] += 1
        return True
    return False


def _pairs(
    findings: Sequence[PlacedFinding], planted: Sequence[PlacedFinding]
) -> list[tuple[int, int]]:
    """Return numbers of findings and changes that meet: as many as can, the nearest first."""
    from scipy.optimize import linear_sum_assignment

    cost = np.array([[_cost(one, change) for change in planted] for one in findings])
    if not cost.size:
        return []
    rows, columns = linear_sum_assignment(cost)
    return [
        (int(i), int(k)) for i, k in zip(rows, columns, strict=True) if cost[i, k] < _FAR
    ]  # fmt: skip


def _cost(finding: PlacedFinding, change: PlacedFinding) -> float:
    distance = _distance(finding, change)
    if finding.map_element_id and change.map_element_id:
        # Of two findings about an element the nearer one is taken; a far one still means it.
        same = finding.map_element_id == change.map_element_id
        return min(distance, _FAR / 2) if same else _FAR
    return distance if distance <= _REACH_M else _FAR


def _distance(finding: PlacedFinding, change: PlacedFinding) -> float:
    """Return the distance from the middle of a finding to the stretch of a change, metres."""
    at = np.array(finding.middle_m)
    points = change.points_m if len(change.points_m) else np.array([change.middle_m])
    return math.dist(nearest_place(points, at), at)


def _planted(row: object, where: str) -> PlacedFinding:
    try:
        if not isinstance(row, dict):
            raise TypeError("is no object")
        points = np.array(row.get("points") or [], dtype=np.float64).reshape(-1, 2)
        offset = row.get("offset_m")
        change = PlacedFinding(
            finding_id="",
            kind=Kind(row["kind"]),
            map_element_id=int(row["map_element_id"]),
            offset_m=math.nan if offset is None else float(offset),
            middle_m=(float(row["x"]), float(row["y"])),
            points_m=points,
        )
    except KeyError as error:
        raise InputError(f"has no {error}", where=where) from error
    except (TypeError, ValueError) as error:
        raise InputError(f"cannot be read ({error})", where=where) from error
    if not (np.isfinite(points).all() and np.isfinite(change.middle_m).all()):
        raise InputError("holds numbers that are not finite", where=where)
    return change


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None
