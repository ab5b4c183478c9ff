"""Findings about a map against planted changes, counted by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from percept.core.errors import InputError
from percept.core.map_findings import Kind, Status
from percept.core.results import Verdict
from percept.evaluation.map_findings import PlacedFinding, planted_changes, score_findings


def finding(
    kind: Kind,
    element: int,
    middle: tuple[float, float],
    *,
    length_m: float = 0.0,
    offset_m: float = math.nan,
    status: Status = Status.OPEN,
) -> PlacedFinding:
    x, y = middle
    ends = [[x - length_m / 2, y], [x + length_m / 2, y]] if length_m else []
    return PlacedFinding(
        finding_id=f"{kind}-{element}",
        kind=kind,
        map_element_id=element,
        offset_m=offset_m,
        middle_m=middle,
        points_m=np.array(ends, dtype=np.float64).reshape(-1, 2),
        status=status,
    )


def test_findings_meet_changes_of_their_kind_and_element() -> None:
    planted = [
        finding(Kind.MOVED, 7, (15, 0), length_m=30, offset_m=0.6),
        finding(Kind.TYPE, 8, (45, 0), length_m=30),
        finding(Kind.COLOUR, 9, (75, 0), length_m=30),
    ]
    found = [
        finding(Kind.MOVED, 7, (12, 0.6), length_m=20, offset_m=0.55),
        finding(Kind.COLOUR, 8, (45, 0), length_m=30),  # another kind
        finding(Kind.COLOUR, 19, (75, 0), length_m=30),  # another element, though it is there
    ]
    scores = score_findings(found, planted, 2.0)
    assert {kind: (c.planted, c.found, c.false) for kind, c in scores.by_kind.items()} == {
        Kind.MOVED: (1, 1, 0),
        Kind.TYPE: (1, 0, 0),
        Kind.COLOUR: (1, 0, 2),
    }
    assert scores.by_kind[Kind.MOVED].offset_errors_m == pytest.approx([-0.05])
    total = scores.document()
    assert (total["precision"], total["recall"]) == (pytest.approx(1 / 3), pytest.approx(1 / 3))
    assert total["f1"] == pytest.approx(1 / 3)
    assert total["false_per_km"] == 1.0
    assert total["by_kind"]["type"]["precision"] is None
    assert [one["map_element_id"] for one in total["missed_changes"]] == [8, 9]
    assert [one["map_element_id"] for one in total["false_findings"]] == [8, 19]


@pytest.mark.parametrize(("middle", "found"), [((3.0, 0.4), 1), ((15.0, 2.9), 1), ((15.0, 3.1), 0)])
def test_what_has_no_element_is_met_by_its_place(middle: tuple[float, float], found: int) -> None:
    planted = [finding(Kind.MISSING_IN_MAP, 0, (15, 0), length_m=30)]
    for element in (0, 99):
        scores = score_findings([finding(Kind.MISSING_IN_MAP, element, middle)], planted)
        assert (scores.total.found, scores.total.false) == (found, 1 - found)


def test_each_change_is_met_once_and_by_the_nearest() -> None:
    planted = [
        finding(Kind.TRAFFIC_LIGHT_MISSING_IN_MAP, 0, (100, -5.2)),
        finding(Kind.TRAFFIC_LIGHT_MISSING_IN_MAP, 0, (100, -2.4)),
    ]
    found = [
        finding(Kind.TRAFFIC_LIGHT_MISSING_IN_MAP, 0, (100, -3.7)),
        finding(Kind.TRAFFIC_LIGHT_MISSING_IN_MAP, 0, (100, -2.5)),
        finding(Kind.TRAFFIC_LIGHT_MISSING_IN_MAP, 0, (100.4, -2.4)),
    ]
    scores = score_findings(found, planted)
    assert (scores.total.found, scores.total.false) == (2, 1)
    assert scores.false[0] is found[2]


def test_two_findings_about_one_element_count_once() -> None:
    planted = [finding(Kind.MOVED, 7, (15, 0), length_m=30, offset_m=0.6)]
    found = [finding(Kind.MOVED, 7, (x, 0), offset_m=0.6) for x in (5, 25)]
    scores = score_findings(found, planted)
    assert (scores.total.found, scores.total.false, scores.total.f1) == (1, 1, 2 / 3)


def test_rejected_findings_and_widths_that_follow_are_left_out() -> None:
    planted = [finding(Kind.MOVED, 7, (15, 0), length_m=30, offset_m=0.6)]
    found = [
        finding(Kind.TYPE, 7, (15, 0), status=Status.REJECTED),
        finding(Kind.LANE_WIDTH, 50, (15, 1.75)),
        finding(Kind.LANE_WIDTH, 51, (60, 1.75)),
    ]
    scores = score_findings(found, planted)
    assert scores.total.false == 1
    assert scores.false[0].map_element_id == 51
    assert sum(scores.dropped.values()) == 2


def test_verdicts_say_what_is_missing() -> None:
    assert score_findings([], []).verdict is Verdict.BAD
    assert score_findings([], [], 0.0).verdict is Verdict.BAD
    unchanged = score_findings([], [], 1.5)
    assert unchanged.verdict is Verdict.GOOD
    assert unchanged.false_per_km == 0.0
    assert unchanged.document()["f1"] is None
    few = score_findings([], [finding(Kind.MOVED, 7, (0, 0))], 0.5)
    assert few.verdict is Verdict.DOUBTFUL
    assert len(few.why) == 2


def test_planted_changes_are_read_as_they_are_written() -> None:
    row = {"kind": "moved", "map_element_id": 7, "offset_m": -0.6, "x": 1.0, "y": 2.0,
           "points": [[0, 2], [2, 2]], "expected": "anything"}  # fmt: skip
    (change,) = planted_changes([row], "f")
    assert (change.kind, change.map_element_id, change.offset_m) == (Kind.MOVED, 7, -0.6)
    assert change.points_m.tolist() == [[0, 2], [2, 2]]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ({}, "f: is no list of changes"),
        ([5], "f: change 0: cannot be read"),
        ([{"kind": "moved"}], "has no 'map_element_id'"),
        ([{"kind": "gone", "map_element_id": 1, "x": 0, "y": 0}], "'gone' is not a valid Kind"),
        ([{"kind": "moved", "map_element_id": 1, "x": math.nan, "y": 0}], "not finite"),
        ([{"kind": "moved", "map_element_id": 1, "x": 0, "y": 0, "points": [1]}], "cannot be read"),
    ],
)
def test_what_is_no_list_of_changes_is_refused(rows: Any, said: str) -> None:
    with pytest.raises(InputError, match="f: ") as refused:
        planted_changes(rows, "f")
    assert said in str(refused.value)
