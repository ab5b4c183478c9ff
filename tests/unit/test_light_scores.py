"""States of lights against truth: each figure on a case whose answer is known."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pytest

from percept.core.errors import InputError
from percept.core.results import LightStates, Verdict
from percept.evaluation.light_series import light_pieces, light_series
from percept.evaluation.lights import LightCounts, score_lights

TENTH_NS = 100_000_000
LIGHT = 99_100_000_001


def moments(
    states: Sequence[str], *, light: int = LIGHT, start: int = 0, shift_ns: int = 0
) -> list[LightStates]:
    """One light at 10 Hz. `red`, `red!` flashes, `(red)` is not seen, `` has no row."""
    return [
        LightStates(
            stamp_ns=(start + k) * TENTH_NS + shift_ns,
            ids=np.array([light]),
            states=(word.strip("()!"),),
            flashing=np.array(["!" in word]),
            probabilities=np.ones(1),
            cameras=((),) if "(" in word else (("front",),),
        )
        for k, word in enumerate(states)
        if word
    ]


def score(truth: Sequence[str], found: Sequence[str], shift_ns: int = 0) -> LightCounts:
    images = [k * TENTH_NS + shift_ns for k in range(len(found))]
    return score_lights(moments(truth), moments(found, shift_ns=shift_ns), images).total


def test_each_moment_is_right_unknown_unreported_or_wrong() -> None:
    counts = score(["red"] * 6, ["red", "red", "unknown", "", "green", "dark"])
    assert (counts.moments, counts.right, counts.unknown, counts.unreported) == (6, 2, 1, 1)
    assert (counts.wrong, counts.red_as_green) == (2, 1)
    figures = counts.document()
    assert figures["state_accuracy"] == pytest.approx(2 / 6)
    assert figures["known_accuracy"] == pytest.approx(2 / 4)
    assert figures["unknown_rate"] == pytest.approx(2 / 6)


def test_only_moments_count_at_which_a_camera_sees_the_light() -> None:
    counts = score(["(red)"] * 3 + ["red"] * 2 + ["(red)"], ["green"] * 3 + ["red"] * 3)
    assert (counts.moments, counts.right, counts.red_as_green) == (2, 2, 0)


def test_the_delay_of_changes() -> None:
    truth = ["green"] * 5 + ["yellow"] * 5 + ["red"] * 5
    found = ["green"] * 7 + ["yellow"] * 4 + ["red"] * 4
    counts = score(truth, found)
    assert counts.delays_s == pytest.approx((0.25, 0.15))  # of changes at 0.45 s and 0.95 s
    assert (counts.late, counts.right) == (0, 12)
    early = score(truth, ["green"] * 4 + ["yellow"] * 6 + ["red"] * 5)
    assert early.delays_s == pytest.approx((-0.05, 0.05))


def test_a_change_that_is_never_shown() -> None:
    counts = score(["green"] * 4 + ["yellow"] * 3 + ["red"] * 4, ["green"] * 7 + ["red"] * 4)
    assert (counts.late, len(counts.delays_s)) == (1, 1)
    assert counts.document()["changes"] == 2


def test_a_change_that_nobody_sees_has_no_delay() -> None:
    hidden = score(["green"] * 3 + ["(green)"] * 3 + ["(red)", "red", "red"], ["green"] * 9)
    assert (len(hidden.delays_s), hidden.late) == (0, 0)
    truth = [*moments(["green"] * 3), *moments(["red"] * 3, start=20)]
    assert score_lights(truth, moments(["red"] * 23)).total.delays_s == ()


def test_moments_on_both_sides_of_a_change_do_not_count() -> None:
    """Images lie 40 ms after the truth: the last green one is nearest to what is red already."""
    counts = score(["green"] * 5 + ["red"] * 5, ["green"] * 5 + ["red"] * 5, shift_ns=40_000_000)
    assert (counts.at_a_change, counts.moments, counts.right) == (1, 9, 9)


def test_results_at_another_rate_are_held_against_the_nearest_moment() -> None:
    slow = [m for m in moments(["red"] * 21) if m.stamp_ns % (2 * TENTH_NS) == 0]
    counts = score_lights(moments(["red"] * 21), slow).total
    assert (counts.moments, counts.right, counts.unreported) == (21, 21, 0)


def test_truth_outside_of_the_time_of_the_results_is_left_out() -> None:
    scores = score_lights(moments(["red"] * 20), moments(["red"] * 5, start=10))
    assert scores.total.moments == 5
    assert list(scores.dropped.values()) == [15]
    # images without a light are part of the time: of them the results say nothing
    images = [k * TENTH_NS for k in range(20)]
    whole = score_lights(moments(["red"] * 20), moments(["red"] * 5, start=10), images).total
    assert (whole.moments, whole.right, whole.unreported) == (20, 5, 15)


def test_flashing_is_found_after_it_is_seen() -> None:
    found = ["", "", "unknown", "(unknown)", "red", "red", "red!", "red!", "red!", "red!"]
    counts = score(["red!"] * 10, found)
    assert counts.flash_delays_s == pytest.approx((0.4,))
    assert (counts.flash_missed, counts.steady, counts.falsely_flashing) == (0, 0, 0)
    assert counts.right == 6
    assert score(["red!"] * 10, ["red"] * 10).flash_missed == 1
    assert score(["red!"] * 10, [""] * 9 + ["(red)"]).flash_missed == 1


def test_a_steady_light_that_is_said_to_flash() -> None:
    counts = score(["red"] * 10, ["red"] * 4 + ["red!"] * 2 + ["red"] * 4)
    assert (counts.false_flash, counts.falsely_flashing, counts.steady) == (2, 1, 1)
    unseen = score(["(red)"] * 5 + ["red"] * 5, ["red!"] * 3 + ["red"] * 7)
    assert (unseen.false_flash, unseen.falsely_flashing) == (0, 0)


def test_lights_are_counted_by_their_ids() -> None:
    truth = [*moments(["red"] * 4), *moments(["green"] * 4, light=7)]
    found = [*moments(["red"] * 4), *moments(["red"] * 4, light=7), *moments(["red"], light=8)]
    scores = score_lights(sorted(truth, key=lambda m: m.stamp_ns), found)
    assert {light: c.right for light, c in scores.by_light.items()} == {LIGHT: 4, 7: 0}
    assert scores.dropped["lights that the truth does not have"] == 1


def test_ids_of_tracks_cannot_be_scored() -> None:
    with pytest.raises(InputError, match=r"cannot be scored: .* \(1, \.\.\.\).*Detect with --map"):
        score_lights(moments(["red"] * 4), moments(["red"] * 4, light=1))


def verdict(truth: Iterable[LightStates], found: Iterable[LightStates]) -> Verdict:
    return score_lights(truth, found).verdict


def test_the_verdict_judges_the_figures() -> None:
    assert verdict(moments(["(red)"] * 9), moments(["red"] * 9)) is Verdict.BAD
    assert verdict([], []) is Verdict.BAD
    few = score_lights(moments(["red"] * 9), [], [0, 9 * TENTH_NS])
    assert few.verdict is Verdict.DOUBTFUL
    assert len(few.why) == 3
    many = [m for light in range(12) for m in moments(["red"] * 40, light=light)]
    assert verdict(many, many) is Verdict.GOOD


def test_pieces_end_where_the_light_is_lost_or_changes() -> None:
    said = ["red", "red", "(red)", "red", "red!", "green"]
    series = light_series(moments(said))[LIGHT]
    pieces = list(light_pieces(series, 3 * TENTH_NS))
    assert [(p.rows, p.state, p.flashing, p.changed) for p in pieces] == [
        ((0, 2), "red", False, False),
        ((3, 4), "red", False, False),
        ((4, 5), "red", True, True),
        ((5, 6), "green", False, True),
    ]
