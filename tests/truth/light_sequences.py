"""Simulated lights as a flawed detector sees them, from another model than the tracker's.

Phases last fixed times and not exponential ones; errors come one by one, in runs, in bursts of
glare, and from lamps that beat with the shutter; lights hide behind lorries. All lights of a set
stand on a grid in the images of one camera, far enough apart that none is taken for another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections2D
from percept.datasets.synthetic.signals import draw_plan
from percept.lights import LightConfig, LightTracker

__all__ = [
    "DetectorErrors", "LightTruth", "Readings", "Said", "draw_cycles", "draw_flashes",
    "draw_outages", "flash_delays", "hard_errors", "plain_errors", "read_lights",
    "red_as_green", "track_readings",
]  # fmt: skip

RED, YELLOW, GREEN, DARK, NOT_SEEN = range(5)
_LABELS = ("light_red", "light_yellow", "light_green", "light_off")
_STATES = {"red": RED, "yellow": YELLOW, "green": GREEN, "dark": DARK, "unknown": NOT_SEEN}
_WRONG = np.array(
    [
        [0.00, 0.37, 0.03, 0.60],  # a red lamp: mostly missed, or yellow, rarely green
        [0.45, 0.00, 0.10, 0.45],
        [0.05, 0.20, 0.00, 0.75],
        [0.45, 0.15, 0.40, 0.00],
    ]
)


@dataclass(frozen=True)
class LightTruth:
    """L lights at F times: (L, F) what each means, whether it flashes, whether its lamp shines.

    `period_s` (L,) is that of a flash, NaN without.
    """

    times_s: NDArray[np.float64]
    colours: NDArray[np.int64]
    flashing: NDArray[np.bool_]
    lit: NDArray[np.bool_]
    period_s: NDArray[np.float64]


def _times(rate_hz: float, seconds: float) -> NDArray[np.float64]:
    return np.arange(round(rate_hz * seconds)) / rate_hz


def draw_cycles(
    count: int, rate_hz: float, rng: np.random.Generator, seconds: float = 20.0
) -> LightTruth:
    """Draw lights of the synthetic world that go through green, yellow and red."""
    times = _times(rate_hz, seconds)
    plans = [draw_plan(rng, 0 if light % 4 == 0 else 2) for light in range(count)]
    colours = np.array([[_STATES[plan.at(time).colour] for time in times] for plan in plans])
    none = np.zeros(colours.shape, bool)
    return LightTruth(times, colours, none, ~none, np.full(count, np.nan))


def draw_flashes(
    count: int, rate_hz: float, rng: np.random.Generator, seconds: float = 20.0
) -> LightTruth:
    """Draw flashes of the whole range of the MUTCD: 1.0 to 1.2 s, lit for 1/2 to 2/3 of it."""
    times = _times(rate_hz, seconds)
    period, share = rng.uniform(1.0, 1.2, (count, 1)), rng.uniform(1 / 2, 2 / 3, (count, 1))
    phase = (times / period + rng.uniform(0, 1, (count, 1))) % 1.0
    colours = np.tile(rng.integers(RED, GREEN, (count, 1)), (1, len(times)))
    return LightTruth(times, colours, np.ones(colours.shape, bool), phase < share, period[:, 0])


def draw_outages(
    count: int, rate_hz: float, rng: np.random.Generator, seconds: float = 20.0
) -> LightTruth:
    """Draw lights that are red or green for a while and then go out for good."""
    times = _times(rate_hz, seconds)
    out = times[None] >= rng.uniform(2, 10, (count, 1))
    colours = np.where(out, DARK, rng.choice([RED, GREEN], (count, 1)))
    return LightTruth(times, colours, np.zeros(out.shape, bool), ~out, np.full(count, np.nan))


@dataclass(frozen=True)
class DetectorErrors:
    """How the detector fails.

    Attributes:
        accuracy: Share of the images in which a lamp is read right, glare and beats aside.
        repeat: Chance that an error is made again 0.1 s later.
        drop: Share of the images in which the box is missing.
        occlusion_s: Mean time between occlusions of 0.3 to 3 s.
        glare_s: Mean time between bursts of glare, 0.4 s long in the mean, in which a lamp is
            missed every second time and else read at random.
        beating: Share of lights whose pulses beat with the shutter at 0.1 to 5 Hz, so that the
            lamp looks dark for an eighth of a beat.
    """

    accuracy: float
    repeat: float = 0.0
    drop: float = 0.05
    occlusion_s: float = np.inf
    glare_s: float = np.inf
    beating: float = 0.0


def plain_errors(accuracy: float) -> DetectorErrors:
    """Return errors that come one by one, and missing boxes."""
    return DetectorErrors(accuracy)


def hard_errors(accuracy: float) -> DetectorErrors:
    """Return errors of all kinds."""
    return DetectorErrors(accuracy, 0.4, 0.05, 15.0, 20.0, 0.15)


@dataclass(frozen=True)
class Readings:
    """(L, F) what the detector says of each light, `NOT_SEEN` without a box, and how sure."""

    codes: NDArray[np.int64]
    confidences: NDArray[np.float64]


def read_lights(truth: LightTruth, errors: DetectorErrors, rng: np.random.Generator) -> Readings:
    """Return what a detector makes of the lights."""
    shape = truth.colours.shape
    step_s = float(truth.times_s[1] - truth.times_s[0])
    right = np.where(truth.lit & ~_beats(truth, errors.beating, rng), truth.colours, DARK)
    codes = _with_runs(right, errors, step_s, rng)
    glare = _spells(shape, errors.glare_s, lambda: rng.exponential(0.4), step_s, rng)
    missed = rng.random(shape) < 0.5
    codes = np.where(glare, np.where(missed, DARK, rng.integers(0, 4, shape)), codes)
    hidden = _spells(shape, errors.occlusion_s, lambda: rng.uniform(0.3, 3), step_s, rng)
    unseen = hidden | (rng.random(shape) < errors.drop)
    high = np.where(glare, 0.5, np.where(codes == right, 0.97, 0.9))
    confidences = rng.uniform(np.where(glare, 0.2, 0.4), high)
    return Readings(np.where(unseen, NOT_SEEN, codes), confidences)


def _beats(truth: LightTruth, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    lights = len(truth.colours)
    beat_hz = np.exp(rng.uniform(np.log(0.1), np.log(5), (lights, 1)))
    phase = (truth.times_s * beat_hz + rng.uniform(0, 1, (lights, 1))) % 1
    beating: NDArray[np.bool_] = (phase < 1 / 8) & (rng.random((lights, 1)) < share)
    return beating


def _with_runs(
    right: NDArray[np.int64], errors: DetectorErrors, step_s: float, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Return the readings with errors that are made again with the chance `repeat`."""
    again = errors.repeat ** (step_s / 0.1) if errors.repeat else 0.0
    begin = (1 - errors.accuracy) * (1 - again) / errors.accuracy
    codes = right.copy()
    wrong = np.full(len(right), -1)
    for frame in range(right.shape[1]):
        draw = rng.random(len(right))
        drawn = (rng.random((len(right), 1)) > _WRONG.cumsum(axis=1)[right[:, frame]]).sum(axis=1)
        going_on = (wrong >= 0) & (draw < again)
        starting = ~going_on & (draw > 1 - begin)
        wrong = np.where(going_on, wrong, np.where(starting, np.minimum(drawn, 3), -1))
        codes[:, frame] = np.where(wrong >= 0, wrong, right[:, frame])
    return codes


