"""Hindsight on one track, against answers that were found in another way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from percept.core.results import Detections3D
from percept.core.trajectory import Trajectory
from percept.tracking.class_model import ClassModel
from percept.tracking.config import AssociationWeights, ClassSettings, TrackerConfig
from percept.tracking.history import TrackHistory
from percept.tracking.refilter import part_of
from percept.tracking.smooth import predict_steps, smooth_states, smooth_track
from percept.tracking.smooth_shapes import facing_sizes
from percept.tracking.tracker import Tracker

F64 = NDArray[np.float64]

_STEP_NS = 100_000_000
_SETTINGS = ClassSettings(
    motion="velocity",
    velocity_walk_mps=1.2,
    height_walk_m=0.2,
    birth_speed_mps=4.0,
    position_sd_m=0.2,
    position_sd_per_m=0.0,
    height_sd_m=0.15,
    gate_m=1000.0,
    t_birth_s=0.0,
    t_expire_s=100.0,
)
_TURN = _SETTINGS.model_copy(
    update={"motion": "turn", "turn_walk_radps": 0.1, "birth_turn_radps": 0.05}
)


def config_of(settings: ClassSettings) -> TrackerConfig:
    weights = AssociationWeights(gate_sigma=20.0)
    return TrackerConfig(classes={"car": settings}, confusions={}, weights=weights)


def still_poses(count: int) -> Trajectory:
    stamps = np.array([0, count * _STEP_NS])
    return Trajectory("map", "base_link", stamps, np.tile(np.eye(4), (2, 1, 1)))


def simulated(
    rng: np.random.Generator, settings: ClassSettings, objects: int, steps: int
) -> tuple[F64, list[Detections3D]]:
    """Motion and measurements that are what the settings say: (steps, objects, 6) and scans."""
    dt_s = _STEP_NS / 1e9
    state = np.zeros((objects, 6))
    state[:, 0] = 3000.0 * np.arange(objects)
    state[:, 3:5] = rng.normal(0, settings.birth_speed_mps, (objects, 2))
    turns = settings.motion == "turn"
    state[:, 5] = rng.normal(0, settings.birth_turn_radps, objects) * turns
    truth, scans = [], []
    for step in range(steps):
        if step:
            fine = 20  # white acceleration in small pieces, not the model's own formula
            for _ in range(fine):
                h = dt_s / fine
                state[:, :2] += h * state[:, 3:5]
                state[:, 2] += rng.normal(0, settings.height_walk_m * np.sqrt(h), objects)
                angle = h * state[:, 5]
                vx, vy = state[:, 3].copy(), state[:, 4].copy()
                state[:, 3] = np.cos(angle) * vx - np.sin(angle) * vy
                state[:, 4] = np.sin(angle) * vx + np.cos(angle) * vy
                state[:, 3:5] += rng.normal(
                    0, settings.velocity_walk_mps * np.sqrt(h), (objects, 2)
                )
                state[:, 5] += turns * rng.normal(0, settings.turn_walk_radps * np.sqrt(h), objects)
        truth.append(state.copy())
        boxes = np.zeros((objects, 7))
        boxes[:, :2] = state[:, :2] + rng.normal(0, settings.position_sd_m, (objects, 2))
        boxes[:, 2] = state[:, 2] + rng.normal(0, settings.height_sd_m, objects)
        boxes[:, 3:6] = [4.0, 2.0, 1.5]
        scans.append(scan_of(step, boxes))
    return np.array(truth), scans


def scan_of(step: int, boxes: F64) -> Detections3D:
    return Detections3D(
        stamp_ns=step * _STEP_NS,
        sensor="lidar",
        frame_id="map",
        boxes_m=boxes,
        labels=("car",) * len(boxes),
        confidences=np.full(len(boxes), 0.9),
    )


def tracked(scans: list[Detections3D], settings: ClassSettings) -> list[TrackHistory]:
    tracker = Tracker(config_of(settings), poses=still_poses(len(scans)))
    for scan in scans:
        tracker.push(scan)
    return tracker.histories()


def batch_solution(history: TrackHistory, centres: F64, settings: ClassSettings) -> F64:
    """States (K, 5) by one least-squares problem over all moments, not recursively."""
    count, dt = len(history), _STEP_NS / 1e9
    step = np.eye(5)
    step[0, 3] = step[1, 4] = dt
    walk = settings.velocity_walk_mps**2
    noise = np.diag([dt**3 / 3 * walk] * 2 + [settings.height_walk_m**2 * dt] + [dt * walk] * 2)
    for a, b in ((0, 3), (1, 4)):
        noise[a, b] = noise[b, a] = dt**2 / 2 * walk
    whiten = np.linalg.inv(np.linalg.cholesky(noise))
    position_sd = [settings.position_sd_m] * 2 + [settings.height_sd_m]
    rows, values = [], []

    def add(block: dict[int, NDArray[np.floating]], value: F64) -> None:
        row = np.zeros((len(value), 5 * count))
        for index, part in block.items():
            row[:, 5 * index : 5 * index + 5] = part
        rows.append(row)
        values.append(value)

    for index in range(count):
        if history.observed[index]:
            add(
                {index: np.eye(3, 5) / np.array(position_sd)[:, None]}, centres[index] / position_sd
            )
        if index:
            add({index - 1: -whiten @ step, index: whiten}, np.zeros(5))
    add({0: np.eye(5)[3:] / settings.birth_speed_mps}, np.zeros(2))
    found = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=None)[0]
    return np.asarray(found.reshape(count, 5))


def test_the_smoother_is_the_least_squares_solution_over_the_whole_track() -> None:
    _, scans = simulated(np.random.default_rng(1), _SETTINGS, 1, 40)
    scans[12:17] = [scan_of(step, np.zeros((0, 7))) for step in range(12, 17)]
    (history,) = tracked(scans, _SETTINGS)
    assert history.observed.sum() == 35
    centres = np.array([s.boxes_m[0, :3] if len(s) else np.full(3, np.nan) for s in scans])
    expected = batch_solution(history, centres, _SETTINGS)
    states, _ = smooth_states(history, config_of(_SETTINGS))
    assert np.abs(states - expected).max() < 1e-8
    assert np.abs(history.states - expected).max() > 0.1


def test_the_last_state_keeps_what_the_filter_knew() -> None:
    _, scans = simulated(np.random.default_rng(2), _TURN, 1, 20)
    (history,) = tracked(scans, _TURN)
    states, covariances = smooth_states(history, config_of(_TURN))
    assert np.array_equal(states[-1], history.states[-1])
    smaller = history.covariances - covariances
    assert np.linalg.eigvalsh(smaller).min() > -1e-9
    assert np.trace(covariances[0]) < 0.2 * np.trace(history.covariances[0])


@pytest.mark.parametrize("settings", [_SETTINGS, _TURN], ids=lambda s: s.motion)
def test_normalised_errors_stay_inside_their_bounds(settings: ClassSettings) -> None:
    """NEES of filter and smoother, NIS of the filter (Bar-Shalom 2001, section 5.4)."""
    objects, steps = 60, 40
    truth, scans = simulated(np.random.default_rng(3), settings, objects, steps)
    histories = tracked(scans, settings)
    assert len(histories) == objects
    config = config_of(settings)
    filtered, smoothed, innovations = [], [], []
    for number, history in enumerate(histories):
        assert history.observed.all()
        exact = truth[:, number, : history.states.shape[1]]
        filtered.append(normalised(exact - history.states, history.covariances))
        states, covariances = smooth_states(history, config)
        smoothed.append(normalised(exact - states, covariances))
        centres, variances = history.measured[:, :3], history.variances_m2
        means, spreads, _ = predict_steps(history, config)
        total = spreads[:, :3, :3] + variances[1:, :, None] * np.eye(3)
        innovations.append(normalised(centres[1:] - means[:, :3], total))
    size = histories[0].states.shape[1]
    for errors, degrees in ((filtered, size), (smoothed, size), (innovations, 3)):
        means = np.mean(errors, axis=0)
        low, high = chi2.ppf([0.025, 0.975], degrees * objects) / objects
        # Errors of one object last for a while, so that the steps are far from independent.
        assert np.mean((means >= low) & (means <= high)) > 0.85
        assert low < means.mean() < high


def normalised(errors: F64, covariances: F64) -> F64:
    solved = np.linalg.solve(covariances, errors[:, :, None])[:, :, 0]
    return np.asarray((errors * solved).sum(axis=1))


def still_history(shapes: F64, *, speed: float = 0.0) -> TrackHistory:
    """A track along +x that the tracker is sure of, with the shapes that were seen."""
    count = len(shapes)
    states = np.zeros((count, 5))
    states[:, 0] = speed * 0.1 * np.arange(count)
    states[:, 3] = speed
    return TrackHistory(
        track_id=1,
        motion="velocity",
        stamps_ns=np.arange(count) * _STEP_NS,
        states=states,
        covariances=np.tile(np.eye(5) * 1e-4, (count, 1, 1)),
        observed=np.ones(count, bool),
        shapes=shapes,
        class_probabilities=np.ones((count, 1)),
        full=np.ones(count, bool),
    )


def shapes_of(*rows: tuple[float, float, float, float], times: int = 1) -> F64:
    return np.array(rows * times)


def shape_of(history: TrackHistory, *, still_frame: bool = True) -> F64:
    return smooth_track(history, config_of(_SETTINGS), still_frame=still_frame).shapes


def test_a_size_is_one_for_the_whole_track_and_that_of_the_better_views() -> None:
    part, most = (1.8, 0.4, 1.2, 0.0), (4.4, 1.8, 1.5, 0.0)
    found = shape_of(still_history(np.vstack([shapes_of(part, times=6), shapes_of(most, times=6)])))
    assert np.ptp(found[:, :3], axis=0).max() == 0
    assert found[0, :3] == pytest.approx([4.4, 1.8, 1.5])


def test_where_views_differ_in_size_the_place_is_less_sure() -> None:
    """Half of a car's length is missing in half of the views: sqrt(1/2) 2.2 m / 2 along it."""
    part, most = (2.2, 1.8, 1.5, np.pi / 2), (4.4, 1.8, 1.5, np.pi / 2)
    same = smooth_track(still_history(shapes_of(most, times=12)), config_of(_SETTINGS))
    history = still_history(shapes_of(part, most, times=6))
    differ = smooth_track(history, config_of(_SETTINGS))
    added = differ.covariances - same.covariances
    assert np.sqrt(added[:, 1, 1]) == pytest.approx(np.full(12, 1.1 * np.sqrt(0.5)), abs=1e-3)
    added[:, 1, 1] = 0.0
    assert np.abs(added).max() < 1e-9


