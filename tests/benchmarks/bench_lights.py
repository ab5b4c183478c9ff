"""Traffic light states over time: simulated lights, real label sequences, speed.

    python tests/benchmarks/bench_lights.py --data ../shared/data

Three tables:

- Simulated lights (`tests/truth/light_sequences.py`, which does not draw from the tracker's own
  model), 300 runs of 20 s for each row, answers as the car would have known them. `plain` errors
  come one by one, with 5 % of boxes missing; `hard` ones also in runs, glare, beating lamps and
  occlusions. The delay of a flash is counted twice: from its first box, and from the moment at
  which one full cycle of it had been in view, since no light is called flashing before that.
- The 5,834 consecutive images of the Bosch labels, with seeded flips and drops: false and late
  changes of colour without a filter, with a majority vote over the last readings of the same
  track, with the hidden Markov model as it knew at the time, and with hindsight.
- An hour of four lights in one camera at 10 Hz.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from percept.core.results import Detections2D, LightStates
from percept.lights import LightConfig, LightTracker, Reading, light_label

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "truth"))
from light_sequences import (
    DetectorErrors,
    draw_cycles,
    draw_flashes,
    draw_outages,
    flash_delays,
    hard_errors,
    plain_errors,
    read_lights,
    red_as_green,
    track_readings,
)

_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
_BOSCH = "traffic_light/bosch_bstld_labels/test.yaml"
_BOSCH_HZ = 15.0
_LATE_S = 0.5
_VOTES = 15
_LABELS = ("red", "yellow", "green", "off")
_UNKNOWN = -1


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=_DATA)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print_simulation(arguments.runs, arguments.seed)
    labels = arguments.data / _BOSCH
    if labels.exists():
        print_bosch(labels, arguments.seed)
    else:
        print(f"\n{labels} is missing: no table of real sequences")
    print_speed()


def print_simulation(runs: int, seed: int) -> None:
    """Print red read as green, false flashes and delays."""
    print(f"simulated, {runs} runs of 20 s; red as green of {3 * runs} (cycles, flashes, outages)")
    print(
        "  Hz  errors accuracy | red as green | false flash: cycles outages | found "
        "| after a cycle median p95 s | from first box median p95 s"
    )
    kinds: dict[str, Callable[[float], DetectorErrors]] = {
        "plain": plain_errors,
        "hard": hard_errors,
    }
    for rate_hz in (5, 10, 20):
        for name, errors in kinds.items():
            for accuracy in (0.90, 0.95, 0.98):
                row = simulate(rate_hz, errors(accuracy), runs, seed)
                print(f"  {rate_hz:2d}  {name:6s}    {accuracy:.2f} | {row}", flush=True)


def simulate(rate_hz: float, errors: DetectorErrors, runs: int, seed: int) -> str:
    """Return the figures of one setting."""
    rng = np.random.default_rng([seed, round(rate_hz), round(100 * errors.accuracy)])
    wrong, false = 0, []
    for draw in (draw_cycles, draw_outages):
        truth = draw(runs, rate_hz, rng)
        said = track_readings(truth, read_lights(truth, errors, rng), LightConfig())
        wrong += red_as_green(truth, said)
        false.append(int(said.flashing.any(axis=1).sum()))
    truth = draw_flashes(runs, rate_hz, rng)
    readings = read_lights(truth, errors, rng)
    said = track_readings(truth, readings, LightConfig())
    wrong += red_as_green(truth, said)
    delays = flash_delays(truth, readings, said)
    after = delays - truth.period_s
    return (
        f"{wrong:12d} | {false[0]:19d} {false[1]:7d} | {np.isfinite(delays).mean():5.1%}"
        f"| {_median_and_p95(after):>26s} | {_median_and_p95(delays)}"
    )


def _median_and_p95(values: NDArray[np.float64]) -> str:
    high = np.percentile(values, 95, method="higher")
    return f"{np.median(values):.2f}  {high:.2f}"


@dataclass(frozen=True)
class Sequence:
    """True colours of one light: frames and what it shows there; dark ones are left out."""

    frames: NDArray[np.int64]
    colours: NDArray[np.int64]


def read_bosch(path: Path) -> list[Detections2D]:
    """Return the labels as sure detections, one set for each image."""
    entries = yaml.load(path.read_bytes(), yaml.CSafeLoader)
    return [
        Detections2D(
            round(frame * 1e9 / _BOSCH_HZ),
            "front",
            np.array(
                [[b["x_min"], b["y_min"], b["x_max"], b["y_max"]] for b in entry["boxes"]], float
            ).reshape(-1, 4),
            tuple(box["label"] for box in entry["boxes"]),
            np.full(len(entry["boxes"]), 0.9),
        )
        for frame, entry in enumerate(entries)
    ]


def true_tracks(images: list[Detections2D]) -> tuple[dict[int, Sequence], list[NDArray[np.int64]]]:
    """Return the lights by following the unspoilt boxes, and the light of each box."""
    tracker = LightTracker()
    rows: dict[int, list[tuple[int, int]]] = defaultdict(list)
    owners = []
    for frame, image in enumerate(images):
        tracker.push(image)
        owners.append(tracker._steps[-1].sightings.ids)
        for light, reading in zip(
            owners[-1].tolist(), tracker._steps[-1].sightings.readings.tolist(), strict=True
        ):
            if reading < Reading.DARK:
                rows[light].append((frame, reading))
    return {light: Sequence(*np.array(seen).T) for light, seen in rows.items()}, owners


def spoil(
    images: list[Detections2D], flips: float, drops: float, rng: np.random.Generator
) -> tuple[list[Detections2D], list[NDArray[np.int64]]]:
    """Return images with wrong words and without some boxes, and which boxes are left."""
    spoilt, kept = [], []
    for image in images:
        left = np.flatnonzero(rng.random(len(image)) >= drops)
        readings = [light_label(image.labels[row]) for row in left]
        others = [[word for word in range(4) if word != reading] for reading in readings]
        flip = rng.random(len(left)) < flips
        words = [
            _LABELS[rng.choice(other)] if flipped else image.labels[row]
            for row, other, flipped in zip(left, others, flip, strict=True)
        ]
        spoilt.append(
            Detections2D(
                image.stamp_ns, image.camera, image.boxes_px[left], tuple(words),
                image.confidences[left],
            )
        )  # fmt: skip
        kept.append(left)
    return spoilt, kept


Said = dict[int, dict[int, int]]  # by light and frame: what is said


def answers_of(
    images: list[Detections2D], owners: list[NDArray[np.int64]], kept: list[NDArray[np.int64]]
) -> dict[str, Said]:
    """Return what each way says of each light at each frame in which it was seen."""
    tracker = LightTracker()
    names: dict[int, int] = {}  # of each track the true light that it followed last
    names_at = []
    said: dict[str, Said] = {
        name: defaultdict(dict) for name in ("no filter", "majority vote", "HMM", "hindsight")
    }
    past: dict[int, list[int]] = defaultdict(list)
    frame_of = {image.stamp_ns: frame for frame, image in enumerate(images)}
    for frame, image in enumerate(images):
        tracker.push(image)
        sight = tracker._steps[-1].sightings
        names = names | dict(
            zip(sight.ids.tolist(), owners[frame][kept[frame]].tolist(), strict=True)
        )
        names_at.append(names)
        for light, reading in zip(sight.ids.tolist(), sight.readings.tolist(), strict=True):
            past[light].append(reading)
            said["no filter"][names[light]][frame] = reading
            vote = Counter(past[light][-_VOTES:]).most_common(1)[0][0]
            said["majority vote"][names[light]][frame] = vote
        _note(said["HMM"], tracker.lights(image.stamp_ns), frame, names)
    for states in tracker.history(smoothed=True):
        frame = frame_of[states.stamp_ns]
        _note(said["hindsight"], states, frame, names_at[frame])
    return said


def _note(said: Said, states: LightStates, frame: int, names: dict[int, int]) -> None:
    for light, state in zip(states.ids.tolist(), states.states, strict=True):
        reading = light_label("off" if state == "dark" else state)
        said[names[light]][frame] = _UNKNOWN if reading is None else int(reading)


@dataclass
class Changes:
    """What a way made of the true colours."""

    false: int = 0
    late: int = 0
    missed: int = 0
    true: int = 0
    frames: int = 0
    right: int = 0
    open: int = 0
    red_as_green: int = 0


def score(truth: dict[int, Sequence], said: Said) -> Changes:
    """Return the counts; a light's first colour counts as a change, as it has to be found too."""
    changes = Changes()
    for light, sequence in truth.items():
        heard = np.array([said[light].get(int(frame), _UNKNOWN) for frame in sequence.frames])
        changes.frames += len(heard)
        changes.right += int((heard == sequence.colours).sum())
        changes.open += int((heard == _UNKNOWN).sum())
        changes.red_as_green += int(
            ((heard == Reading.GREEN) & (sequence.colours == Reading.RED)).sum()
        )
        told = np.flatnonzero(heard != _UNKNOWN)
        turned = told[np.flatnonzero(np.diff(heard[told], prepend=_UNKNOWN))]
        changes.false += sum(heard[row] != sequence.colours[row] for row in turned)
        starts = np.flatnonzero(np.diff(sequence.colours, prepend=_UNKNOWN))
        for start, end in zip(starts, [*starts[1:], len(heard)], strict=True):
            right = np.flatnonzero(heard[start:end] == sequence.colours[start])
            changes.true += 1
            changes.missed += not len(right)
            wait = sequence.frames[start + right[0]] - sequence.frames[start] if len(right) else 0
            changes.late += wait / _BOSCH_HZ > _LATE_S
    return changes


