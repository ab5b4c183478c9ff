"""The surface of the road around the vehicle: a profile along x with a slope across.

A camera looks at the road at a flat angle: on a ground that is `dz` too low a point moves
away from the camera by its distance times `dz` over the camera's height. So the height of the
road, not the lens, decides how well a line of paint is placed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError

__all__ = ["GroundSurface", "flat_ground"]

_F64 = NDArray[np.float64]

_FLAT_REACH_M = 40.0
_FLAT_SD_M = 0.02
_FLAT_GRADE_SD = 0.01


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GroundSurface:
    """Height of the road in the vehicle's frame: z(x, y) = profile(x) + cross_slope * y.

    The profile is linear between its knots and keeps its grade beyond them.

    Attributes:
        x_m: (K,) float64 places of the knots, rising, at least two.
        z_m: (K,) float64 heights of the profile there.
        sd_m: (K,) float64 spreads of these heights.
        cross_slope: Rise to the left, metres a metre.
        source: What it was made from: `flat`, `points` or `lines`.
        notes: What was not normal, as sentences.

    Raises:
        GeometryError: If the knots are not rising, or a value is not finite.
    """

    x_m: _F64
    z_m: _F64
    sd_m: _F64
    cross_slope: float = 0.0
    source: str = "flat"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.x_m) < 2 or not len(self.x_m) == len(self.z_m) == len(self.sd_m):
            raise GeometryError("a profile of the ground needs two knots with height and spread")
        values = np.concatenate([self.x_m, self.z_m, self.sd_m, [self.cross_slope]])
        if not np.isfinite(values).all() or (np.diff(self.x_m) <= 0).any():
            raise GeometryError("the knots of a profile of the ground must be finite and rising")

    def height(self, points_m: NDArray[np.floating]) -> _F64:
        """Return z (N,) of the surface below or above points (N, 2) or (N, 3), metres."""
        points = np.asarray(points_m, dtype=np.float64)
        return self.profile(points[:, 0]) + self.cross_slope * points[:, 1]

    def profile(self, x_m: NDArray[np.floating]) -> _F64:
        """Return the height (N,) of the profile at x (N,), metres."""
        piece = self._piece(x_m)
        profile: _F64 = self.z_m[piece] + self.grade(x_m) * (x_m - self.x_m[piece])
        return profile

    def grade(self, x_m: NDArray[np.floating]) -> _F64:
        """Return the rise of the profile (N,) at x (N,), metres a metre."""
        grades: _F64 = np.diff(self.z_m) / np.diff(self.x_m)
        return grades[self._piece(x_m)]

    def spread(self, x_m: NDArray[np.floating]) -> _F64:
        """Return the spread of the height (N,) at x (N,), metres; beyond the knots it grows."""
        beyond = np.maximum(self.x_m[0] - x_m, 0) + np.maximum(x_m - self.x_m[-1], 0)
        spread: _F64 = np.hypot(np.interp(x_m, self.x_m, self.sd_m), _FLAT_GRADE_SD * beyond)
        return spread

    def with_pitch(self, pitch_rad: float) -> GroundSurface:
        """Return the surface as a vehicle sees it whose nose is lower by an angle.

        Args:
            pitch_rad: Turn of the vehicle about its y axis; positive lowers the nose, so that
                the road ahead rises in the vehicle's frame.
        """
        return replace(self, z_m=self.z_m + np.tan(pitch_rad) * self.x_m)

    def _piece(self, x_m: NDArray[np.floating]) -> NDArray[np.intp]:
        piece: NDArray[np.intp] = np.clip(
            np.searchsorted(self.x_m, x_m, side="right") - 1, 0, len(self.x_m) - 2
        )
        return piece


def flat_ground(z_m: float = 0.0) -> GroundSurface:
    """Return a level ground, with the spread that unknown grades and springs give it.

    Args:
        z_m: Its height in the vehicle's frame; 0 where the frame's origin lies on the road.
    """
    x_m = np.linspace(-_FLAT_REACH_M, _FLAT_REACH_M, 17)
    spread = np.hypot(_FLAT_SD_M, _FLAT_GRADE_SD * x_m)
    return GroundSurface(x_m=x_m, z_m=np.full_like(x_m, z_m), sd_m=spread)
