"""A drive with hindsight: gaps, sizes that come into view, frames, and the moments between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.results import Detections2D, Detections3D, Tracks
from percept.core.trajectory import Trajectory
from percept.tracking import TrackedDrive, track_drive
from percept.tracking.config import TrackerConfig
from percept.tracking.history import TrackHistory
from percept.tracking.join import JoinConfig, join_tracks, whole_track
from percept.tracking.pieces import Piece
from percept.tracking.tracker import Tracker

F64 = NDArray[np.float64]

_STEP_NS = 100_000_000
_SIZES = {
    "car": [4.4, 1.8, 1.5],
    "van": [8.0, 3.4, 3.0],  # the tracker takes it for a car
    "cyclist": [4.4, 1.8, 1.5],
    "pedestrian": [0.6, 0.6, 1.7],
}
_JOINING = JoinConfig()
_NO_JOINING = JoinConfig(longest_gap_s=0.0)
# An object: label, first position, velocity, first and last step.
Object = tuple[str, tuple[float, float], tuple[float, float], range]


def scan(step: int, objects: list[Object], noise_m: float = 0.0, seed: int = 0) -> Detections3D:
    rng = np.random.default_rng([seed, step])
    boxes, labels = [], []
    for label, start, velocity, steps in objects:
        if step in steps:
            place = np.add(start, np.multiply(velocity, 0.1 * step)) + rng.normal(0, noise_m, 2)
            yaw = np.arctan2(velocity[1], velocity[0])
            boxes.append([*place, 0.8, *_SIZES[label], yaw])
            labels.append(label)
    return of_boxes(step, np.array(boxes).reshape(-1, 7), tuple(labels))


def of_boxes(step: int, boxes: F64, labels: tuple[str, ...]) -> Detections3D:
    return Detections3D(
        stamp_ns=step * _STEP_NS,
        sensor="lidar",
        frame_id="map",
        boxes_m=boxes,
        labels=labels,
        confidences=np.full(len(labels), 0.9),
    )


def standing(count: int, place: tuple[float, float] = (0.0, 0.0)) -> Trajectory:
    matrix = np.eye(4)
    matrix[:2, 3] = place
    return Trajectory("map", "base_link", np.array([0, count * _STEP_NS]), np.array([matrix] * 2))


def drive(
    objects: list[Object], count: int, joining: JoinConfig = _JOINING, noise_m: float = 0.05
) -> TrackedDrive:
    scans = [scan(step, objects, noise_m) for step in range(count)]
    return track_drive(scans, poses=standing(count), joining=joining)


def without(steps: range, gap: range) -> range:
    """The steps as a list of those outside a gap, which `in` can be asked of like a range."""
    return [step for step in steps if step not in gap]  # type: ignore[return-value]


def ids_of(tracked: TrackedDrive) -> list[list[int]]:
    return [frame.ids.tolist() for frame in tracked.frames()]


GAP = range(20, 40)


def test_a_gap_is_closed_and_filled() -> None:
    objects: list[Object] = [("car", (0.0, 0.0), (8.0, 0.0), without(range(60), GAP))]
    apart = drive(objects, 60, _NO_JOINING)
    assert apart.joined == 0
    assert len({i for ids in ids_of(apart) for i in ids}) == 2
    tracked = drive(objects, 60)
    assert tracked.joined == 1
    assert ids_of(tracked) == [[0]] * 60
    frames = list(tracked.frames())
    assert [bool(f.observed[0]) for f in frames] == [step not in GAP for step in range(60)]
    for step in GAP:
        assert frames[step].boxes_m[0, 0] == pytest.approx(0.8 * step, abs=0.3)
        assert frames[step].velocities_mps[0] == pytest.approx([8.0, 0.0], abs=0.5)
    deviations = [f.position_sd_m[0] for f in frames]
    assert deviations[30] > 3 * deviations[10]
    assert deviations[30] > deviations[22]
    assert deviations[30] > deviations[37]


def test_after_a_gap_the_filter_has_gone_on_as_if_it_had_never_stopped() -> None:
    """The same detections with a tracker that waits long enough are one track: states equal."""
    objects: list[Object] = [("car", (0.0, 0.0), (8.0, 1.0), without(range(60), GAP))]
    scans = [scan(step, objects, 0.1) for step in range(60)]
    classes = TrackerConfig().classes
    patient = TrackerConfig(
        classes={k: v.model_copy(update={"t_expire_s": 9.0}) for k, v in classes.items()}
    )
    (expected,) = histories(scans, patient)
    config = TrackerConfig()
    pieces = [Piece(history, config) for history in histories(scans, config)]
    assert len(pieces) == 2
    (chain,) = join_tracks(pieces, config, JoinConfig())
    joined = whole_track(chain, np.arange(60) * _STEP_NS, config)
    assert np.array_equal(joined.stamps_ns, expected.stamps_ns)
    assert np.array_equal(joined.observed, expected.observed)
    assert np.abs(joined.states - expected.states).max() < 1e-5
    assert np.abs(joined.covariances - expected.covariances).max() < 1e-5
    assert joined.scores == pytest.approx(expected.scores)


def test_a_piece_is_the_track_up_to_its_last_detection() -> None:
    objects: list[Object] = [("car", (0.0, 0.0), (8.0, 1.0), without(range(60), range(20, 25)))]
    scans = [scan(step, objects, 0.1) for step in range(70)]
    (history,) = histories(scans, TrackerConfig())
    piece = Piece(history, TrackerConfig())
    found = piece.history(TrackerConfig())
    assert (len(found), len(history), piece.detections) == (60, 70, 55)
    for name in ("stamps_ns", "observed", "full"):
        assert np.array_equal(getattr(found, name), getattr(history, name)[:60])
    for name in ("states", "covariances", "measured", "shapes", "class_probabilities"):
        expected = getattr(history, name)[:60]
        assert getattr(found, name) == pytest.approx(expected, abs=1e-5, nan_ok=True)
    assert piece.end.stamp_ns == 59 * _STEP_NS
    assert piece.start.stamp_ns == 0
    assert piece.start.state[3:5] == pytest.approx([-8.0, -1.0], abs=0.5)


def piece_of(stamps_ns: Sequence[int], places: Sequence[float], track_id: int) -> Piece:
    """A standing barrel of which one axis can be told."""
    count = len(stamps_ns)
    states = np.zeros((count, 5))
    states[:, 0] = places
    boxes = np.tile([0.0, 0, 0, 0.6, 0.6, 1.0, 0], (count, 1))
    boxes[:, :3] = states[:, :3]
    beliefs = np.zeros((count, len(TrackerConfig().classes)))
    beliefs[:, list(TrackerConfig().classes).index("barrel")] = 1.0
    history = TrackHistory(
        track_id=track_id,
        motion="velocity",
        stamps_ns=np.array(stamps_ns),
        states=states,
        covariances=np.tile(np.eye(5) * 0.01, (count, 1, 1)),
        observed=np.ones(count, bool),
        shapes=boxes[:, 3:],
        class_probabilities=beliefs,
        full=np.ones(count, bool),
        scores=np.ones(count),
        measured=boxes,
        variances_m2=np.full((count, 3), 0.01),
    )
    return Piece(history, TrackerConfig())


@pytest.mark.parametrize(
    ("apart_ns", "joined"),
    [(0, False), (2_000, False), (900_000, False), (50_000_000, True)],
    ids=["one scan", "two sensors at once", "within a millisecond", "half a scan later"],
)
def test_pieces_that_share_a_moment_are_two_objects(apart_ns: int, *, joined: bool) -> None:
    first = [step * _STEP_NS for step in range(6)]
    second = [first[-1] + apart_ns + step * _STEP_NS for step in range(6)]
    pieces = [piece_of(first, [5.0] * 6, 0), piece_of(second, [5.0] * 6, 1)]
    config = TrackerConfig()
    for order in (pieces, pieces[::-1]):
        chains = join_tracks(order, config, JoinConfig())
        assert len(chains) == (1 if joined else 2)
        scans_ns = np.unique(first + second)
        assert sum(len(whole_track(c, scans_ns, config)) for c in chains) == 12


def test_two_scans_of_one_time_do_not_make_a_gap() -> None:
    """The one sensor sees the end of the first car when the other sees the first of the second."""
    first: Object = ("car", (0.0, 0.0), (0.0, 0.0), range(20))
    second: Object = ("car", (0.0, 0.4), (0.0, 0.0), range(19, 40))
    front = [scan(step, [first], 0.02) for step in range(40)]
    rear = [replace(scan(step, [second], 0.02), sensor="rear") for step in range(40)]
    both = sorted([*front, *rear], key=lambda one: one.stamp_ns)
    tracked = track_drive(both, poses=standing(40))
    assert [f.stamp_ns for f in tracked.frames()] == [step * _STEP_NS for step in range(40)]
    assert tracked.joined == 0


@pytest.mark.parametrize(("detections", "joins"), [(2, 0), (3, 1)])
def test_what_was_hardly_seen_is_not_joined(detections: int, joins: int) -> None:
    first = [step * _STEP_NS for step in range(9)]
    second = [(12 + step) * _STEP_NS for step in range(detections)]
    pieces = [piece_of(first, [5.0] * 9, 0), piece_of(second, [5.0] * detections, 1)]
    for order in (pieces, pieces[::-1]):
        chains = join_tracks(order, TrackerConfig(), JoinConfig())
        assert len(chains) == 2 - joins


def test_ends_and_beginnings_are_paired_so_that_all_fit_best() -> None:
    """Each beginning fits to both ends; only one way leaves nobody alone at the least cost."""
    early, late = (
        list(range(0, 9 * _STEP_NS, _STEP_NS)),
        list(range(12 * _STEP_NS, 20 * _STEP_NS, _STEP_NS)),
    )
    ends = [piece_of(early, [0.0] * 9, 0), piece_of(early, [0.5] * 9, 1)]
    starts = [piece_of(late, [0.3] * 8, 2), piece_of(late, [0.8] * 8, 3)]
    far = [piece_of(early, [90.0] * 9, 4), piece_of(late, [90.1] * 8, 5)]
    chains = join_tracks([*starts, *ends, *far], TrackerConfig(), JoinConfig())
    found = sorted([piece.track_id for piece in chain] for chain in chains)
    assert found == [[0, 2], [1, 3], [4, 5]]


def histories(scans: list[Detections3D], config: TrackerConfig) -> list[TrackHistory]:
    tracker = Tracker(config, poses=standing(len(scans)))
    for one in scans:
        tracker.push(one)
    return tracker.histories()


@pytest.mark.parametrize(
    ("second", "why"),
    [
        (("car", (0.0, 0.0), (8.0, 0.0), range(80, 99)), "too long hidden"),
        (("car", (0.0, 9.0), (8.0, 0.0), range(40, 60)), "beside"),
        (("car", (64.0, 0.0), (-8.0, 0.0), range(40, 60)), "the other way"),
        (("cyclist", (0.0, 0.0), (8.0, 0.0), range(32, 35)), "another class"),
        (("van", (0.0, 0.0), (8.0, 0.0), range(40, 60)), "another size"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_two_objects_stay_two(second: Object, why: str) -> None:
    first: Object = ("car", (0.0, 0.0), (8.0, 0.0), range(20))
    tracked = drive([first, second], 99)
    assert tracked.joined == 0, why
    assert len({i for ids in ids_of(tracked) for i in ids}) == 2


def test_two_that_are_there_at_the_same_time_are_never_joined() -> None:
    first: Object = ("pedestrian", (0.0, 0.0), (1.4, 0.0), range(20))
    second: Object = ("pedestrian", (0.0, 0.4), (1.4, 0.0), range(18, 60))
    assert drive([first, second], 60).joined == 0
    later: Object = ("pedestrian", (0.0, 0.4), (1.4, 0.0), range(20, 60))
    assert len({i for ids in ids_of(drive([first, later], 60)) for i in ids}) == 1


def test_of_two_that_cross_while_hidden_each_finds_itself() -> None:
    objects: list[Object] = [
        ("car", (0.0, 0.0), (8.0, 1.5), without(range(60), GAP)),
        ("car", (0.0, 9.0), (8.0, -1.5), without(range(60), GAP)),
    ]
    tracked = drive(objects, 60)
    assert tracked.joined == 2
    frames = list(tracked.frames())
    for first, second in pairwise(frames):
        assert first.ids.tolist() == second.ids.tolist()
    order = np.argsort(frames[0].boxes_m[:, 1])
    assert frames[-1].boxes_m[order[0], 1] > frames[-1].boxes_m[order[1], 1]


def test_a_chain_of_gaps_is_one_track() -> None:
    hidden = [*range(15, 30), *range(45, 60)]
    objects: list[Object] = [("car", (0.0, 0.0), (5.0, 0.0), without(range(75), hidden))]  # type: ignore[arg-type]
    tracked = drive(objects, 75)
    assert tracked.joined == 2
    assert ids_of(tracked) == [[0]] * 75


def test_the_whole_object_stays_in_place_while_it_comes_into_view() -> None:
    """A standing car that is passed: first its rear is seen, then more and more of its length."""
    count, truth = 40, np.array([20.0, 3.0, 0.8, 4.4, 1.8, 1.5, 0.0])
    scans = []
    for step in range(count):
        seen = truth.copy()
        seen[3] = np.clip(0.8 + 0.2 * step, 0.8, 4.4)
        seen[0] = truth[0] - truth[3] / 2 + seen[3] / 2  # from its rear on
        scans.append(of_boxes(step, seen[None], ("car",)))
    tracked = track_drive(scans, poses=standing(count))
    online = online_frames(scans)
    offline = list(tracked.frames())
    fastest = [max(frame.velocities_mps[0, 0] for frame in one) for one in (online, offline)]
    assert fastest[0] > 0.8
    assert fastest[1] < 0.4 * fastest[0]
    for frame in offline:
        assert frame.boxes_m[0] == pytest.approx(truth, abs=0.35)
    assert offline[0].boxes_m[0, 0] == pytest.approx(20.0, abs=0.3)


def test_seen_from_the_other_side_the_box_is_completed_the_other_way() -> None:
    count, truth = 40, np.array([20.0, 3.0, 0.8, 4.4, 1.8, 1.5, 0.0])
    scans = []
    for step in range(count):
        seen = truth.copy()
        seen[3] = np.clip(0.8 + 0.2 * step, 0.8, 4.4)
        seen[0] = truth[0] + truth[3] / 2 - seen[3] / 2
        scans.append(of_boxes(step, seen[None], ("car",)))
    tracked = track_drive(scans, poses=standing(count, (60.0, 3.0)))
    first = next(tracked.frames())
    assert first.boxes_m[0, 0] == pytest.approx(20.0, abs=0.3)


def test_a_track_is_full_from_its_first_detection_to_its_last() -> None:
    objects: list[Object] = [("car", (0.0, 0.0), (8.0, 0.0), range(5, 20))]
    tracked = drive(objects, 40)
    online = online_frames([scan(step, objects, 0.05) for step in range(40)])
    assert [len(frame) for frame in tracked.frames()] == [0] * 5 + [1] * 15 + [0] * 20
    assert all(frame.states == ("full",) for frame in tracked.frames() if len(frame))
    first_online = next(f for f in online if len(f))
    assert first_online.states == ("trial",)
    first = next(f for f in tracked.frames() if len(f))
    assert np.hypot(*(first.velocities_mps[0] - [8.0, 0.0])) < 0.5
    assert np.hypot(*(first_online.velocities_mps[0] - [8.0, 0.0])) > 5.0


def test_what_was_never_sure_is_left_out_and_counted() -> None:
    objects: list[Object] = [
        ("car", (0.0, 0.0), (8.0, 0.0), range(30)),
        ("pedestrian", (10.0, 40.0), (0.0, 0.0), range(12, 13)),
    ]
    tracked = drive(objects, 30)
    assert all(len(frame) == 1 for frame in tracked.frames())
    assert tracked.dropped["tracks that never became full"] == 1


def equal(first: Tracks, second: Tracks) -> bool:
    columns = ("ids", "boxes_m", "velocities_mps", "label_probabilities", "position_sd_m")
    same = all(np.array_equal(getattr(first, n), getattr(second, n)) for n in columns)
    return same and first.stamp_ns == second.stamp_ns and first.labels == second.labels


def test_the_order_of_arrival_changes_nothing() -> None:
    objects: list[Object] = [
        ("car", (0.0, 0.0), (8.0, 0.0), range(30)),
        ("pedestrian", (10.0, 9.0), (0.0, 1.0), range(3, 28)),
    ]
    scans = [scan(step, objects, 0.1) for step in range(30)]
    # Within the second that the tracker waits for what is late.
    mixed = [
        scans[i] for i in np.argsort(np.arange(30) + np.random.default_rng(0).uniform(0, 8, 30))
    ]
    assert [one.stamp_ns for one in mixed] != [one.stamp_ns for one in scans]
    ordered = track_drive(scans, poses=standing(30))
    shuffled = track_drive(mixed, poses=standing(30))
    for first, second in zip(ordered.frames(), shuffled.frames(), strict=True):
        assert equal(first, second)


def test_what_comes_later_than_the_tracker_waits_is_counted() -> None:
    objects: list[Object] = [("car", (0.0, 0.0), (8.0, 0.0), range(40))]
    scans = [scan(step, objects) for step in range(40)]
    tracked = track_drive([*scans[:3], *scans[4:], scans[3]], poses=standing(40))
    assert tracked.dropped["measurements later than the rollback window"] == 1
    assert ids_of(tracked) == [[0]] * 40


def online_frames(scans: list[Detections3D]) -> list[Tracks]:
    """What the vehicle knew right after each scan."""
    tracker, frames = Tracker(poses=standing(len(scans))), []
    for one in scans:
        tracker.push(one)
        frames.append(tracker.tracks(one.stamp_ns))
    return frames


def test_between_scans_tracks_are_interpolated_and_outside_there_are_none() -> None:
    tracked = drive([("car", (0.0, 0.0), (8.0, 0.0), range(30))], 30, noise_m=0.0)
    before, after = tracked.at(10 * _STEP_NS), tracked.at(11 * _STEP_NS)
    middle = tracked.at(10 * _STEP_NS + _STEP_NS // 4)
    assert before.observed.tolist() == [True]
    assert middle.observed.tolist() == [False]
    expected = 0.75 * before.boxes_m[0, 0] + 0.25 * after.boxes_m[0, 0]
    assert middle.boxes_m[0, 0] == pytest.approx(expected, abs=0.01)
    assert middle.stamp_ns == 10 * _STEP_NS + _STEP_NS // 4
    assert len(tracked.at(-1)) == 0
    assert len(tracked.at(29 * _STEP_NS)) == 1
    assert len(tracked.at(29 * _STEP_NS + 1)) == 0


def test_braking_is_interpolated_along_the_velocities() -> None:
    """Scans half a second apart: a straight line would be off by a t^2 / 8 = 6 cm."""
    steps = np.arange(0, 60, 5)
    scans = [
        of_boxes(
            int(s),
            np.array([[8 * s / 10 - (s / 10) ** 2, 0, 0.8, 4.4, 1.8, 1.5, 0]]),
            ("car",),
        )
        for s in steps
    ]
    classes = TrackerConfig().classes
    slow = classes["car"].model_copy(update={"t_prune_s": 1.0})
    config = TrackerConfig(classes={**classes, "car": slow})
    tracked = track_drive(scans, config, poses=standing(60))
    time_s = 2.25
    found = tracked.at(round(time_s * 1e9)).boxes_m[0, 0]
    ends = [tracked.at(round(t * 1e9)).boxes_m[0, 0] for t in (2.0, 2.5)]
    assert found - np.mean(ends) == pytest.approx(2 * 0.25**2 / 2, abs=0.02)


def test_yaws_are_interpolated_over_the_turn_of_the_circle() -> None:
    yaws = 3.0 + 0.01 * np.arange(30)
    places = np.cumsum(0.8 * np.column_stack([np.cos(yaws), np.sin(yaws)]), axis=0)
    scans = [
        of_boxes(s, np.array([[*places[s], 0.8, 4.4, 1.8, 1.5, yaws[s]]]), ("car",))
        for s in range(30)
    ]
    tracked = track_drive(scans, poses=standing(30))
    found = [tracked.at(t).boxes_m[0, 6] for t in range(0, 29 * _STEP_NS, _STEP_NS // 4)]
    assert min(found) < -3.0
    assert max(found) > 3.0
    assert np.max(np.cos(found)) < -0.98


def test_two_scans_at_one_time_are_one_frame() -> None:
    objects: list[Object] = [("car", (0.0, 0.0), (8.0, 0.0), range(20))]
    front = [scan(step, objects, 0.05) for step in range(20)]
    other = [of_boxes(step, np.zeros((0, 7)), ()) for step in range(20)]
    tracked = track_drive([*front, *other], poses=standing(20))
    frames = list(tracked.frames())
    assert [f.stamp_ns for f in frames] == [step * _STEP_NS for step in range(20)]
    assert all(f.observed.tolist() == [True] for f in frames)


def test_one_label_for_the_whole_track() -> None:
    labels = ["unknown"] * 6 + ["car"] * 10 + ["truck"] * 2
    box = np.array([[5.0, 3.0, 0.8, 4.4, 1.8, 1.5, 0.0]])
    scans = [of_boxes(step, box, (label,)) for step, label in enumerate(labels)]
    tracked = track_drive(scans, poses=standing(18))
    assert {frame.labels for frame in tracked.frames()} == {("car",)}
    (probability,) = {float(frame.label_probabilities[0]) for frame in tracked.frames()}
    assert probability > 0.6


@pytest.mark.parametrize(("known", "label"), [(12, "truck"), (1, "unknown")])
def test_what_was_known_for_a_while_is_not_unknown(known: int, label: str) -> None:
    labels = ["unknown"] * 18 + ["truck"] * known + ["unknown"] * 6
    box = np.array([[5.0, 3.0, 0.8, 8.0, 2.5, 3.0, 0.0]])
    scans = [of_boxes(step, box, (one,)) for step, one in enumerate(labels)]
    tracked = track_drive(scans, poses=standing(len(scans)))
    assert {frame.labels for frame in tracked.frames()} == {(label,)}


def test_nothing_and_only_images() -> None:
    empty = track_drive([])
    assert list(empty.frames()) == []
    assert len(empty.at(0)) == 0
    image = Detections2D(0, "front", np.zeros((0, 4)), (), np.zeros(0))
    only = track_drive([image])
    assert list(only.frames()) == []
    assert sum(only.dropped.values()) == 1


def test_without_poses_a_reader_is_told() -> None:
    scans = [scan(step, [("car", (9.0, 0.0), (0.0, 0.0), range(9))]) for step in range(9)]
    assert track_drive(scans, poses=standing(9)).notes == ()
    (note,) = track_drive(scans).notes
    assert "relative" in note