def print_bosch(path: Path, seed: int) -> None:
    """Print false and late changes on real sequences of labels."""
    images = read_bosch(path)
    truth, owners = true_tracks(images)
    print(
        f"\nBosch labels, {len(images)} images at {_BOSCH_HZ:g} Hz, {len(truth)} lights; a change "
        f"is late after {_LATE_S:g} s; the vote is over {_VOTES} readings (1 s)"
    )
    print("  flips drops  way            | false  late missed of  true | right   open red as green")
    for flips, drops in ((0.05, 0.05), (0.10, 0.10), (0.20, 0.20)):
        spoilt, kept = spoil(images, flips, drops, np.random.default_rng(seed))
        for name, said in answers_of(spoilt, owners, kept).items():
            c = score(truth, said)
            print(
                f"  {flips:4.0%} {drops:5.0%}  {name:14s} | {c.false:5d} {c.late:5d} {c.missed:6d} "
                f"{c.true:8d} | {c.right / c.frames:5.1%} {c.open / c.frames:6.1%} "
                f"{c.red_as_green:6d}",
                flush=True,
            )


def print_speed() -> None:
    """Print how long an hour of four lights at 10 Hz takes."""
    boxes = np.array([[100.0 * n, 50, 100.0 * n + 10, 80] for n in range(4)])
    confidences = np.full(4, 0.9)
    tracker = LightTracker()
    begin = time.process_time()
    for frame in range(36_000):
        word = ("red", "green", "yellow")[frame // 300 % 3]
        tracker.push(Detections2D(frame * 10**8, "front", boxes, (word,) * 4, confidences))
    pushed = time.process_time()
    count = sum(1 for _ in tracker.history())
    done = time.process_time()
    print(
        f"\nan hour of four lights at 10 Hz: {pushed - begin:.1f} s of one core to track, "
        f"{done - pushed:.1f} s for {count} rows of hindsight"
    )


if __name__ == "__main__":
    main()
