"""Tracking metrics on sequences that can be worked out by hand, and KITTI's rules."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from percept.core.errors import GeometryError, InputError
from percept.core.results import Tracks
from percept.core.tracked_boxes import TrackedBoxes
from percept.evaluation.tracks.clear import clear_scores, match_over_time
from percept.evaluation.tracks.drive import score_class
from percept.evaluation.tracks.frames import TrackFrame, assign_rows, pair_frames
from percept.evaluation.tracks.kitti_rules import KittiSequence
from percept.evaluation.tracks.recalls import score_recalls
from percept.evaluation.tracks.replay import detection_scans, tracked_boxes
from percept.evaluation.tracks.similarity import centre_closeness, image_iou, space_iou

_BOX_PX = (100.0, 100.0, 160.0, 150.0)


def _frames(history: list[list[int]], track_count: int = 3) -> list[TrackFrame]:
    """Return frames in which object k has the track that is named, or -1."""
    frames = []
    for partners in history:
        similarity = np.zeros((len(partners), track_count))
        for row, track in enumerate(partners):
            if track >= 0:
                similarity[row, track] = 0.9
        frames.append(TrackFrame(np.arange(len(partners)), np.arange(track_count), similarity))
    return frames


def _boxes(
    rows: list[tuple[int, int, float]], label: str = "Car", score: float = 1.0
) -> TrackedBoxes:
    """Return boxes (frame, id, x) of 4 x 2 x 1.5 m that are far apart in the image."""
    x = np.array([row[2] for row in rows])
    boxes = np.tile([0.0, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0], (len(rows), 1))
    boxes[:, 0] = x
    pixels = np.tile(_BOX_PX, (len(rows), 1))
    pixels[:, [0, 2]] += 10 * x[:, None]
    return TrackedBoxes(
        frames=np.array([row[0] for row in rows], np.int64),
        ids=np.array([row[1] for row in rows], np.int64),
        labels=(label,) * len(rows),
        boxes_m=boxes,
        boxes_px=pixels,
        scores=np.full(len(rows), score),
    )


def test_switches_count_over_gaps_and_fragments_do_not_need_them() -> None:
    frames = _frames([[0], [0], [-1], [1], [1], [-1]])
    scores = clear_scores(frames, match_over_time(frames))
    assert (scores.switches, scores.fragmentations, scores.matches) == (1, 1, 4)
    assert scores.mota == pytest.approx(1 - (2 + (18 - 4) + 1) / 6)
    assert scores.motp == pytest.approx(0.1)
    assert (scores.mostly_tracked, scores.partially_tracked, scores.mostly_lost) == (0, 1, 0)


def test_a_pair_of_the_past_is_kept_although_another_is_nearer() -> None:
    before = TrackFrame(np.array([7]), np.array([1, 2]), np.array([[0.9, 0.6]]))
    after = TrackFrame(np.array([7]), np.array([1, 2]), np.array([[0.55, 0.9]]))
    matches = match_over_time([before, after])
    assert [columns.tolist() for _, columns in matches] == [[0], [0]]
    lost = replace(after, similarity=np.array([[0.45, 0.9]]))
    assert match_over_time([before, lost])[1][1].tolist() == [1]


def test_as_many_pairs_as_possible_come_before_good_ones() -> None:
    similarity = np.array([[0.9, 0.5], [0.55, 0.1]])
    assert [part.tolist() for part in assign_rows(similarity, 0.5)] == [[0, 1], [1, 0]]
    assert [part.tolist() for part in assign_rows(similarity, 0.6)] == [[0], [0]]


def test_an_identity_twice_in_a_frame_is_refused() -> None:
    twice = _boxes([(3, 1, 0.0), (3, 1, 50.0)])
    with pytest.raises(InputError, match="id 1 comes twice in frame 3 of the tracks"):
        pair_frames(_boxes([(3, 1, 0.0)]), twice, space_iou)
    with pytest.raises(GeometryError, match="must not fall"):
        _boxes([(3, 1, 0.0), (2, 1, 0.0)])


def test_similarities() -> None:
    here, there = _boxes([(0, 1, 0.0)]), _boxes([(0, 1, 2.0)])
    assert space_iou(here, there)[0, 0] == pytest.approx(1 / 3)
    assert image_iou(here, there)[0, 0] == pytest.approx(40 / 80)
    gate = np.hypot(4.0, 2.0) / 2  # half the diagonal is more than 2 m
    assert centre_closeness(here, there)[0, 0] == pytest.approx(1 - 2 / (2 * gate))
    small = replace(here, boxes_m=here.boxes_m * np.array([1, 1, 1, 0.5, 0.5, 1, 1]))
    assert centre_closeness(small, there)[0, 0] == pytest.approx(0.5)
    blind = replace(there, boxes_px=np.full((1, 4), np.nan))
    assert image_iou(here, blind)[0, 0] == 0.0


def _counts(truth: TrackedBoxes, tracks: TrackedBoxes) -> tuple[int, int, int]:
    counts = KittiSequence(truth, tracks, "Car", space_iou, 0.5).counts()
    return counts.objects, counts.matches, counts.false_positives


def test_what_kitti_does_not_count() -> None:
    truth, tracks = _boxes([(0, 1, 0.0)]), _boxes([(0, 5, 0.0), (0, 6, 30.0)])
    assert _counts(truth, tracks) == (1, 1, 1)
    van = _boxes([(0, 1, 0.0)], "Van")
    assert _counts(van, tracks) == (0, 0, 1)  # neither right nor wrong
    assert _counts(replace(truth, truncated=np.array([1])), tracks) == (0, 0, 1)
    assert _counts(replace(truth, occluded=np.array([3])), tracks) == (0, 0, 1)
    assert _counts(replace(truth, occluded=np.array([2])), tracks) == (1, 1, 1)
    assert _counts(truth, _boxes([(0, 5, 0.0)], "Pedestrian")) == (1, 0, 0)


def test_a_low_box_or_one_where_nobody_labelled_is_no_mistake() -> None:
    truth, tracks = _boxes([(0, 1, 0.0)]), _boxes([(0, 6, 30.0)])
    assert _counts(truth, tracks) == (1, 0, 1)
    low = tracks.boxes_px.copy()
    low[:, 3] = low[:, 1] + 25.0
    assert _counts(truth, replace(tracks, boxes_px=low)) == (1, 0, 0)
    for share, false in ((0.49, 1), (0.51, 0)):
        region = tracks.boxes_px.copy()
        region[:, 2] = region[:, 0] + 60.0 * share
        both = replace(
            _boxes([(0, 1, 0.0), (0, -1, 30.0)]),
            labels=("Car", "DontCare"),
            boxes_px=np.concatenate([truth.boxes_px, region]),
        )
        assert _counts(both, tracks) == (1, 0, false)


@pytest.mark.parametrize(
    ("tracks", "ignored", "switches", "fragments"),
    [
        ([5, 5, 5, 5], (), 0, 0),
        ([5, 5, 6, 6], (), 1, 1),
        ([5, -1, 6, 6], (), 0, 1),  # across a gap it is no switch
        ([5, -1, 5, -1], (), 0, 0),  # found for one frame only
        ([5, -1, -1, 5], (), 0, 1),  # at the end one frame is enough
        ([5, 5, 6, 6], (1,), 0, 0),  # nothing is compared across what does not count
        ([-1, -1, 5, 5], (), 0, 0),
    ],
)
def test_switches_and_fragments_by_the_rules_of_kitti(
    tracks: list[int], ignored: tuple[int, ...], switches: int, fragments: int
) -> None:
    truth = _boxes([(k, 1, 0.0) for k in range(4)])
    occluded = np.array([3 if k in ignored else 0 for k in range(4)])
    made = _boxes([(k, name, 0.0) for k, name in enumerate(tracks) if name >= 0])
    sequence = KittiSequence(replace(truth, occluded=occluded), made, "Car", space_iou, 0.5)
    counts = sequence.counts()
    assert (counts.switches, counts.fragmentations) == (switches, fragments)


def test_the_best_threshold_leaves_out_false_tracks_and_unreached_recalls_are_zero() -> None:
    truth = _boxes([(k, name, 20.0 * name) for k in range(10) for name in (0, 1)])
    right = _boxes([(k, 7, 0.0) for k in range(10)], score=0.75)
    false = _boxes([(k, 8, 90.0) for k in range(10)], score=0.25)
    order = np.argsort(np.concatenate([right.frames, false.frames]), kind="stable")
    tracks = TrackedBoxes(
        frames=np.concatenate([right.frames, false.frames])[order],
        ids=np.concatenate([right.ids, false.ids])[order],
        labels=("Car",) * 20,
        boxes_m=np.concatenate([right.boxes_m, false.boxes_m])[order],
        boxes_px=np.concatenate([right.boxes_px, false.boxes_px])[order],
        scores=np.concatenate([right.scores, false.scores])[order],
    )
    sequence = KittiSequence(truth, tracks, "Car", space_iou, 0.5)
    scores = score_recalls([sequence])
    assert sequence.counts().mota == 0.0
    assert (scores.best.mota, scores.best_score) == (0.5, 0.75)
    # All 20 recalls up to 0.5 hold the whole track; the other 20 are not reached.
    assert len(scores.curve) == 20
    assert scores.samota == pytest.approx(0.5)  # 1 at each of them
    assert scores.amota == pytest.approx(0.25)
    assert scores.amotp == pytest.approx(0.5)
    kept = [frame.track_ids.tolist() for frame in sequence.frames(0.75)]
    assert kept == [[7]] * 10


def test_the_recall_above_the_highest_counts_with_all_tracks() -> None:
    truth = _boxes([(k, 1, 0.0) for k in range(200)])
    tracks = _boxes([(k, 7, 0.0) for k in range(101)], score=0.75)
    scores = score_recalls([KittiSequence(truth, tracks, "Car", space_iou, 0.5)])
    assert [recall for recall, *_ in scores.curve][-2:] == pytest.approx([0.5, 0.525])
    # 99 missed, of which 0.475 * 200 = 95 are allowed there.
    assert scores.curve[-1][2] == pytest.approx(1 - 4 / 105)


def _moment(frame: int, *, observed: bool, state: str = "full", score: float = 0.5) -> Tracks:
    return Tracks(
        stamp_ns=frame * 100_000_000,
        frame_id="camera_level",
        ids=np.array([4]),
        boxes_m=np.array([[frame, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]]),
        velocities_mps=np.array([[10.0, 0.0]]),
        labels=("car",),
        label_probabilities=np.ones(1),
        states=(state,),
        position_sd_m=np.ones(1),
        velocity_sd_mps=np.ones(1),
        observed=np.array([observed]),
        scores=np.array([score]),
    )


def test_tracks_get_their_pixels_and_scores_from_the_detections() -> None:
    found = _boxes([(0, -1, 0.0), (1, -1, 1.1), (1, -1, 9.0)])
    scans = list(detection_scans(found, 3))
    assert [len(scan) for scan in scans] == [1, 2, 0]
    assert scans[1].labels == ("car", "car")
    moments = [
        _moment(0, observed=True, state="trial"),
        _moment(1, observed=True, score=0.8),
        _moment(2, observed=False, score=0.8),
        _moment(3, observed=False, score=0.8),
    ]
    made = tracked_boxes(found, moments, coast_frames=1, names={"car": "Car"}, weak_score=0.1)
    assert made.frames.tolist() == [1, 2]  # not on trial, and not two frames after it was seen
    assert made.labels == ("Car", "Car")
    np.testing.assert_allclose(made.boxes_px[:, 0], 111.0)
    # The detections in it, and six weak ones: two seen beside what is on trial.
    expected = (found.scores[:2].sum() + 6 * 0.1) / 8
    np.testing.assert_allclose(made.scores, expected)
    assert not len(tracked_boxes(found, moments, coast_frames=1, names={"truck": "Truck"}))


def test_hidden_objects_of_a_drive_do_not_count_nor_do_tracks_on_them() -> None:
    rows = [(k, name, 20.0 * name) for k in range(4) for name in (0, 1)]
    truth = replace(_boxes(rows), velocities_mps=np.tile([3.0, 0.0], (8, 1)))
    tracks = replace(_boxes(rows), velocities_mps=np.tile([3.0, 4.0], (8, 1)))
    hidden = truth.ids == 1
    scores = score_class(truth, hidden, tracks)
    clear = scores.tracks.clear
    assert (clear.objects, clear.matches, clear.false_positives) == (4, 4, 0)
    assert scores.velocity.rmse_mps == pytest.approx(4.0)
    assert score_class(truth, ~hidden & hidden, tracks.select(hidden)).tracks.clear.misses == 4
    far = replace(tracks, boxes_m=tracks.boxes_m + np.array([0, 2.3, 0, 0, 0, 0, 0]))
    assert score_class(truth, hidden, far).tracks.clear.false_positives == 8
