"""How far off LiDAR odometry may be: a spread that grows with the way.

Each scan is registered to the scans before it, so an error stays for ever. What its own surfaces
leave open is known from the fit. What they do not show (a slow bend of the whole map) is taken
from the published error of the method. Along a direction that no surface holds the motion is a
guess: the speed is what it was when something last held it, and every second may change it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.odometry.lidar.surfaces import MapFit

__all__ = ["WaySpread"]

_DRIFT = 0.005
"""Mean error of KISS-ICP on KITTI 00 to 10, as a share of the way (Vizzo et al. 2023, table I)."""
_DRIFT_RADPM = float(np.radians(0.0015))
"""The same of its rotation, rad per metre."""
# A vehicle of which nothing is known drives like this, and changes its speed like that.
_SPEED_MPS, _CHANGE_MPS2 = 20.0, 2.0


@dataclass(frozen=True, slots=True)
class WaySpread:
    """What has come together on the way so far.

    Attributes:
        way_m: Length of the way.
        guessed_m: How far a motion that no measurement backs may be off, metres.
        unheld_s: For how long a direction has not been held; infinite before it ever was.
        fit_m: Standard deviation of the position that the last fit leaves open, metres.
        fit_rad: The same of the heading, rad.
    """

    way_m: float = 0.0
    guessed_m: float = 0.0
    unheld_s: float = float("inf")
    fit_m: float = 0.0
    fit_rad: float = 0.0

    def after(self, step: NDArray[np.float64], span_s: float, fit: MapFit) -> WaySpread:
        """Return the spread after one more scan.

        Args:
            step: (3,) float64 motion since the last scan, metres, in the axes of the map.
            span_s: Time since the last scan.
            fit: How the scan fits the map.
        """
        unheld_s = self.unheld_s + span_s if fit.degenerate else 0.0
        speed_mps = min(_CHANGE_MPS2 * unheld_s, _SPEED_MPS)
        return WaySpread(
            way_m=self.way_m + float(np.linalg.norm(step)),
            guessed_m=self.guessed_m + speed_mps * span_s,
            unheld_s=unheld_s,
            fit_m=float(np.sqrt(np.trace(fit.covariance[:3, :3]))),
            fit_rad=float(np.sqrt(fit.covariance[5, 5])),
        )

    def after_gap(self, step: NDArray[np.float64], span_s: float) -> WaySpread:
        """Return the spread behind a gap that the vehicle is assumed to have crossed so."""
        gap_m = float(np.linalg.norm(step))
        guessed_m = self.guessed_m + max(gap_m, _SPEED_MPS * span_s)
        return WaySpread(way_m=self.way_m + gap_m, guessed_m=guessed_m)

    @property
    def sd_position_m(self) -> float:
        """Root of the expected squared error of the position over all axes, metres."""
        return float(np.hypot(_DRIFT * self.way_m + self.guessed_m, self.fit_m))

    @property
    def sd_heading_rad(self) -> float:
        """Standard deviation of the heading, rad."""
        return float(np.hypot(_DRIFT_RADPM * self.way_m, self.fit_rad))
