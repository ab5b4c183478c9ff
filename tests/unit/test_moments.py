"""When messages were taken, and which of them belong to a keyframe."""

from __future__ import annotations

import numpy as np

from percept.datasets.labelling.choice.keyframes import KeyframeConfig
from percept.datasets.labelling.choice.moments import StreamStamps, SyncConfig, choose_moments
from percept.datasets.recording import Envelope

_SECOND = 1_000_000_000


def _stamps(*rows: tuple[str, int | None, int]) -> StreamStamps:
    return StreamStamps(Envelope(topic, stamp, at, 1) for topic, stamp, at in rows)


def test_stamps_are_those_of_headers_and_each_is_there_once() -> None:
    stamps = _stamps(("/a", 30, 100), ("/a", 10, 101), ("/a", 30, 102), ("/b", None, 103))
    np.testing.assert_array_equal(stamps.of("/a"), [10, 30])
    np.testing.assert_array_equal(stamps.of("/b"), [103])
    assert (stamps.count("/a"), stamps.count("/nothing")) == (3, 0)
    assert [stamps.recorded_ns("/a", at) for at in (10, 30, 20, 99)] == [101, 100, None, None]
    assert stamps.recorded_ns("/nothing", 10) is None


def test_a_clock_that_stands_says_nothing() -> None:
    rows = [("/zero", 0, 5), ("/zero", 0, 6), ("/same", 9, 7), ("/same", 9, 8), ("/one", 9, 10)]
    stamps = _stamps(*rows, ("/late", 0, 11), ("/late", 12, 13))
    np.testing.assert_array_equal(stamps.of("/zero"), [5, 6])
    np.testing.assert_array_equal(stamps.of("/same"), [7, 8])
    np.testing.assert_array_equal(stamps.of("/one"), [9])
    np.testing.assert_array_equal(stamps.of("/late"), [11, 12])
    assert stamps.unstamped >= {"/zero", "/same"}
    assert not stamps.unstamped & {"/one", "/late"}


def test_cameras_of_other_rates_join_where_they_are_near_enough() -> None:
    fast = [("/fast", n * _SECOND // 10, 0) for n in range(10, 70)]
    slow = [("/slow", n * _SECOND + 30_000_000, 0) for n in range(1, 7)]
    moments = choose_moments(
        _stamps(*fast, *slow), ["/fast", "/slow"], [], None, KeyframeConfig(every_s=0.5),
        SyncConfig(tolerance_s=0.05),
    )  # fmt: skip
    assert len(moments) == 12
    joined = [moment for moment in moments if "/slow" in moment.images]
    used = [moment.images["/slow"] for moment in joined]
    assert len(used) == len(set(used)) == 6
    for moment in joined:
        assert abs(moment.images["/slow"] - moment.instant.stamp_ns) <= 50_000_000


def test_without_a_message_there_is_no_moment() -> None:
    assert choose_moments(_stamps(), ["/a"], ["/b"], None, KeyframeConfig(), SyncConfig()) == ()
