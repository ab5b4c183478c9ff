"""The filters say how wrong they are: normalised errors against known motion, many times."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from percept.core.results import Detections3D
from percept.core.trajectory import Trajectory
from percept.tracking import Tracker, TrackerConfig
from percept.tracking.config import ClassSettings
from percept.tracking.filter import update_positions
from percept.tracking.motion import predict_turns

_F64 = NDArray[np.float64]

_RUNS = 400
_STEPS = 60
_DT_S = 0.1
_WALKS = np.array([1.5, 0.3, 0.15])
_SD = np.array([0.3, 0.3, 0.2])
_BIRTH_SD = np.array([8.0, 8.0, 0.2])


def _moved(states: _F64, turns: bool, rng: np.random.Generator) -> _F64:  # noqa: FBT001
    """Move objects through one step in which white noise accelerates them, in ten short ones."""
    walks = _WALKS * [1, 1, turns]
    short = _DT_S / 10
    for _ in range(10):
        count = len(states)
        states, _, _ = predict_turns(
            states, np.zeros((count, 6, 6)), np.full(count, short), np.zeros((count, 3))
        )
        states[:, 3:5] += rng.normal(0, walks[0] * np.sqrt(short), (count, 2))
        states[:, 2] += rng.normal(0, walks[1] * np.sqrt(short), count)
        states[:, 5] += rng.normal(0, walks[2] * np.sqrt(short) + 1e-300, count)
    return states


def _still() -> Trajectory:
    return Trajectory("map", "base", np.array([0, 10**12]), np.tile(np.eye(4), (2, 1, 1)))


def _normalised(errors: _F64, covariances: _F64) -> _F64:
    solved = np.linalg.solve(covariances, errors[..., None])[..., 0]
    normalised: _F64 = np.einsum("ni,ni->n", errors, solved)
    return normalised


def _errors_of_filter(turns: bool, seed: int) -> _F64:  # noqa: FBT001
    """Return the (steps, runs) normalised errors of all numbers of the state."""
    rng = np.random.default_rng(seed)
    truth = np.zeros((_RUNS, 6))
    truth[:, 3:] = rng.normal(0, _BIRTH_SD * [1, 1, turns], (_RUNS, 3))
    states, covariances = np.zeros((_RUNS, 6)), np.zeros((_RUNS, 6, 6))
    states[:, :3] = truth[:, :3] + rng.normal(0, _SD, (_RUNS, 3))
    covariances[:] = np.diag(np.append(_SD, _BIRTH_SD * [1, 1, turns]) ** 2)
    size = 6 if turns else 5
    walks = np.tile(_WALKS * [1, 1, turns], (_RUNS, 1))
    variances = np.tile(_SD**2, (_RUNS, 1))
    normalised = []
    for step in range(_STEPS):
        truth = _moved(truth, turns, rng)
        states, covariances, _ = predict_turns(states, covariances, np.full(_RUNS, _DT_S), walks)
        if step % 7 != 3:  # sometimes an object is not seen
            measured = truth[:, :3] + rng.normal(0, _SD, (_RUNS, 3))
            states, covariances = update_positions(states, covariances, measured, variances)
        errors = (states - truth)[:, :size]
        normalised.append(_normalised(errors, covariances[:, :size, :size]))
    return np.array(normalised)


@pytest.mark.parametrize("turns", [False, True])
def test_errors_of_the_filters_are_inside_their_95_percent_bounds(turns: bool) -> None:  # noqa: FBT001
    normalised = _errors_of_filter(turns, seed=7)
    size = 6 if turns else 5
    inside = (normalised < chi2.ppf(0.95, size)).mean()
    assert 0.935 < inside < 0.965
    # The mean over the runs of each step, against the bounds of its own distribution.
    low, high = chi2.ppf([0.025, 0.975], _RUNS * size) / _RUNS
    means = normalised.mean(axis=1)
    # Errors of one run last for a while, so that the steps are far from independent.
    assert ((low < means) & (means < high)).mean() > 0.8


@pytest.mark.parametrize("motion", ["velocity", "turn"])
def test_errors_of_tracks_are_inside_their_95_percent_bounds(motion: str) -> None:
    """The same through the tracker, with association: a hundred objects far from each other."""
    rng = np.random.default_rng(11)
    turns = motion == "turn"
    settings = ClassSettings(
        motion="turn" if turns else "velocity",
        velocity_walk_mps=_WALKS[0], height_walk_m=_WALKS[1], turn_walk_radps=_WALKS[2],
        birth_speed_mps=_BIRTH_SD[0], birth_turn_radps=_BIRTH_SD[2], position_sd_m=_SD[0],
        position_sd_per_m=0.0, height_sd_m=_SD[2], gate_m=20.0,
    )  # fmt: skip
    config = TrackerConfig(classes={"car": settings}, confusions={}, vehicle_walk_mps=0.0)
    config = config.model_copy(
        update={"weights": config.weights.model_copy(update={"gate_sigma": 10.0, "miss": 9.0})}
    )
    count = 100
    truth = np.zeros((count, 6))
    truth[:, :2] = np.stack(np.divmod(np.arange(count), 10), axis=1) * 200.0
    truth[:, 3:] = rng.normal(0, _BIRTH_SD * [1, 1, turns], (count, 3))
    tracker = Tracker(config, poses=_still())
    position, velocity = [], []
    for step in range(30):
        truth = _moved(truth, turns, rng) if step else truth
        stamp_ns = round(step * _DT_S * 1e9)
        boxes = np.tile([0.0, 0, 0, 4, 2, 1.5, 0], (count, 1))
        boxes[:, :3] = truth[:, :3] + rng.normal(0, _SD, (count, 3))
        tracker.push(Detections3D(stamp_ns, "top", "map", boxes, ("car",) * count, np.ones(count)))
        tracks = tracker.tracks(stamp_ns)
        assert tracks.ids.tolist() == list(range(count))
    for history in tracker.histories():
        errors = history.states[-1] - truth[history.track_id, : history.states.shape[1]]
        spread = history.covariances[-1]
        position.append(errors[:2] @ np.linalg.solve(spread[:2, :2], errors[:2]))
        velocity.append(errors[3:5] @ np.linalg.solve(spread[3:5, 3:5], errors[3:5]))
    low, high = chi2.ppf([0.025, 0.975], 2 * count) / count
    assert low < np.mean(position) < high
    assert low < np.mean(velocity) < high
