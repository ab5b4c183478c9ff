"""Transverse Mercator grids, of which UTM is one, on WGS 84.

Krueger's series in the third flattening n (L. Krueger, Konforme Abbildung des Erdellipsoids in
der Ebene, 1912; coefficients to n^4 as in C. Karney, Transverse Mercator with an accuracy of a
few nanometers, J. Geodesy 85, 2011, eq. 35): exact to a micrometre within 3000 km of the meridian.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.geodesy import LocalFrame
from percept.hdmap.georeference import Georeference, fit_georeference

__all__ = ["TransverseMercator", "georeference_of_grid"]

_F64 = NDArray[np.float64]
_SEMI_MAJOR_M = 6378137.0
_FLATTENING = 1 / 298.257223563
_N = _FLATTENING / (2 - _FLATTENING)
_ECCENTRICITY = math.sqrt(_FLATTENING * (2 - _FLATTENING))
_RECTIFYING_RADIUS_M = _SEMI_MAJOR_M / (1 + _N) * (1 + _N**2 / 4 + _N**4 / 64)
_ALPHA = (
    _N / 2 - 2 / 3 * _N**2 + 5 / 16 * _N**3 + 41 / 180 * _N**4,
    13 / 48 * _N**2 - 3 / 5 * _N**3 + 557 / 1440 * _N**4,
    61 / 240 * _N**3 - 103 / 140 * _N**4,
    49561 / 161280 * _N**4,
)
_STEPS_TO_PLACE = 50
_PLACED_M = 1e-4
_SAMPLES = 7
_LEAST_REACH_M = 200.0


@dataclass(frozen=True, slots=True)
class TransverseMercator:
    """A grid about a meridian.

    Attributes:
        latitude_deg: Of the origin.
        longitude_deg: Of the meridian.
        scale: On the meridian.
        east_m: x of the origin.
        north_m: y of the origin.
    """

    latitude_deg: float
    longitude_deg: float
    scale: float = 1.0
    east_m: float = 0.0
    north_m: float = 0.0

    @classmethod
    def utm(cls, zone: int, *, south: bool = False) -> TransverseMercator:
        """Return the grid of a zone of UTM, 1 to 60."""
        return cls(0.0, zone * 6.0 - 183.0, 0.9996, 500e3, 10e6 if south else 0.0)

    def grid(self, geodetic: _F64) -> _F64:
        """Return x and y (N, 2) of N latitudes and longitudes in degrees (N, 2 or more)."""
        about = self.scale * _RECTIFYING_RADIUS_M
        north_of_equator, east = _rectified(
            geodetic[:, 0], _turned(geodetic[:, 1] - self.longitude_deg)
        )
        to_origin = _rectified(np.array([self.latitude_deg]), np.zeros(1))[0]
        x = self.east_m + about * east
        y = self.north_m + about * (north_of_equator - to_origin)
        return np.column_stack([x, y])


def _turned(degrees: _F64) -> _F64:
    turned: _F64 = (degrees + 180.0) % 360.0 - 180.0
    return turned


def _rectified(latitude_deg: _F64, longitude_deg: _F64) -> tuple[_F64, _F64]:
    """Return northing and easting (N,) in units of the rectifying radius."""
    sine, turn = np.sin(np.radians(latitude_deg)), np.radians(longitude_deg)
    conformal = np.sinh(np.arctanh(sine) - _ECCENTRICITY * np.arctanh(_ECCENTRICITY * sine))
    xi = np.arctan2(conformal, np.cos(turn))
    eta = np.arcsinh(np.sin(turn) / np.hypot(conformal, np.cos(turn)))
    north, east = xi.copy(), eta.copy()
    for k, alpha in enumerate(_ALPHA, start=1):
        north += alpha * np.sin(2 * k * xi) * np.cosh(2 * k * eta)
        east += alpha * np.cos(2 * k * xi) * np.sinh(2 * k * eta)
    return north, east


def georeference_of_grid(grid: TransverseMercator, xy_map: _F64) -> Georeference | None:
    """Return the georeference of a map whose points (N, 2 or more) lie in a grid.

    None where the points lie too far from the meridian for the grid to mean anything there.
    """
    low, high = xy_map[:, :2].min(axis=0), xy_map[:, :2].max(axis=0)
    middle = _place(grid, (low + high) / 2)
    if middle is None:
        return None
    reach = max(float((high - low).max()) / 2, _LEAST_REACH_M)
    steps = np.linspace(-reach, reach, _SAMPLES)
    around = np.array([(east, north, 0.0) for east in steps for north in steps])
    geodetic = middle.geodetics(around)
    return fit_georeference(grid.grid(geodetic), geodetic)


def _place(grid: TransverseMercator, xy: _F64) -> LocalFrame | None:
    """Return where a point (2,) of a grid lies, by steps of what is missing to it."""
    frame = LocalFrame(grid.latitude_deg, grid.longitude_deg, 0.0)
    for _ in range(_STEPS_TO_PLACE):
        here = np.array([[frame.latitude_deg, frame.longitude_deg]])
        missing = (xy - grid.grid(here)[0]) / grid.scale
        if not np.isfinite(missing).all():
            return None
        if np.hypot(*missing) < _PLACED_M:
            return frame
        stride = missing / max(1.0, float(np.hypot(*missing)) / 1e6)
        latitude, longitude, _ = frame.geodetics(np.array([[*stride, 0.0]]))[0].tolist()
        frame = LocalFrame(latitude, longitude, 0.0)
    return None
