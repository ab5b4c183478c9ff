"""The verdict of a detection run: every limit, from both sides."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from percept.cli.detect.verdict import CameraFacts, RunFacts, judge
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


_SEEN = CameraFacts(images={"front": 20, "rear": 20}, boxes={"near": 9, "far": 1})


@pytest.mark.parametrize(
    ("doubtful", "why"),
    [
        ({"losses": {"message cut off": 1}}, "the log could not be read in full: 1 x message"),
        ({"unusable": {"front": 1, "rear": 0}}, "1 of 20 images of front cannot be used"),
        ({"unusable": {"front": 20}}, "20 of 20 images of front cannot be used"),
        ({"boxes": {"near": 9, "far": 0}}, "'far' found nothing in 40 images"),
        ({"without_places": {"front": 20}}, "not one of 20 boxes of front got a place"),
    ],
)
@pytest.mark.parametrize("scans", [None, _SOUND])
def test_cameras_are_doubtful_beyond_each_limit(
    scans: RunFacts | None, doubtful: dict[str, Any], why: str
) -> None:
    assert judge(scans, replace(_SEEN, without_places={"front": 19}))[0] == Verdict.GOOD
    verdict, reasons, advice = judge(scans, replace(_SEEN, **doubtful))
    assert verdict == Verdict.DOUBTFUL
    assert len(reasons) == len(advice) == 1
    assert why in reasons[0]


def test_one_half_saves_a_run_in_which_the_other_sees_nothing() -> None:
    blind = replace(_SEEN, unusable=_SEEN.images, boxes={})
    assert judge(None, blind)[:2] == (Verdict.BAD, ("no image could be used",))
    assert judge(replace(_SOUND, frames=0), blind)[0] == Verdict.BAD
    assert judge(_SOUND, blind)[0] == Verdict.DOUBTFUL
    verdict, why, _ = judge(replace(_SOUND, frames=0), _SEEN)
    assert (verdict, why) == (Verdict.DOUBTFUL, ("no scan could be judged",))
    assert "100 scans were judged and 40 images were looked at" in judge(_SOUND, _SEEN)[1][0]
