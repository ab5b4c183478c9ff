"""A drive with stops, bends and backing up, for tests of the navigation filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.datasets.synthetic.ego import Motion

__all__ = ["TownMotion"]

_F = NDArray[np.float64]
_ROUND_M = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class TownMotion(Motion):
    """Stand, then drive a lying eight with gentle speeding up and braking, and stand again.

    Attributes:
        stand_s: Time of standing at the start.
        drive_s: Time of driving after that.
        speed_mps: Mean speed of that; negative drives backwards.
    """

    stand_s: float = 10.0
    drive_s: float = 60.0
    speed_mps: float = 8.0

    def way_m(self, time_s: _F) -> _F:
        """Return the way along the curve: it starts and ends with no speed and no jerk."""
        share = np.clip((time_s - self.stand_s) / self.drive_s, 0.0, 1.0)
        stops = 3
        smooth = share - np.sin(2 * np.pi * stops * share) / (2 * np.pi * stops)
        return self.speed_mps * self.drive_s * smooth

    def _plane(self, time_s: _F) -> tuple[_F, _F, _F]:
        phase = self.way_m(time_s) / _ROUND_M
        x, y = 40.0 + _ROUND_M * np.sin(phase), _ROUND_M / 2 * np.sin(2 * phase)
        return x, y, np.arctan2(np.cos(2 * phase), np.cos(phase))
