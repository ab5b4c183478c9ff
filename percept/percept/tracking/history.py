"""What a tracker remembers of one object: its state after every step of its life."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["TrackHistory"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrackHistory:
    """One object after each of the K steps between its birth and its end, in order of time.

    Attributes:
        track_id: Its id.
        motion: Name of the motion model, which decides what the D numbers of a state are.
        stamps_ns: (K,) int64 times of the steps, rising.
        states: (K, D) float64 mean after the update of each step, or after the prediction
            where no detection was found.
        covariances: (K, D, D) float64 of the same.
        observed: (K,) bool whether a detection went into the step.
        shapes: (K, 4) float64 length, width, height in metres, and yaw of the box in rad.
        class_probabilities: (K, C) float64 over the tracker's classes.
        full: (K,) bool whether the track was confirmed after the step.
    """

    track_id: int
    motion: str
    stamps_ns: NDArray[np.int64]
    states: NDArray[np.float64]
    covariances: NDArray[np.float64]
    observed: NDArray[np.bool_]
    shapes: NDArray[np.float64]
    class_probabilities: NDArray[np.float64]
    full: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.stamps_ns)
