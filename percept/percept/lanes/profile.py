"""The height of the road ahead, from the distance of its lines.

Lines of a road keep their distance. In a bird's-eye view made for flat ground they come apart
where the road rises and close up where it falls: by how much gives the road's height, and with it
the true places of the lines. Near the vehicle the road is the plane that it stands on, up to
a small pitch; so the width of the lane there gives the scale.

A flat distance d from below the camera and the true one d' are on the same ray, so d' = s d and
the road's height is h (1 - s) for a camera h above it; lateral places scale by the same s. A plane
piece of road makes 1/s linear in d, so 1/s is fitted as a line with small kinks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

__all__ = ["RoadProfile", "fit_profile"]

_F64 = NDArray[np.float64]
Paint = NDArray[np.float64]

_KNOT_M = 3.0
_FIRST_KNOT_M = 4.0
_KINK_SD = 0.005  # change of grade at a knot; most have none, a few a large one
_PITCH_SD_RAD = np.radians(0.5)  # of the road's plane near the vehicle
_DIRECTION_SD = 0.03  # against the vanishing point
_CURVATURE_SD = 0.002  # 1/m, of half the curvature
_ROW_M = 0.1
_PIXEL_SD = 0.4  # spread of the middle of paint in a row
_MOST_ROWS = 120  # of a line
_LEAST_SCALE = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class RoadProfile:
    """How flat places become true ones.

    Attributes:
        knots_m: (K,) float64 flat distances from below the camera.
        inverse_scale: (K,) float64 of 1/s at the knots; linear in between and beyond.
        pitch_rad: Pitch of the road's plane near the vehicle against what was assumed; positive
            where it rises.
    """

    knots_m: _F64
    inverse_scale: _F64
    pitch_rad: float

    def scale(self, flat_m: _F64) -> _F64:
        """Return s at flat distances (N,)."""
        inside = np.interp(flat_m, self.knots_m, self.inverse_scale)
        end, before = self.knots_m[-1], self.knots_m[-2]
        slope = (self.inverse_scale[-1] - self.inverse_scale[-2]) / (end - before)
        inverse = inside + np.maximum(flat_m - end, 0) * slope
        scale: _F64 = 1 / np.maximum(inverse, _LEAST_SCALE)
        return scale


def fit_profile(
    lines: Sequence[Paint], focal_px: tuple[float, float], height_m: float
) -> RoadProfile:
    """Fit the profile to the paint of lines.

    Unknown are the lateral places of the lines, one direction and curvature for all, the pitch
    and a kink at each knot; all but the places are expected to be small. One line alone
    gives a profile if the road is straight; with two the road may bend.

    Args:
        lines: For each line, flat distances and lateral places (2, N) from below the camera.
        focal_px: Focal lengths of the camera that they were seen by.
        height_m: Its height over the road.
    """
    if not lines:
        return RoadProfile(np.array([0.0, 1.0]), np.ones(2), 0.0)
    thinned = [line[:, _picked(line.shape[1])] for line in lines]
    d, y = np.concatenate(thinned, axis=1)
    which = np.repeat(np.arange(len(lines)), [line.shape[1] for line in thinned])
    # Neighbouring rows show the same pixels: they count as often as there are pixels.
    pixels = d**2 / (focal_px[1] * height_m)
    shared = np.sqrt(np.maximum(1.0, pixels / _ROW_M))
    sd = np.hypot(0.01, _PIXEL_SD * d / focal_px[0]) * shared
    knots = np.arange(_FIRST_KNOT_M, max(float(d.max()) - 1.0, _FIRST_KNOT_M + 1), _KNOT_M)
    hinges = np.maximum(0.0, d[:, None] - knots)
    count = len(lines)

    def inverse(p: _F64) -> _F64:
        rising: _F64 = 1 + (p[count + 2] * d + hinges @ p[count + 3 :]) / height_m
        return rising

    def residuals(p: _F64) -> _F64:
        rising = inverse(p)
        true = d / np.maximum(rising, _LEAST_SCALE)
        off = (y - rising * (p[which] + p[count] * true + p[count + 1] * true**2)) / sd
        soft = np.sign(off) * np.sqrt(2 * (np.sqrt(1 + off**2) - 1))
        small = p[count : count + 3] / [_DIRECTION_SD, _CURVATURE_SD, _PITCH_SD_RAD]
        kinks = np.sqrt(np.log1p((p[count + 3 :] / _KINK_SD) ** 2))
        return np.concatenate([soft, small, kinks * np.sign(p[count + 3 :])])

    start = np.zeros(count + 3 + len(knots))
    start[:count] = [float(np.median(line[1][line[0] < line[0].min() + 10])) for line in lines]
    solved = least_squares(residuals, start, method="lm").x
    at = np.concatenate([[0.0], knots, [float(d.max())]])
    values = (
        1
        + (solved[count + 2] * at + np.maximum(0.0, at[:, None] - knots) @ solved[count + 3 :])
        / height_m
    )
    return RoadProfile(at, values, float(np.arctan(solved[count + 2])))


def _picked(rows: int) -> NDArray[np.int64]:
    """Return which rows of a line are used: all, or so many that are spread evenly."""
    picked: NDArray[np.int64] = np.unique(
        np.linspace(0, rows - 1, min(rows, _MOST_ROWS)).round().astype(np.int64)
    )
    return picked