def _spells(
    shape: tuple[int, ...],
    every_s: float,
    length_s: Callable[[], float],
    step_s: float,
    rng: np.random.Generator,
) -> NDArray[np.bool_]:
    inside = np.zeros(shape, bool)
    for light, frame in np.argwhere(rng.random(shape) < step_s / every_s):
        inside[light, frame : frame + max(1, round(length_s() / step_s))] = True
    return inside


@dataclass(frozen=True)
class Said:
    """(L, F) what the tracker said at the time of each image: codes, and whether it flashes."""

    codes: NDArray[np.int64]
    flashing: NDArray[np.bool_]


def track_readings(
    truth: LightTruth, readings: Readings, config: LightConfig, *, smoothed: bool = False
) -> Said:
    """Run trackers on boxes, and bring their answers back to the lights by where they stand."""
    parts = [
        _track_some(truth.times_s, readings, rows, config, smoothed=smoothed)
        for rows in np.array_split(np.arange(len(readings.codes)), -(-len(readings.codes) // 50))
    ]
    return Said(
        np.concatenate([part.codes for part in parts]),
        np.concatenate([part.flashing for part in parts]),
    )


def _track_some(
    times_s: NDArray[np.float64],
    readings: Readings,
    lights: NDArray[np.int64],
    config: LightConfig,
    *,
    smoothed: bool,
) -> Said:
    tracker = LightTracker(config)
    codes, sure = readings.codes[lights], readings.confidences[lights]
    corners = np.stack(np.unravel_index(np.arange(len(lights)), (10, 5)), axis=1)
    boxes = np.hstack([corners, corners]) * 200.0 + [0.0, 0.0, 10.0, 25.0]
    stamps = np.round(times_s * 1e9).astype(np.int64).tolist()
    said = Said(np.full(codes.shape, NOT_SEEN), np.zeros(codes.shape, bool))
    owner: dict[int, int] = {}
    online = []
    for frame, stamp in enumerate(stamps):
        rows = np.flatnonzero(codes[:, frame] != NOT_SEEN)
        labels = tuple(_LABELS[code] for code in codes[rows, frame])
        tracker.push(Detections2D(stamp, "front", boxes[rows], labels, sure[rows, frame]))
        owner |= dict(zip(tracker._steps[-1].sightings.ids.tolist(), rows.tolist(), strict=True))
        online.append(tracker.lights(stamp))
    frames = {stamp: frame for frame, stamp in enumerate(stamps)}
    for states in tracker.history(smoothed=True) if smoothed else online:
        rows = np.array([owner[light] for light in states.ids.tolist()], dtype=int)
        frame = frames[states.stamp_ns]
        said.codes[rows, frame] = [_STATES[state] for state in states.states]
        said.flashing[rows, frame] = states.flashing
    return said


def flash_delays(truth: LightTruth, readings: Readings, said: Said) -> NDArray[np.float64]:
    """Return (L,) the time from the first box of a light until it is first called flashing.

    Less its `period_s` it is the delay after one full cycle was in view, which no method that
    asks for a full cycle can undercut; inf where it is never found.
    """
    first_box = (readings.codes != NOT_SEEN).argmax(axis=1)
    found = said.flashing.argmax(axis=1)
    delays: NDArray[np.float64] = truth.times_s[found] - truth.times_s[first_box]
    return np.where(said.flashing.any(axis=1), delays, np.inf)


def red_as_green(truth: LightTruth, said: Said) -> int:
    """Return how many lights were said to be green while they were red, flashing or not."""
    return int(((truth.colours == RED) & (said.codes == GREEN)).any(axis=1).sum())
