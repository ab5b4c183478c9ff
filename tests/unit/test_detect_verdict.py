"""The verdict of a detection run: every limit, from both sides."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from percept.cli.detect_verdict import RunFacts, judge
from percept.core.results import Verdict

_SOUND = RunFacts(frames=100, objects=40, points=1000, ground_points=400)


@pytest.mark.parametrize(
    ("harmless", "doubtful", "why"),
    [
        ({}, {"losses": {"chunk with a wrong checksum": 2}}, "2 x chunk with a wrong checksum"),
        ({"missing": {"/left": 10}}, {"missing": {"/left": 11}}, "11 of 100 merged scans lack /l"),
        ({"objects": 1}, {"objects": 0}, "not one object in 100 scans"),
        ({"ground_points": 50}, {"ground_points": 40}, "4% of the points"),
        ({"ground_points": 950}, {"ground_points": 960}, "96% of the points"),
        (
            {"height_spread_m": {"top": 0.1}},
            {"height_spread_m": {"top": 0.11}},
            "the height of 'top' is uncertain",
        ),
        (
            {"height_errors_m": {"top": -0.3}},
            {"height_errors_m": {"top": -0.31}},
            "given for 'top' is 0.31 m below",
        ),
        (
            {"height_errors_m": {"top": 0.3}},
            {"height_errors_m": {"top": 0.31}},
            "given for 'top' is 0.31 m above",
        ),
    ],
)
def test_a_run_is_doubtful_beyond_each_limit(
    harmless: dict[str, Any], doubtful: dict[str, Any], why: str
) -> None:
    assert judge(replace(_SOUND, **harmless))[0] == Verdict.GOOD
    verdict, reasons, advice = judge(replace(_SOUND, **doubtful))
    assert verdict == Verdict.DOUBTFUL
    assert why in " ".join(reasons)
    assert len(reasons) == 1
    assert bool(advice) == ("ground_points" not in doubtful)


def test_a_run_without_a_scan_is_bad_and_every_advice_is_given_once() -> None:
    assert judge(replace(_SOUND, frames=0))[0] == Verdict.BAD
    missing = {"/left": 50, "/right": 60}
    _, reasons, advice = judge(replace(_SOUND, missing=missing, objects=0))
    assert len(reasons) == 3
    assert len(advice) == 2
