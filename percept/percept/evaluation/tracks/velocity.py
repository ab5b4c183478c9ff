"""How well tracks know the velocity of the objects that they are paired with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from percept.core.tracked_boxes import TrackedBoxes
from percept.evaluation.tracks.clear import FrameMatches
from percept.evaluation.tracks.frames import TrackFrame

__all__ = ["VelocityScores", "velocity_scores"]


@dataclass(frozen=True, slots=True)
class VelocityScores:
    """Sums that add up.

    Attributes:
        pairs: Pairs of which both velocities are known.
        squares: Sum of the squared length of the velocity's error, in (m/s)^2.
    """

    pairs: int = 0
    squares: float = 0.0

    def __add__(self, other: VelocityScores) -> VelocityScores:
        return VelocityScores(self.pairs + other.pairs, self.squares + other.squares)

    @property
    def rmse_mps(self) -> float:
        """Root of the mean squared error of the velocity over the ground; NaN without pairs."""
        return float(np.sqrt(self.squares / self.pairs)) if self.pairs else float("nan")


def velocity_scores(
    truth: TrackedBoxes, tracks: TrackedBoxes, frames: list[TrackFrame], matches: FrameMatches
) -> VelocityScores:
    """Compare the velocities of pairs.

    Args:
        truth: What is there, as it was given to `pair_frames`.
        tracks: What was tracked.
        frames: The frames that these make.
        matches: The pairs of each frame.
    """
    rows, columns = [np.zeros(0, np.intp)], [np.zeros(0, np.intp)]
    first_row = first_column = 0
    for frame, (pairs, others) in zip(frames, matches, strict=True):
        rows.append(pairs + first_row)
        columns.append(others + first_column)
        first_row += len(frame.truth_ids)
        first_column += len(frame.track_ids)
    error = tracks.velocities_mps[np.concatenate(columns)]
    error = error - truth.velocities_mps[np.concatenate(rows)]
    squares = (error**2).sum(axis=1)
    known = np.isfinite(squares)
    return VelocityScores(int(known.sum()), float(squares[known].sum()))
