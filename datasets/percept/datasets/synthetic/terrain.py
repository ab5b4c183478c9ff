"""The ground: a road between kerbs whose profile rises and falls in straight pieces.

The map frame is x along the street, y to the left, z up. Heights depend on x only; at the
kerbs the surface steps up by `KERB_HEIGHT_M`. Every piece is a plane, so that a ray meets
the ground in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "KERB_HEIGHT_M",
    "KNOT_SPACING_M",
    "LANE_WIDTH_M",
    "LINES",
    "ROAD_HALF_WIDTH_M",
    "SIDEWALK_EDGE_M",
    "STOP_LINE_WIDTH_M",
    "PaintedLine",
    "Profile",
    "make_profile",
]

LANE_WIDTH_M = 3.5
ROAD_HALF_WIDTH_M = 10.2
SIDEWALK_EDGE_M = 13.2
KERB_HEIGHT_M = 0.15
KNOT_SPACING_M = 30.0
STOP_LINE_WIDTH_M = 0.4

_KNOTS = 16
_STEEPEST_GRADE = 0.05


@dataclass(frozen=True, slots=True)
class PaintedLine:
    """A line along the whole street.

    Attributes:
        y_m: Its middle.
        width_m: Width of the paint.
        period_m: From dash to dash; 0 for a solid line. Dashes start at multiples of it.
        dash_m: Length of a dash.
        colour: `white` or `yellow`.
    """

    y_m: float
    width_m: float
    period_m: float
    dash_m: float
    colour: str


LINES: tuple[PaintedLine, ...] = (
    PaintedLine(-7.0, 0.15, 0.0, 0.0, "white"),
    PaintedLine(-3.5, 0.12, 12.0, 3.0, "white"),
    PaintedLine(-0.12, 0.12, 0.0, 0.0, "yellow"),
    PaintedLine(0.12, 0.12, 0.0, 0.0, "yellow"),
    PaintedLine(3.5, 0.12, 12.0, 3.0, "white"),
    PaintedLine(7.0, 0.15, 0.0, 0.0, "white"),
)
"""Two lanes each way: a double yellow centre line, dashed dividers, solid edge lines."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Height of the road over x, linear between knots, repeating itself for ever.

    Attributes:
        heights_m: (N,) float64 heights at x = 0, `KNOT_SPACING_M`, ...; the N-th knot is the
            first again.
    """

    heights_m: NDArray[np.float64]

    def height(self, x_m: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return the road's height at x (...), metres."""
        index, share = self._place(np.asarray(x_m, dtype=np.float64))
        count = len(self.heights_m)
        before, after = self.heights_m[index % count], self.heights_m[(index + 1) % count]
        height: NDArray[np.float64] = before + (after - before) * share
        return height

    def mean_height(self, x_m: NDArray[np.float64], reach_m: float) -> NDArray[np.float64]:
        """Return the mean height over x - reach ... x + reach, exactly, metres."""
        area = self._area(x_m + reach_m) - self._area(x_m - reach_m)
        mean: NDArray[np.float64] = area / (2 * reach_m)
        return mean

    def ground(
        self, x_m: NDArray[np.float64] | float, y_m: NDArray[np.float64] | float
    ) -> NDArray[np.float64]:
        """Return the height of the surface at x, y (...), road or sidewalk, metres."""
        step = np.where(np.abs(y_m) > ROAD_HALF_WIDTH_M, KERB_HEIGHT_M, 0.0)
        surface: NDArray[np.float64] = self.height(x_m) + step
        return surface

    def _place(self, x_m: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        index = np.floor(x_m / KNOT_SPACING_M).astype(np.int64)
        return index, x_m / KNOT_SPACING_M - index

    @cached_property
    def _area_before(self) -> NDArray[np.float64]:
        """Integral from knot 0 to every knot (N + 1,), m^2."""
        pieces = (self.heights_m + np.roll(self.heights_m, -1)) / 2 * KNOT_SPACING_M
        return np.concatenate([[0.0], np.cumsum(pieces)])

    def _area(self, x_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Integrate the height from 0 to x: whole pieces, and a part of the last one."""
        index, share = self._place(x_m)
        count = len(self.heights_m)
        rounds, inside = index // count, index % count
        first, after = self.heights_m[inside], self.heights_m[(inside + 1) % count]
        part = (first + (after - first) * share / 2) * share * KNOT_SPACING_M
        area: NDArray[np.float64] = (
            rounds * self._area_before[-1] + self._area_before[inside] + part
        )
        return area


def make_profile(rng: np.random.Generator) -> Profile:
    """Draw a profile: grades of at most 5 %, uphill and downhill in turn, closed in itself."""
    grades = rng.uniform(0.25, 1.0, _KNOTS) * np.tile([1.0, 1.0, -1.0, -1.0], _KNOTS // 4)
    grades -= grades.mean()
    grades *= _STEEPEST_GRADE / np.abs(grades).max()
    return Profile(np.concatenate([[0.0], np.cumsum(grades[:-1] * KNOT_SPACING_M)]))
