"""WGS 84 and local frames (east, north, up) on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LocalFrame"]

_SEMI_MAJOR_M = 6378137.0
_FLATTENING = 1 / 298.257223563
_ECCENTRICITY2 = _FLATTENING * (2 - _FLATTENING)
_ITERATIONS = 8


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """East, north, up about an origin on the ellipsoid: the `map` frame is x = east.

    Attributes:
        latitude_deg: Of the origin.
        longitude_deg: Of the origin.
        altitude_m: Of the origin over the ellipsoid.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float

    def geodetic(self, point_map: NDArray[np.float64]) -> tuple[float, float, float]:
        """Return latitude and longitude in degrees and altitude in metres of a point (3,)."""
        return _geodetic_from_ecef(self._origin_ecef() + self._axes().T @ point_map)

    def geodetics(self, points_map: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return latitudes and longitudes in degrees and altitudes (N, 3) of points (N, 3)."""
        x, y, z = (self._origin_ecef() + points_map @ self._axes()).T
        across = np.hypot(x, y)
        lat = np.arctan2(z, across * (1 - _ECCENTRICITY2))
        for _ in range(_ITERATIONS):
            normal = _SEMI_MAJOR_M / np.sqrt(1 - _ECCENTRICITY2 * np.sin(lat) ** 2)
            lat = np.arctan2(z + _ECCENTRICITY2 * normal * np.sin(lat), across)
        surface = _SEMI_MAJOR_M * np.sqrt(1 - _ECCENTRICITY2 * np.sin(lat) ** 2)
        altitude = across * np.cos(lat) + z * np.sin(lat) - surface
        return np.column_stack([np.degrees(lat), np.degrees(np.arctan2(y, x)), altitude])

    def local(self, geodetic: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (N, 3) in metres of N latitudes and longitudes in degrees and altitudes.

        Args:
            geodetic: (N, 3) float64 degrees north, degrees east, metres over the ellipsoid.
        """
        local: NDArray[np.float64] = (_ecef(geodetic) - self._origin_ecef()) @ self._axes().T
        return local

    def _origin_ecef(self) -> NDArray[np.float64]:
        origin = [[self.latitude_deg, self.longitude_deg, self.altitude_m]]
        ecef: NDArray[np.float64] = _ecef(np.array(origin))[0]
        return ecef

    def _axes(self) -> NDArray[np.float64]:
        """Return the rows east, north and up (3, 3) in earth-centred coordinates."""
        lat, lon = math.radians(self.latitude_deg), math.radians(self.longitude_deg)
        cf, sf, cl, sl = math.cos(lat), math.sin(lat), math.cos(lon), math.sin(lon)
        return np.array([[-sl, cl, 0.0], [-sf * cl, -sf * sl, cf], [cf * cl, cf * sl, sf]])


def _ecef(geodetic: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return earth-centred points (N, 3) of latitudes, longitudes (degrees) and altitudes."""
    lat, lon = np.radians(geodetic[:, 0]), np.radians(geodetic[:, 1])
    normal = _SEMI_MAJOR_M / np.sqrt(1 - _ECCENTRICITY2 * np.sin(lat) ** 2)
    across = (normal + geodetic[:, 2]) * np.cos(lat)
    up = (normal * (1 - _ECCENTRICITY2) + geodetic[:, 2]) * np.sin(lat)
    return np.column_stack([across * np.cos(lon), across * np.sin(lon), up])


def _geodetic_from_ecef(point_ecef: NDArray[np.float64]) -> tuple[float, float, float]:
    """Invert by fixed-point iteration on the latitude, exact to rounding near the surface."""
    x, y, z = point_ecef.tolist()
    across = math.hypot(x, y)
    lat = math.atan2(z, across * (1 - _ECCENTRICITY2))
    normal = _SEMI_MAJOR_M
    for _ in range(_ITERATIONS):
        normal = _SEMI_MAJOR_M / math.sqrt(1 - _ECCENTRICITY2 * math.sin(lat) ** 2)
        lat = math.atan2(z + _ECCENTRICITY2 * normal * math.sin(lat), across)
    altitude = (
        across * math.cos(lat)
        + z * math.sin(lat)
        - _SEMI_MAJOR_M * math.sqrt(1 - _ECCENTRICITY2 * math.sin(lat) ** 2)
    )
    return math.degrees(lat), math.degrees(math.atan2(y, x)), altitude