def test_yaws_near_the_turn_of_the_circle_are_averaged_as_angles() -> None:
    near_pi = shapes_of((4.0, 2.0, 1.5, 3.1), (4.0, 2.0, 1.5, -3.1), times=10)
    found = shape_of(still_history(near_pi))[:, 3]
    assert np.abs(np.cos(found) + 1).max() < 1e-4


def test_the_front_of_a_box_is_decided_by_most_of_the_track() -> None:
    yaws = np.full(20, 0.3)
    yaws[[3, 8]] += np.pi
    shapes = np.column_stack([np.tile([4.0, 2.0, 1.5], (20, 1)), yaws])
    assert shape_of(still_history(shapes))[:, 3] == pytest.approx(np.full(20, 0.3))


def test_what_moves_points_where_it_goes_and_its_sides_are_named_by_that() -> None:
    rear_only = shapes_of((1.8, 0.4, 1.4, np.pi / 2), times=20)
    found = shape_of(still_history(rear_only, speed=8.0))
    assert np.abs(found[:, 3]).max() < 0.02
    assert found[0, :2] == pytest.approx([0.4, 1.8])
    relative = shape_of(still_history(rear_only, speed=8.0), still_frame=False)
    assert np.abs(np.sin(relative[:, 3])) == pytest.approx(np.ones(20))
    assert relative[0, :2] == pytest.approx([1.8, 0.4])


