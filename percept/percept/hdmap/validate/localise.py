"""Where the vehicle is against the map: the shift that most lines agree on.

A one-dimensional Markov localisation across the road (Thrun, Burgard & Fox, Probabilistic
Robotics, 2005, chapter 8): each line that a look shows has one vote for the shift that would
bring its paint onto the map, whatever the length of paint; votes of the way behind fade. A line
that was moved is outvoted, and a tie stays where it was. The heading is the median turn of all
strokes, which a line that was moved aside does not touch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Shift", "ShiftFilter"]

_F64 = NDArray[np.float64]
_I64 = NDArray[np.int64]

_REACH_M = 1.5
_BIN_M = 0.05
_CENTRES = np.arange(-round(_REACH_M / _BIN_M), round(_REACH_M / _BIN_M) + 1) * _BIN_M
_KERNEL = np.exp(-0.5 * (np.arange(-5, 6) * _BIN_M / 0.1) ** 2)
_FULL_VOTE_STROKES = 3.0
_STAY = 1.3
_NEAR_M = 0.2
_RIVAL = 0.75
_STANDING_M = 0.1


@dataclass(frozen=True, slots=True)
class Shift:
    """How far paint lies off the map, seen from the vehicle.

    Attributes:
        lateral_m: To the left of the map's lines.
        heading_rad: Turned to the left.
        sd_m: Spread of `lateral_m`.
        lines: Votes that agree, fading ones in parts.
        ambiguous: Whether another shift has nearly as many votes.
    """

    lateral_m: float = 0.0
    heading_rad: float = 0.0
    sd_m: float = 1.0
    lines: float = 0.0
    ambiguous: bool = False


class ShiftFilter:
    """The shift over one drive.

    Args:
        window_m: Votes fade to 37 % over this way.
        pose_sd_m: How far poses usually lie off.
    """

    reach_m = _REACH_M

    def __init__(self, window_m: float, pose_sd_m: float) -> None:
        self._window_m = window_m
        self._prior = np.exp(-0.5 * (_CENTRES / pose_sd_m) ** 2)
        self._score = np.zeros(len(_CENTRES))
        self._seen = 0.0
        self.shift = Shift(sd_m=pose_sd_m)

    def push(
        self, moved_m: float, offset_m: _F64, weight: _F64, line: _I64, turn_rad: _F64
    ) -> Shift:
        """Take the votes of one look.

        Args:
            moved_m: Way since the last look.
            offset_m: (M,) float64 of strokes to the left of their lines, seen from the vehicle,
                under the poses as they were given.
            weight: (M,) float64 1 for near strokes, less for uncertain ones.
            line: (M,) int64 the line of each.
            turn_rad: (M,) float64 of strokes against their lines, under the poses as given.
        """
        inside = np.abs(offset_m) <= _REACH_M
        if not inside.any():
            return self.shift
        votes = _line_votes(offset_m[inside], weight[inside], line[inside])
        share = 1.0 - np.exp(-max(moved_m, _STANDING_M) / self._window_m)
        self._score = (1 - share) * self._score + share * votes
        self._seen = (1 - share) * self._seen + share
        turned = float(np.median(turn_rad[inside]))
        gain = share / self._seen
        heading = (1 - gain) * self.shift.heading_rad + gain * turned
        self.shift = self._read(heading)
        return self.shift

    def _read(self, heading_rad: float) -> Shift:
        score = self._score / self._seen
        favoured = score * self._prior
        if self.shift.lines:
            favoured[np.abs(_CENTRES - self.shift.lateral_m) < _NEAR_M] *= _STAY
        peak = _CENTRES[int(np.argmax(favoured))]
        near = np.abs(_CENTRES - peak) < _NEAR_M
        lateral = float(np.average(_CENTRES[near], weights=score[near] + 1e-12))
        spread = float(
            np.sqrt(np.average((_CENTRES[near] - lateral) ** 2, weights=score[near] + 1e-12))
        )
        lines = float(score[near].max())
        rival = float(score[np.abs(_CENTRES - peak) > 2 * _NEAR_M].max(initial=0.0))
        sd_m = spread / np.sqrt(max(4 * lines, 1.0))
        return Shift(lateral, heading_rad, sd_m, lines, rival > _RIVAL * lines)


def _line_votes(offset: _F64, weight: _F64, line: _I64) -> _F64:
    """Return the votes (61,): each line's sum to at most 1 at its best shift."""
    bins = np.clip(np.rint((offset + _REACH_M) / _BIN_M).astype(np.int64), 0, len(_CENTRES) - 1)
    _, row = np.unique(line, return_inverse=True)
    counts = np.zeros((row.max() + 1, len(_CENTRES)))
    np.add.at(counts, (row, bins), weight)
    total = counts.sum(axis=1, keepdims=True)
    counts *= np.minimum(1.0, total / _FULL_VOTE_STROKES) / np.maximum(total, 1e-12)
    votes: _F64 = np.convolve(counts.sum(axis=0), _KERNEL, mode="same")
    return votes
