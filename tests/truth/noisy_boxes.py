"""What a detector would make of known objects: seeded misses, noise and false boxes.

Misses come in bursts, more of them far away and behind something; errors of place change slowly
beside what is new in each frame; false boxes stay for a while; scores tell good boxes from bad
ones, as those of a network on point clouds do, but not always.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from percept.core.tracked_boxes import TrackedBoxes

__all__ = [
    "LEVELS",
    "NoiseLevel",
    "disturbed",
    "joined_boxes",
    "noisy_detections",
    "steady_noise",
]

_F64 = NDArray[np.float64]
_FAR_M = 60.0
_STEADY = 0.7  # share of an error that is still there in the next frame


@dataclass(frozen=True, slots=True)
class NoiseLevel:
    """How bad a detector is.

    Attributes:
        missed: Share of the frames in which a near object in full view is missed.
        missed_far: What is added at 60 m.
        missed_hidden: What is added for each level of occlusion.
        burst_frames: Mean length of a run of misses.
        position_m: Standard deviation of the centre along x and y, near by; three times at 60 m.
        size: Relative standard deviation of length, width and height.
        yaw_rad: Standard deviation of the yaw; one box in fifty points backwards.
        false_boxes: New false boxes in a frame, of all classes together.
        false_frames: Mean number of frames that one of them stays.
        score_noise: Standard deviation of the scores' logits; objects are about 5 above the rest.
    """

    missed: float
    missed_far: float
    missed_hidden: float
    burst_frames: float
    position_m: float
    size: float
    yaw_rad: float
    false_boxes: float
    false_frames: float
    score_noise: float


# The moderate one has the mean overlaps of PointRCNN's pairs on KITTI (AB3DMOT's table): 0.79 of
# cars, 0.68 of pedestrians, 0.77 of cyclists.
LEVELS = {
    "easy": NoiseLevel(0.02, 0.08, 0.03, 1.5, 0.03, 0.02, 0.03, 0.02, 2.0, 1.0),
    "moderate": NoiseLevel(0.05, 0.15, 0.06, 2.0, 0.06, 0.04, 0.06, 0.08, 2.5, 1.5),
    "hard": NoiseLevel(0.12, 0.30, 0.10, 2.5, 0.12, 0.07, 0.12, 0.25, 3.0, 2.0),
}


def noisy_detections(
    truth: TrackedBoxes, level: NoiseLevel, seed: int, *, ego_xy_m: _F64 | None = None
) -> TrackedBoxes:
    """Return what a detector would see of the objects of one sequence; every id is -1.

    Args:
        truth: The objects, in any level frame.
        level: How bad the detector is.
        seed: The same seed gives the same boxes.
        ego_xy_m: (F, 2) float64 place of the sensor in each frame; None is the origin.
    """
    rng = np.random.default_rng(seed)
    last = int(truth.frames[-1])
    ego = np.zeros((last + 1, 2)) if ego_xy_m is None else ego_xy_m
    ranges = np.hypot(*(truth.boxes_m[:, :2] - ego[truth.frames]).T)
    seen = _seen(truth, ranges, level, rng)
    boxes = disturbed(truth, ranges, level, rng)
    share = _missed_share(truth, ranges, level)
    logits = 5.0 - 8.0 * share + rng.normal(0.0, level.score_noise, len(truth))
    found = replace(
        truth,
        ids=np.full(len(truth), -1, np.int64),
        boxes_m=boxes,
        boxes_px=truth.boxes_px + rng.normal(0.0, 1.0, (len(truth), 4)),
        scores=1.0 / (1.0 + np.exp(-logits)),
    ).select(seen)
    return joined_boxes(found, _false_boxes(truth, ego, level, rng))


def _missed_share(truth: TrackedBoxes, ranges: _F64, level: NoiseLevel) -> _F64:
    hidden = np.clip(truth.occluded, 0, 3)
    share = level.missed + level.missed_far * ranges / _FAR_M + level.missed_hidden * hidden
    return np.clip(share, 0.0, 0.8)


def _seen(
    truth: TrackedBoxes, ranges: _F64, level: NoiseLevel, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Return whether each row is seen: a chain of two states for each object."""
    share = _missed_share(truth, ranges, level)
    ends = 1.0 / level.burst_frames
    begins = np.minimum(share / (1.0 - share) * ends, 1.0)
    draws = rng.random(len(truth))
    seen = np.ones(len(truth), dtype=bool)
    for name in np.unique(truth.ids):
        state = bool(rng.random() < 0.5)  # a new object may be missed for a while
        for row in np.flatnonzero(truth.ids == name):
            state = draws[row] >= begins[row] if state else draws[row] < ends
            seen[row] = state
    return seen


