"""What a tracker remembers of one object: its state after every step of its life."""

from __future__ import annotations

from dataclasses import dataclass, field

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
        scores: (K,) float64 mean confidence of its detections up to the step.
        measured: (K, 7) float64 box of the detection that went into each step, in the frame of
            the tracks; NaN where there was none.
        variances_m2: (K, 3) float64 variances that its centre was taken to have; NaN as above.
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
    scores: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    measured: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7)))
    variances_m2: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        if not len(self.scores):
            object.__setattr__(self, "scores", np.full(len(self.stamps_ns), np.nan))
        for name, width in (("measured", 7), ("variances_m2", 3)):
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.full((len(self.stamps_ns), width), np.nan))

    def __len__(self) -> int:
        return len(self.stamps_ns)
