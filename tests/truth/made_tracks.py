"""Tracks, lights and poses of a made-up drive, at any moment that is asked for."""

from __future__ import annotations

import numpy as np

from percept.core.results import LightStates, Tracks
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform, rotation_from_rpy

START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000

_LABELS = ("car", "pedestrian", "deer", "cyclist")


def make_tracks(step: int, count: int = 3, *, frame_id: str = "map") -> Tracks:
    """Return tracks 0.1 s times `step` into the drive: they go straight on at 2 m/s and more.

    The last of several is on trial, and every other one is seen at every other step.
    """
    ids = np.arange(1, count + 1)
    speeds = 2.0 + np.arange(count)
    boxes = np.zeros((count, 7))
    boxes[:, 0] = 10 + speeds * step * 0.1
    boxes[:, 1] = 4.0 * np.arange(count) - 4
    boxes[:, 2:] = [0.8, 4.2, 1.8, 1.6, 0.1]
    states = ["full"] * count
    if count > 1:
        states[-1] = "trial"
    return Tracks(
        stamp_ns=START_NS + step * STEP_NS,
        frame_id=frame_id,
        ids=ids,
        boxes_m=boxes,
        velocities_mps=np.column_stack([speeds, np.zeros(count)]),
        labels=tuple(_LABELS[i % len(_LABELS)] for i in range(count)),
        label_probabilities=np.linspace(0.9, 0.6, count) if count else np.zeros(0),
        states=tuple(states),
        position_sd_m=np.full(count, 0.15),
        velocity_sd_mps=np.full(count, 0.4),
        observed=(ids + step) % 2 == 0,
        scores=np.where(ids % 3 > 0, 0.1 * ids, np.nan),
    )


def make_lights(step: int) -> LightStates:
    """Return three lights: a red one, one that flashes yellow, and one that is lost at times."""
    lost = step % 30 >= 20
    return LightStates(
        stamp_ns=START_NS + step * STEP_NS,
        ids=np.array([501, 502, 777]),
        states=(
            "red" if step % 60 < 40 else "green",
            "yellow" if step > 12 else "unknown",
            "unknown" if lost else "dark" if step % 30 > 15 else "green",
        ),
        flashing=np.array([False, step > 8, False]),
        probabilities=np.array([0.99, 0.93, 0.5 if lost else 0.97]),
        cameras=(("front", "left"), ("front",), () if lost else ("left",)),
    )


def make_trajectory(steps: int = 60) -> Trajectory:
    """Return poses of `base_link` in `map` every 0.1 s: 5 m/s in a wide left turn, and a tilt."""
    matrices = np.tile(np.eye(4), (steps, 1, 1))
    yaw = 0.01 * np.arange(steps)
    for matrix, turn in zip(matrices, yaw.tolist(), strict=True):
        matrix[:3, :3] = rotation_from_rpy(0.01, -0.02, turn)
    matrices[:, 0, 3] = np.cumsum(0.5 * np.cos(yaw))
    matrices[:, 1, 3] = np.cumsum(0.5 * np.sin(yaw))
    return Trajectory("map", "base_link", START_NS + STEP_NS * np.arange(steps), matrices)


def base_from_lidar(name: str = "top") -> Transform:
    """Return where a LiDAR of `make_scan` sits."""
    return Transform.from_quat_xyzw("base_link", f"lidar_{name}", [1, 0, 2], [0, 0, 0, 1])
