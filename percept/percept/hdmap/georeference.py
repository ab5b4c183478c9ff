"""Where the frame of a map lies on the earth, without a library of projections.

A map in a grid (UTM, MGRS, any transverse Mercator) says of its points both local coordinates
and latitude and longitude. Both the grid and east and north about the map's middle are conformal
to far below a millimetre over a few kilometres, so one is a complex polynomial of the other: its
first degree is a similarity (the grid's scale and its convergence of meridians), the second is
how these change over the map (0.3 m at 2.5 km from the middle at 35 degrees north).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.geodesy import LocalFrame
from percept.core.trajectory import Trajectory

__all__ = ["Georeference", "fit_georeference"]

_F64 = NDArray[np.float64]
_C128 = NDArray[np.complex128]
_LEAST_POINTS = 2
_LEAST_EXTENT_M = 1.0
_POINTS_OF_BEND = 10
_EXTENT_OF_BEND_M = 300.0
_SCALES = (0.99, 1.01)
_LARGEST_RMS_M = 0.5
_ROUNDS = 4
_SPREADS = 6.0
_LEAST_GATE_M = 0.02
_NEWTON_STEPS = 6
_EARTH_RADIUS_M = 6.371e6


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Georeference:
    """The way between a map's frame and the earth.

    Attributes:
        frame: East, north and up about the map's origin, or about its middle where it has none.
        coefficients: (D,) complex128 c of x + iy = sum c[k] (east + i north)^k in the map frame:
            c[0] is a shift, c[1] scale and rotation, c[2] how they change.
        over_ellipsoid: Heights of the map are altitudes over the ellipsoid (or what the map has
            for `ele`), not heights over the plane of `frame`.
        residual_m: Root mean square distance of the points that it was fitted to; 0 where
            nothing was fitted.
        points: Number of the points that it was fitted to.
    """

    frame: LocalFrame
    coefficients: _C128
    over_ellipsoid: bool
    residual_m: float = 0.0
    points: int = 0

    @classmethod
    def of_origin(cls, origin: LocalFrame) -> Georeference:
        """Return the one of a map that lies east, north and up of an origin."""
        return cls(frame=origin, coefficients=np.array([0, 1], complex), over_ellipsoid=False)

    @property
    def scale(self) -> float:
        """Metres of the map per metre on the ground in the middle of the frame."""
        return float(abs(self.coefficients[1]))

    @property
    def rotation_rad(self) -> float:
        """Direction of east in the map, from x to y, in the middle of the frame."""
        return float(np.angle(self.coefficients[1]))

    def map_points(self, geodetic: _F64) -> _F64:
        """Return points (N, 3) of the map of N latitudes and longitudes (degrees) and altitudes."""
        heights = geodetic[:, 2]
        if self.over_ellipsoid:
            geodetic = np.column_stack([geodetic[:, :2], np.zeros(len(geodetic))])
        local = self.frame.local(geodetic)
        placed = np.polynomial.polynomial.polyval(_complex(local), self.coefficients)
        heights = heights if self.over_ellipsoid else local[:, 2]
        return np.column_stack([placed.real, placed.imag, heights])

    def geodetic(self, points_map: _F64) -> _F64:
        """Return latitudes and longitudes (degrees) and altitudes (N, 3) of points of the map."""
        ground = self._ground(_complex(points_map))
        heights = points_map[:, 2]
        if not self.over_ellipsoid:
            return self.frame.geodetics(np.column_stack([ground.real, ground.imag, heights]))
        sinking = -(np.abs(ground) ** 2) / (2 * _EARTH_RADIUS_M)
        on_ellipsoid = np.column_stack([ground.real, ground.imag, sinking])
        return np.column_stack([self.frame.geodetics(on_ellipsoid)[:, :2], heights])

    def to_map(self, trajectory: Trajectory) -> Trajectory:
        """Return poses `T_map_base` of poses given east, north and up of `frame`.

        Rotations turn about the vertical only: that of a place 1 km from the middle leans 0.009
        degrees from that of the middle.
        """
        matrices = trajectory.matrices.copy()
        local = trajectory.matrices[:, :3, 3]
        matrices[:, :3, 3] = self.map_points(self.frame.geodetics(local))
        turns = np.angle(_slope(self.coefficients, _complex(local)))
        cosine, sine = np.cos(turns), np.sin(turns)
        about_up = np.zeros((len(turns), 3, 3))
        about_up[:, 0, 0] = about_up[:, 1, 1] = cosine
        about_up[:, 1, 0], about_up[:, 0, 1], about_up[:, 2, 2] = sine, -sine, 1.0
        matrices[:, :3, :3] = about_up @ trajectory.matrices[:, :3, :3]
        return Trajectory(
            "map", trajectory.source, trajectory.stamps_ns, matrices, trajectory.gaps_ns
        )

    def _ground(self, placed: _C128) -> _C128:
        """Return east + i north of x + iy of the map, by Newton's steps from the similarity."""
        ground: _C128 = (placed - self.coefficients[0]) / self.coefficients[1]
        if len(self.coefficients) > 2:
            for _ in range(_NEWTON_STEPS):
                missing = np.polynomial.polynomial.polyval(ground, self.coefficients) - placed
                ground = ground - missing / _slope(self.coefficients, ground)
        return ground