def test_sides_change_their_names_with_a_quarter_turn_only() -> None:
    shapes = shapes_of((4.0, 2.0, 1.5, 0.0), times=3)
    sizes = facing_sizes(shapes, np.array([0.7, np.pi / 2, np.pi]))
    assert sizes.tolist() == [[4.0, 2.0, 1.5], [2.0, 4.0, 1.5], [4.0, 2.0, 1.5]]


def test_classes_are_those_of_the_forward_backward_algorithm() -> None:
    classes = ("car", "truck", "pedestrian")
    config = TrackerConfig(
        classes=dict.fromkeys(classes, _SETTINGS), confusions={}, class_change_per_s=0.8
    )
    model = ClassModel(config)
    evidence = np.random.default_rng(5).uniform(0.05, 1.0, (12, 3))
    transition = model.faded(np.eye(3), 0.1)
    forward = [model.prior() * evidence[0]]
    for row in evidence[1:]:
        forward.append(row * (transition @ forward[-1]))
    backward = [np.ones(3)]
    for row in evidence[:0:-1]:
        backward.insert(0, transition.T @ (row * backward[0]))
    expected = np.array(forward) * backward
    expected /= expected.sum(axis=1, keepdims=True)
    beliefs = np.array(forward) / np.sum(forward, axis=1, keepdims=True)
    history = replace(
        still_history(shapes_of((4.0, 2.0, 1.5, 0.0), times=12)), class_probabilities=beliefs
    )
    found = smooth_track(history, config).class_probabilities
    assert np.abs(found - expected).max() < 1e-12


def test_a_part_has_all_columns() -> None:
    part = part_of(still_history(shapes_of((4.0, 2.0, 1.5, 0.0), times=9)), 2, 5)
    assert len(part) == len(part.scores) == len(part.covariances) == len(part.full) == 3
    assert part.stamps_ns[0] == 2 * _STEP_NS
