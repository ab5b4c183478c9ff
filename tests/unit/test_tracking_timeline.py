"""What a tracker answers about long ago: made again exactly, without keeping it all."""

from __future__ import annotations

import tracemalloc
from dataclasses import fields

import numpy as np
import pytest

from percept.core.results import Detections3D, Tracks
from percept.tracking import Tracker, TrackerConfig
from percept.tracking.history import TrackHistory

_STEPS = 150  # some stretches of the timeline
_STEP_NS = 100_000_000


def _scans(objects: int, steps: int = _STEPS) -> list[Detections3D]:
    """Objects on a grid that walk about and are sometimes missed; the last one soon leaves."""
    rng = np.random.default_rng(5)
    boxes = np.zeros((objects, 7))
    boxes[:, :2] = np.stack(np.divmod(np.arange(objects), 10), axis=1) * 12.0
    boxes[:, 3:6] = [4.2, 1.8, 1.5]
    scans = []
    for k in range(steps):
        boxes[:, :2] += rng.normal(0, 0.2, (objects, 2))
        seen = rng.random(objects) < (0.8 if k % 40 else 0.0)
        seen[-1] &= k < 20
        labels, scores = ("car",) * int(seen.sum()), rng.uniform(0.3, 0.9, int(seen.sum()))
        scans.append(Detections3D(k * _STEP_NS, "top", "map", boxes[seen], labels, scores))
    return scans


def _tracked(scans: list[Detections3D]) -> tuple[Tracker, list[Tracks]]:
    tracker, answers = Tracker(TrackerConfig(rollback_window_s=0.5)), []
    for scan in scans:
        tracker.push(scan)
        answers.append(tracker.tracks(scan.stamp_ns + _STEP_NS // 3))
    return tracker, answers


def _assert_equal(first: Tracks | TrackHistory, second: Tracks | TrackHistory) -> None:
    for field in fields(first):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name))


@pytest.mark.parametrize("backwards", [False, True])
def test_old_answers_stay_what_they_were(backwards: bool) -> None:  # noqa: FBT001
    tracker, answers = _tracked(_scans(8))
    order = np.arange(_STEPS)[::-7] if backwards else np.random.default_rng(0).permutation(_STEPS)
    for k in order:
        _assert_equal(answers[k], tracker.tracks(k * _STEP_NS + _STEP_NS // 3))


def test_histories_say_what_was_answered_at_every_scan() -> None:
    tracker, _ = _tracked(_scans(8))
    at = {k * _STEP_NS: tracker.tracks(k * _STEP_NS) for k in range(_STEPS)}
    rows = 0
    for history in tracker.histories():
        for k, stamp_ns in enumerate(history.stamps_ns.tolist()):
            row = at[stamp_ns].ids.tolist().index(history.track_id)
            np.testing.assert_array_equal(at[stamp_ns].boxes_m[row, :3], history.states[k, :3])
            rows += 1
    assert rows == sum(len(tracks) for tracks in at.values()) > 1000


def test_histories_one_by_one_are_the_same() -> None:
    tracker, _ = _tracked(_scans(8))
    each = {history.track_id: history for history in tracker.each_history()}
    histories = tracker.histories()
    assert [history.track_id for history in histories] == sorted(each)
    assert list(each) != sorted(each)  # some ended before older ones
    for history in histories:
        _assert_equal(history, each[history.track_id])


def test_a_step_that_is_long_ago_takes_little_memory() -> None:
    scans = _scans(60, 200)
    tracemalloc.start()
    tracker, sizes = Tracker(TrackerConfig(rollback_window_s=0.5)), []
    for scan in scans:
        tracker.push(scan)
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    a_step = (sizes[-1] - sizes[40]) / (len(sizes) - 41)
    assert a_step < 12_000  # a table of 60 tracks has 36 kB, the measurements of a scan have 5 kB