def fit_georeference(xy_map: _F64, geodetic: _F64) -> Georeference | None:
    """Find where the frame of a map lies from points that are known both ways.

    Points that do not fit the others (a point moved in one of the two only) are left out.

    Args:
        xy_map: (N, 2 or more) float64 metres.
        geodetic: (N, 3) float64 degrees north, degrees east, metres; NaN where not known.

    Returns:
        None where too few points are known both ways, or where the two do not go together: no
        conformal grid of about true scale brings one to the other within 0.5 m.
    """
    known = np.isfinite(xy_map[:, :2]).all(axis=1) & np.isfinite(geodetic[:, :2]).all(axis=1)
    if known.sum() < _LEAST_POINTS:
        return None
    xy_map, geodetic = xy_map[known], geodetic[known]
    middle = (geodetic[:, :2].min(axis=0) + geodetic[:, :2].max(axis=0)) / 2
    frame = LocalFrame(float(middle[0]), float(middle[1]), 0.0)
    # On the ellipsoid: a grid is of latitude and longitude alone.
    on_ellipsoid = np.column_stack([geodetic[:, :2], np.zeros(len(geodetic))])
    ground, placed = _complex(frame.local(on_ellipsoid)), _complex(xy_map)
    fitted = _fit(ground, placed)
    if fitted is None:
        return None
    coefficients, used, rms = fitted
    if not _SCALES[0] < abs(coefficients[1]) < _SCALES[1] or not rms < _LARGEST_RMS_M:
        return None
    return Georeference(
        frame=frame,
        coefficients=coefficients,
        over_ellipsoid=True,
        residual_m=rms,
        points=int(used.sum()),
    )


def _fit(ground: _C128, placed: _C128) -> tuple[_C128, NDArray[np.bool_], float] | None:
    """Return coefficients, which points were used, and the root mean square distance of these."""
    used = np.ones(len(ground), bool)
    away, coefficients = np.zeros(len(ground)), np.zeros(2, complex)
    for _ in range(_ROUNDS):
        extent = float(np.abs(ground[used] - ground[used].mean()).max())
        if used.sum() < _LEAST_POINTS or extent < _LEAST_EXTENT_M:
            return None
        bends = used.sum() >= _POINTS_OF_BEND and extent >= _EXTENT_OF_BEND_M
        degree = 2 if bends else 1
        columns = (ground[used] / extent)[:, None] ** np.arange(degree + 1)
        solved = np.linalg.lstsq(columns, placed[used], rcond=None)[0]
        coefficients = solved / extent ** np.arange(degree + 1)
        away = np.abs(np.polynomial.polynomial.polyval(ground, coefficients) - placed)
        used = away <= max(_SPREADS * float(np.median(away)), _LEAST_GATE_M)
    return coefficients, used, float(np.sqrt((away[used] ** 2).mean()))


def _slope(coefficients: _C128, ground: _C128) -> _C128:
    derivative = np.polynomial.polynomial.polyder(coefficients)
    slope: _C128 = np.polynomial.polynomial.polyval(ground, derivative) + 0 * ground
    return slope


def _complex(points: _F64) -> _C128:
    joined: _C128 = points[:, 0] + 1j * points[:, 1]
    return joined
