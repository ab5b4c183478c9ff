"""Birth, confirmation, end and duplicates of tracks, at any rate of scans."""

from __future__ import annotations

import numpy as np
import pytest

from percept.core.results import Detections3D, Tracks
from percept.tracking import Tracker, TrackerConfig
from percept.tracking.config import ClassSettings

_CAR = ClassSettings(
    motion="turn", t_birth_s=0.2, t_expire_s=0.5, t_prune_s=0.25, keep_score=0.2, birth_score=0.5
)
_CONFIG = TrackerConfig(classes={"car": _CAR, "pedestrian": ClassSettings()})


def _scan(time_s: float, *places: float, score: float = 0.9, sensor: str = "top") -> Detections3D:
    boxes = np.array([[x, 5.0, 0.8, 4.0, 1.8, 1.5, 0.0] for x in places]).reshape(-1, 7)
    stamp_ns = round(time_s * 1e9)
    labels = ("car",) * len(places)
    return Detections3D(stamp_ns, sensor, "odom", boxes, labels, np.full(len(places), score))


def _after(*scans: Detections3D, at_s: float | None = None) -> Tracks:
    tracker = Tracker(_CONFIG)
    for scan in scans:
        tracker.push(scan)
    return tracker.tracks(scans[-1].stamp_ns if at_s is None else round(at_s * 1e9))


@pytest.mark.parametrize("period_s", [0.025, 0.05, 0.1, 0.2])
def test_a_track_is_full_when_it_was_seen_over_t_birth(period_s: float) -> None:
    scans = [_scan(k * period_s, 10.0) for k in range(round(0.2 / period_s) + 1)]
    assert _after(*scans[:-1]).states == ("trial",)
    assert _after(*scans).states == ("full",)


def test_slow_scans_confirm_with_the_second_detection() -> None:
    assert _after(_scan(0.0, 10.0)).states == ("trial",)
    assert _after(_scan(0.0, 10.0), _scan(0.5, 10.0)).states == ("full",)


def test_a_trial_track_ends_after_t_prune() -> None:
    assert len(_after(_scan(0.0, 10.0), _scan(0.25))) == 1
    assert len(_after(_scan(0.0, 10.0), _scan(0.26))) == 0


def test_a_full_track_ends_after_t_expire_and_comes_back_within_it() -> None:
    seen = [_scan(k / 10, 10.0) for k in range(3)]
    assert len(_after(*seen, _scan(0.7))) == 1
    assert len(_after(*seen, _scan(0.71))) == 0
    empty = [_scan(k / 10) for k in range(3, 7)]
    again = _after(*seen, *empty, _scan(0.7, 10.1))
    assert (again.ids.tolist(), again.states, again.observed.tolist()) == ([0], ("full",), [True])


def test_without_scans_tracks_end_as_well() -> None:
    seen = [_scan(k / 10, 10.0) for k in range(3)]
    assert len(_after(*seen, at_s=0.69)) == 1
    assert len(_after(*seen, at_s=0.71)) == 0


def test_an_object_that_is_found_late_is_a_new_one() -> None:
    seen = [_scan(k / 10, 10.0) for k in range(3)]
    assert _after(*seen, _scan(0.75), _scan(0.8, 10.0)).ids.tolist() == [1]


def test_a_weak_detection_continues_and_does_not_begin() -> None:
    assert len(_after(_scan(0.0, 10.0, score=0.4))) == 0
    weak = _after(_scan(0.0, 10.0), _scan(0.1, 10.0), _scan(0.2, 10.0, score=0.4))
    assert (weak.states, weak.observed.tolist()) == (("full",), [True])


def test_a_weak_detection_does_not_take_a_track_from_a_sure_one() -> None:
    scan = _scan(0.1, 10.0, 11.5)
    mixed = Detections3D(
        scan.stamp_ns, "top", "odom", scan.boxes_m, scan.labels, np.array([0.4, 0.9])
    )
    tracks = _after(_scan(0.0, 10.0), mixed)
    assert len(tracks) == 1
    assert tracks.boxes_m[0, 0] > 11.0


def test_what_is_below_the_score_of_its_class_is_counted() -> None:
    tracker = Tracker(_CONFIG)
    tracker.push(_scan(0.0, 10.0, 20.0, score=0.1))
    assert dict(tracker.dropped) == {"boxes below the score of their class": 2}
    assert len(tracker.tracks(0)) == 0


def test_two_detections_of_one_object_make_one_track() -> None:
    tracks = _after(_scan(0.0, 10.0, 10.2))
    assert tracks.ids.tolist() == [0]
    assert _after(_scan(0.0, 10.0, 14.1)).ids.tolist() == [0, 1]


def test_two_full_tracks_with_their_own_detections_are_two_objects() -> None:
    # Two cars come together until their boxes overlap by more than the limit.
    scans = [_scan(k / 10, 10.0 + k * 0.4, 17.0 - k * 0.4) for k in range(8)]
    tracks = _after(*scans)
    assert tracks.ids.tolist() == [0, 1]
    assert abs(tracks.boxes_m[0, 0] - tracks.boxes_m[1, 0]) < 1.7


def test_one_of_two_that_is_not_seen_any_more_gives_way() -> None:
    scans = [_scan(k / 10, 10.0 + k * 0.4, 17.0 - k * 0.4) for k in range(8)]
    single = [_scan(k / 10, 13.2) for k in range(8, 10)]
    assert len(_after(*scans, *single)) == 1


def test_scans_of_another_sensor_that_see_nothing_do_no_harm() -> None:
    scans = []
    for k in range(10):
        scans += [_scan(k / 10, 10.0), _scan(k / 10 + 0.03, sensor="rear")]
    tracks = _after(*scans)
    assert (tracks.ids.tolist(), tracks.states) == ([0], ("full",))


def test_a_score_is_the_mean_of_the_confidences() -> None:
    tracks = _after(_scan(0.0, 10.0, score=0.9), _scan(0.1, 10.0, score=0.6), _scan(0.2))
    assert tracks.scores == pytest.approx([0.75])


def test_an_id_is_never_used_twice() -> None:
    tracker = Tracker(_CONFIG)
    ids: list[int] = []
    for k in range(20):  # every scan sees something else
        tracker.push(_scan(k, 10.0 + 30 * k))
        ids += tracker.tracks(k * 10**9).ids.tolist()
    assert ids == list(range(20))
