"""Which images are labelled: poor ones, duplicates, budgets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_looks import look_of_place

from percept.datasets.labelling.choice.evidence import FrameEvidence
from percept.datasets.labelling.choice.ranking import rank
from percept.datasets.labelling.choice.selection import Candidate, Decision, SelectionConfig, decide

_CONFIG = SelectionConfig()
_PLACES = {n: look_of_place(n) for n in range(12)}
_KEPT = Decision()


def _drive(
    name: str, places: Sequence[int], cameras: Sequence[str] = ("front",), offset: int = 0
) -> list[Candidate]:
    """Return the images of a drive through places; of each camera the place `offset` later."""
    return [
        Candidate(
            drive=name, camera=camera, stamp_ns=100 * k + i, keyframe_ns=100 * k,
            look=_PLACES[(place + i * offset) % 12],
        )
        for k, place in enumerate(places)
        for i, camera in enumerate(cameras)
    ]  # fmt: skip


def _evidence(
    labels: Sequence[str], tracks: Sequence[int] | None = None, **more: float
) -> FrameEvidence:
    return FrameEvidence(
        stamp_ns=0, labels=tuple(labels), confidences=np.ones(len(labels)),
        track_ids=None if tracks is None else np.array(tracks, np.int64), **more,
    )  # fmt: skip


def test_duplicates_name_what_they_repeat_over_all_drives() -> None:
    candidates = [*_drive("a", [0, 0, 1]), *_drive("b", [2, 1, 0, 3])]
    again = {1: 0, 4: 2, 5: 0}
    assert decide(candidates, _CONFIG) == tuple(
        Decision(dropped="duplicate", of=again[i]) if i in again else _KEPT for i in range(7)
    )


def test_a_poor_image_is_no_original() -> None:
    looks = [_PLACES[0], *(_PLACES[n] for n in range(1, 6)), _PLACES[0]]
    candidates = [
        replace(c, look=look) for c, look in zip(_drive("a", range(7)), looks, strict=True)
    ]
    candidates[0] = replace(candidates[0], look=replace(_PLACES[0], sharpness=0.1))
    assert decide(candidates, _CONFIG) == (Decision(dropped="blurred"), *[_KEPT] * 6)


def test_blur_is_judged_by_camera_and_drive() -> None:
    def soft(candidate: Candidate) -> Candidate:
        assert candidate.look is not None
        return replace(candidate, look=replace(candidate.look, sharpness=0.5))

    plain = _drive("a", range(6), ("front", "left"), offset=6)
    always_soft = [soft(c) if c.camera == "left" else c for c in plain]
    once_soft = [soft(c) if i == 3 else c for i, c in enumerate(plain)]
    assert set(decide(always_soft, _CONFIG)) == {_KEPT}
    assert decide(once_soft, _CONFIG)[3] == Decision(dropped="blurred")


def test_the_two_cameras_of_a_pair_are_both_kept() -> None:
    candidates = _drive("a", [0, 1, 0], ("left", "right"))
    dropped = [d.of for d in decide(candidates, _CONFIG)]
    assert dropped == [None, None, None, None, 0, 0]


def test_scans_alone_are_kept() -> None:
    candidates = [replace(c, look=None, camera="") for c in _drive("a", [0, 0, 0])]
    assert decide(candidates, _CONFIG) == (_KEPT,) * 3


def test_checks_can_be_left_out() -> None:
    candidates = [replace(c, look=replace(_PLACES[0], dark_share=1.0)) for c in _drive("a", [0, 0])]
    everything = SelectionConfig(quality=None, duplicates=None)
    assert decide(candidates, everything) == (_KEPT,) * 2
    assert {d.dropped for d in decide(candidates, _CONFIG)} == {"under-exposed"}


_DRIVES = st.lists(st.lists(st.integers(0, 11), max_size=8), min_size=1, max_size=5)


@given(_DRIVES, st.integers(0, 5))
def test_later_logs_change_no_decision(drives: list[list[int]], count: int) -> None:
    logs = [_drive(f"log{i}", places) for i, places in enumerate(drives)]
    earlier = [c for log in logs[:count] for c in log]
    everything = [c for log in logs for c in log]
    assert decide(everything, _CONFIG)[: len(earlier)] == decide(earlier, _CONFIG)


@given(_DRIVES)
def test_every_picture_is_kept_once(drives: list[list[int]]) -> None:
    candidates = [c for i, places in enumerate(drives) for c in _drive(f"log{i}", places)]
    flat = [place for places in drives for place in places]
    decisions = decide(candidates, _CONFIG)
    kept = [place for place, d in zip(flat, decisions, strict=True) if d.dropped is None]
    assert sorted(kept) == sorted(set(flat))
    for place, decision in zip(flat, decisions, strict=True):
        assert decision.of is None or (
            flat[decision.of] == place and decisions[decision.of].dropped is None
        )


@given(_DRIVES, st.integers(0, 12))
def test_a_budget_is_kept_and_takes_whole_keyframes(drives: list[list[int]], budget: int) -> None:
    cameras = ("front", "left")
    candidates = [
        c for i, places in enumerate(drives) for c in _drive(f"log{i}", places, cameras, offset=6)
    ]
    free, bound = decide(candidates, _CONFIG), decide(candidates, _CONFIG, budget)
    taken = [i for i, d in enumerate(bound) if d.dropped is None]
    could = sum(d.dropped is None for d in free)
    assert len(taken) <= budget
    assert len(taken) >= min(budget - 1, could)
    for index, (before, after) in enumerate(zip(free, bound, strict=True)):
        left_out = before.dropped is None and index not in taken
        assert after == (Decision(dropped="budget") if left_out else before)
    moments = {(candidates[i].drive, candidates[i].keyframe_ns) for i in taken}
    whole = [
        i for i, c in enumerate(candidates)
        if free[i].dropped is None and (c.drive, c.keyframe_ns) in moments
    ]  # fmt: skip
    assert taken == whole


def test_rare_classes_come_first() -> None:
    evidence = [_evidence(["car"]) for _ in range(200)]
    rare = {17: "deer", 60: "deer", 93: "tram", 150: "barrel"}
    for index, label in rare.items():
        evidence[index] = _evidence(["car", label])
    taken = rank(evidence, ["a"] * 200, 8)
    assert {93, 150} <= set(taken[:3])
    assert {17, 60} & set(taken[:3])
    assert {17, 60} <= set(taken)


def test_objects_that_were_taken_count_no_more() -> None:
    tracks = [[1], [1], [1], [2], [2], [2], [3], [3], [3]]
    evidence = [_evidence(["car"], ids) for ids in tracks]
    assert {tracks[i][0] for i in rank(evidence, list("aaaaaaaaa"), 3)} == {1, 2, 3}
    # Numbers of tracks mean something within a drive only.
    assert set(rank([_evidence(["car"], [1])] * 4, list("aaab"), 2)) == {0, 3}


def test_unsure_and_disputed_moments_come_before_others() -> None:
    evidence = [_evidence(["car"]) for _ in range(20)]
    evidence[7] = _evidence(["car"], disagreement=1.0)
    evidence[13] = replace(evidence[13], confidences=np.array([0.5]))
    drives = [f"log{i}" for i in range(20)]
    assert set(rank(evidence, drives, 2)) == {7, 13}


@pytest.mark.parametrize("count", [1, 2, 7, 64, 100])
def test_without_evidence_moments_are_taken_evenly(count: int) -> None:
    taken = rank([None] * 100, ["a"] * 100, count)
    assert len(set(taken)) == count
    gaps = np.diff(np.sort([*taken, 100]))
    assert gaps.max() <= 2 * np.ceil(100 / count)


@given(
    st.lists(
        st.tuples(
            st.sampled_from("ab"),
            st.lists(st.tuples(st.sampled_from("xyz"), st.integers(-1, 4)), max_size=4),
            st.floats(0, 1),
        ),
        max_size=25,
    )
)
def test_it_is_the_greedy_choice_and_a_larger_one_goes_on_from_a_smaller(
    moments: list[tuple[str, list[tuple[str, int]], float]],
) -> None:
    drives = [drive for drive, _, _ in moments]
    evidence = [
        _evidence([label for label, _ in found], [track for _, track in found], disagreement=odd)
        for _, found, odd in moments
    ]
    taken = rank(evidence, drives, 10)
    assert sorted(rank(evidence, drives, 99)) == list(range(len(moments)))
    assert rank(evidence, drives, 4) == taken[:4]
    for done in range(len(taken)):
        gains = [_gain(i, taken[:done], evidence, drives) for i in range(len(moments))]
        left = [gain for i, gain in enumerate(gains) if i not in taken[:done]]
        assert gains[taken[done]] == pytest.approx(max(left), abs=1e-9)


def _gain(
    index: int, taken: Sequence[int], evidence: Sequence[FrameEvidence], drives: Sequence[str]
) -> float:
    """Compute the gain of a moment from scratch."""

    def things(i: int) -> dict[object, str]:
        ids = evidence[i].track_ids
        assert ids is not None
        return {
            (drives[i], track) if track >= 0 else (i, label): label
            for label, track in zip(evidence[i].labels, ids.tolist(), strict=True)
        }

    shown: dict[object, str] = {}
    for i in taken:
        shown |= {thing: label for thing, label in things(i).items() if thing not in shown}
    of_class = list(shown.values())
    objects = sum(2 / (1 + of_class.count(c)) for t, c in things(index).items() if t not in shown)
    place = {i: drives[:i].count(drives[i]) for i in range(len(drives))}
    near = [abs(place[i] - place[index]) for i in taken if drives[i] == drives[index]]
    return objects + evidence[index].disagreement / 2 + 1.5 * min([16, *near]) / 16
