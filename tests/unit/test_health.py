"""The watchdog over a finished run: when it would have fired, for how long, and how often."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import pytest

from percept.core.health import MOST_SPANS, HealthSpan, StreamHealth, stream_health
from percept.datasets.inspection import InspectConfig
from percept.datasets.inspection.timing import StreamWatch
from percept.datasets.inspection.watchdog import lateness_of
from percept.datasets.recording import Envelope
from percept.export.health import health_as_json, run_health

_START_NS = 1_700_000_000_000_000_000
_STEP_NS = 100_000_000


def _at(steps: Sequence[float]) -> list[int]:
    return [_START_NS + round(step * _STEP_NS) for step in steps]


def _span(steps: tuple[float, float], reason: str) -> HealthSpan:
    start, end = _at(steps)
    return HealthSpan(start, end, reason)


def _health(steps: Sequence[float], **options: float) -> StreamHealth:
    start, end = _at([0, 100])
    return stream_health(_at(steps), (start, end), **options)


class TestStream:
    def test_a_steady_stream_is_never_late(self) -> None:
        found = _health(range(101))
        assert found.rate_hz == pytest.approx(10)
        assert found.nominal_hz == pytest.approx(10)
        assert found.spans == ()
        assert found.lateness is not None
        assert (found.lateness.late_share, found.lateness.late_spans) == (0, 0)
        assert found.lateness.timeout_s == pytest.approx(0.3)

    def test_silences_begin_when_the_timeout_has_passed(self) -> None:
        found = _health([*range(10, 41), *range(60, 81)])
        assert found.spans == (
            _span((3, 10), "not started"),
            _span((43, 60), "silent"),
            _span((83, 100), "ended"),
        )
        assert found.lateness is not None
        assert found.lateness.late_s == pytest.approx(0.7 + 1.7 + 1.7)
        assert found.lateness.late_share == pytest.approx(0.41)
        assert found.lateness.longest_s == pytest.approx(1.7)
        assert found.rate_hz == pytest.approx(51 / 7)

    def test_any_order_of_arrival_is_the_same(self) -> None:
        steps = [*range(10, 41), *range(60, 81), 60]
        shuffled = np.random.default_rng(1).permutation(steps).tolist()
        assert _health(shuffled) == _health(steps)

    def test_a_rate_that_is_given_rules(self) -> None:
        slow = _health(range(0, 101, 5))
        assert slow.spans == ()
        found = _health(range(0, 101, 5), nominal_hz=10.0)
        assert found.nominal_hz == 10.0
        assert found.rate_hz == pytest.approx(2)
        assert len(found.spans) == 20
        assert found.spans[0] == _span((3, 5), "silent")

    def test_fast_streams_have_a_least_timeout(self) -> None:
        fast = np.arange(0, 100, 0.05).tolist()  # 200 Hz
        hole = [step for step in fast if not 40 < step < 40.9]
        assert _health(hole).spans == ()
        assert len(_health(hole, minimum_timeout_s=0.05).spans) == 1

    def test_very_many_spans_are_counted_and_the_longest_named(self) -> None:
        steps = np.cumsum(np.where(np.arange(900) % 3, 1.0, 5.0 + np.arange(900) / 1000))
        found = stream_health(_at(steps.tolist()), (_START_NS, _at(steps.tolist())[-1]))
        assert found.lateness is not None
        assert found.lateness.late_spans == 300
        assert len(found.spans) == MOST_SPANS
        starts = [span.start_ns for span in found.spans]
        assert starts == sorted(starts)
        assert min(starts) > _at([1500])[0]  # the silences grow

    @pytest.mark.parametrize("steps", [[], [50]])
    def test_too_little_for_a_rhythm(self, steps: list[int]) -> None:
        found = _health(steps)
        assert (found.rate_hz, found.nominal_hz, found.lateness) == (None, None, None)
        assert found.messages == len(steps)

    def test_a_stream_that_never_came_is_late_if_it_was_expected(self) -> None:
        found = _health([], nominal_hz=10.0)
        assert found.spans == (_span((3, 100), "not started"),)
        assert found.lateness is not None
        assert found.lateness.late_share == pytest.approx(0.97)


def test_inspection_and_run_agree() -> None:
    """The inspection sees envelopes once, with flat memory; the run has all times at hand."""
    steps = [*range(10, 41), *range(60, 81)]
    watch = StreamWatch(InspectConfig(), "lidar")
    for stamp_ns in _at(steps):
        watch.add(Envelope("/top", None, stamp_ns, 10))
    start, end = _at([0, 100])
    seen = lateness_of(watch, 0.1, (start, end), InspectConfig())
    found = _health(steps, nominal_hz=10.0)
    assert found.lateness is not None
    assert seen.spans == found.lateness.spans
    assert seen.late_s == pytest.approx(found.lateness.late_s)
    assert seen.late_spans == found.lateness.late_spans


class TestRun:
    def test_streams_share_their_time(self) -> None:
        health = run_health({"top": _at(range(101)), "front yolo": _at(range(51))})
        assert list(health) == ["top", "front yolo"]
        assert health["top"].spans == ()
        assert health["front yolo"].spans == (_span((53, 100), "ended"),)

    def test_says_it_in_json(self) -> None:
        health = run_health({"top": _at([*range(41), *range(60, 101)]), "none": []}, {"top": 10.0})
        document = json.loads(json.dumps(health_as_json(health), allow_nan=False))
        assert document["top"] == {
            "messages": 82,
            "rate_hz": pytest.approx(8.1),
            "nominal_hz": 10.0,
            "timeout_s": pytest.approx(0.3),
            "late_share": pytest.approx(0.17),
            "late_spans": 1,
            "spans": [{"start_ns": _at([43])[0], "end_ns": _at([60])[0], "reason": "silent"}],
        }
        assert document["none"]["late_share"] is None

    def test_no_events_at_all(self) -> None:
        assert run_health({}) == {}
        assert run_health({"top": []})["top"].messages == 0
