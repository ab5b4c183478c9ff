"""Boxes of lights that are followed in one camera."""

from __future__ import annotations

import numpy as np

from percept.lights.boxes import BoxTracks, follow_boxes

_STEP_NS = 66_000_000
_DEATH_NS = 10**9
_PAIR = np.array([[100.0, 50, 108, 70], [140.0, 50, 148, 70]])


def test_neighbours_keep_their_ids_when_the_camera_shakes() -> None:
    rng = np.random.default_rng(3)
    tracks, ids = follow_boxes(BoxTracks(), 0, _PAIR, 1, _DEATH_NS)
    assert ids.tolist() == [1, 2]
    for frame in range(1, 60):
        # Between two images nearly the whole way to the neighbour, which is 40 px.
        shake = np.tile(rng.uniform(-18, 18, 2), 2)
        order = rng.permutation(2)
        stamp_ns = frame * _STEP_NS
        tracks, ids = follow_boxes(tracks, stamp_ns, (_PAIR + shake)[order], 3, _DEATH_NS)
        assert ids.tolist() == (1 + order).tolist()


def test_a_moving_box_is_found_again_after_a_gap() -> None:
    tracks, ids = BoxTracks(), np.zeros(0, np.int64)
    for frame in range(40):
        box = _PAIR[:1] + 4.0 * frame
        seen = box if not 20 <= frame < 28 else box[:0]
        tracks, ids = follow_boxes(tracks, frame * _STEP_NS, seen, 10 + frame, _DEATH_NS)
    assert ids.tolist() == [10]


def test_a_box_of_another_size_or_after_its_death_is_a_new_light() -> None:
    tracks, _ = follow_boxes(BoxTracks(), 0, _PAIR[:1], 1, _DEATH_NS)
    _, ids = follow_boxes(tracks, _STEP_NS, np.array([[70.0, 0, 140, 200]]), 2, _DEATH_NS)
    assert ids.tolist() == [2]
    _, ids = follow_boxes(tracks, _DEATH_NS + 1, _PAIR[:1], 2, _DEATH_NS)
    assert ids.tolist() == [2]