def disturbed(
    truth: TrackedBoxes, ranges: _F64, level: NoiseLevel, rng: np.random.Generator
) -> _F64:
    boxes = truth.boxes_m.copy()
    noise = steady_noise(truth.ids, 7, rng)
    spread = level.position_m * (1.0 + 2.0 * ranges / _FAR_M)
    boxes[:, :2] += noise[:, :2] * spread[:, None]
    boxes[:, 2] += noise[:, 2] * level.position_m * 0.5
    boxes[:, 3:6] *= np.exp(noise[:, 3:6] * level.size)
    backwards = np.pi * (rng.random(len(boxes)) < 0.02)
    yaw = boxes[:, 6] + noise[:, 6] * level.yaw_rad + backwards
    boxes[:, 6] = np.arctan2(np.sin(yaw), np.cos(yaw))
    return boxes


def steady_noise(ids: NDArray[np.int64], width: int, rng: np.random.Generator) -> _F64:
    """Return noise (R, width) of variance 1, part of which stays from frame to frame."""
    fresh = rng.normal(size=(len(ids), width))
    noise = fresh.copy()
    for name in np.unique(ids):
        rows = np.flatnonzero(ids == name)
        for before, row in pairwise(rows):
            noise[row] = _STEADY * noise[before] + np.sqrt(1 - _STEADY**2) * fresh[row]
    return noise


def _false_boxes(
    truth: TrackedBoxes, ego: _F64, level: NoiseLevel, rng: np.random.Generator
) -> TrackedBoxes:
    rows: list[tuple[int, str, _F64, float]] = []
    kinds = sorted(set(truth.labels))
    for frame in range(len(ego)):
        for _ in range(rng.poisson(level.false_boxes)):
            label = kinds[int(rng.integers(len(kinds)))]
            like = truth.boxes_m[rng.choice([k for k, n in enumerate(truth.labels) if n == label])]
            box = like.copy()
            bearing = rng.uniform(-0.7, 0.7) if not ego.any() else rng.uniform(-np.pi, np.pi)
            reach = rng.uniform(5.0, _FAR_M)
            box[:2] = ego[frame] + reach * np.array([np.cos(bearing), np.sin(bearing)])
            box[6] = rng.uniform(-np.pi, np.pi)
            logit = -1.0 + rng.normal(0.0, level.score_noise)
            for later in range(frame, min(frame + rng.geometric(1 / level.false_frames), len(ego))):
                jitter = np.zeros(7)
                jitter[:2] = rng.normal(0.0, 0.2, 2)
                jitter[6] = rng.normal(0.0, 0.3)
                score = 1.0 / (1.0 + np.exp(-logit - rng.normal(0.0, 0.5)))
                rows.append((later, label, box + jitter, float(score)))
    rows.sort(key=lambda row: row[0])
    return TrackedBoxes(
        frames=np.array([row[0] for row in rows], np.int64),
        ids=np.full(len(rows), -1, np.int64),
        labels=tuple(row[1] for row in rows),
        boxes_m=np.array([row[2] for row in rows]).reshape(-1, 7),
        scores=np.array([row[3] for row in rows]),
    )


def joined_boxes(found: TrackedBoxes, false: TrackedBoxes) -> TrackedBoxes:
    order = np.argsort(np.concatenate([found.frames, false.frames]), kind="stable")
    labels = (*found.labels, *false.labels)
    return TrackedBoxes(
        frames=np.concatenate([found.frames, false.frames])[order],
        ids=np.full(len(order), -1, np.int64),
        labels=tuple(labels[row] for row in order),
        boxes_px=np.concatenate([found.boxes_px, false.boxes_px])[order],
        boxes_m=np.concatenate([found.boxes_m, false.boxes_m])[order],
        scores=np.concatenate([found.scores, false.scores])[order],
    )
