"""Is this plane the plate? Every ray near it votes: on the plate, past it, or no opinion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.board_in_cloud.planes import PlaneCandidate
from percept.calib.board_in_cloud.rectangle import RectangleFit, fit_rectangle, measure_sides

__all__ = ["Plate", "PlateRays", "cast_on_plane", "locate_plate", "place_plate", "recast", "weigh"]

_MARGIN_PER_SIDE = 0.25  # the band around the plate that must be free of its plane
_BINS_PER_SIDE = 16
_ANGLE_STEP_DEG = 7.5
_FILL_CELLS = 3  # the plate is cut into so many cells along each side
_TIGHT_RMS = 3.0  # returns this many rms from the refitted plane are no longer on it
_THINNEST_M = 0.01
_FEWEST = 8
_WORTH_A_LOOK = 0.6  # of the rays explained before the plane is refitted


@dataclass(frozen=True, slots=True, eq=False)
class PlateRays:
    """The rays of a cloud that cross a plane around a place.

    Attributes:
        middle: (3,) place on the plane, metres, in the LiDAR's frame.
        axes: (3, 3) columns x and y in the plane, and its normal towards the sensor.
        crossings: (K, 3) along x and y, and distance of the return from the plane, metres.
        is_hit: (K,) the return lies on the plane.
        is_past: (K,) the return lies behind it; the others lie before it.
        rows: (K,) rows of the cloud.
    """

    middle: NDArray[np.float64]
    axes: NDArray[np.float64]
    crossings: NDArray[np.float64]
    is_hit: NDArray[np.bool_]
    is_past: NDArray[np.bool_]
    rows: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """A rectangle of the plate's size on a plane, and what speaks for it.

    The axes of its rays are those of the plate, their middle is its centre.

    Attributes:
        rays: The rays around it.
        fit: The located rectangle; its pose is relative to the rays' frame.
        explained: Share of the informative rays that a plate there explains: hits on it over
            hits on it, rays through it and hits in the band around it.
        score: Lower bound of that share (Wilson, two standard deviations), so that 500 points
            count for more than 40, times the fill and the agreement of both sides.
        side_hits: (4,) density of hits in the band at -x, +x, -y, +y over that on the plate.
        fill: Share of the nine parts of the plate that hold a hit.
        rms_m: Of its points about their plane.
        points: Hits on it.
        size_m: (2,) sides measured freely.
        slack_m: (2,) how far those may be off for the gaps between rays.
        hidden: (4,) the sides -x, +x, -y, +y that something before the plate covers or touches,
            such as the floor that it stands on; they did not place the rectangle.
    """

    rays: PlateRays
    fit: RectangleFit
    explained: float
    score: float
    side_hits: NDArray[np.float64]
    fill: float
    rms_m: float
    points: int
    size_m: NDArray[np.float64]
    slack_m: NDArray[np.float64]
    hidden: NDArray[np.bool_]


def place_plate(
    points: NDArray[np.float64],
    plane: PlaneCandidate,
    size_m: tuple[float, float],
    tolerance_m: float,
) -> Plate | None:
    """Place the plate on a plane where it explains most rays, to a few centimetres.

    Args:
        points: (N, 3) finite, in the LiDAR's frame, the sensor at the origin.
        plane: The plane.
        size_m: Width and height of the plate.
        tolerance_m: Largest distance of a point from its plane.

    Returns:
        The plate, not yet located precisely; None where nothing fits at all.
    """
    from percept.calib.board_in_cloud.kernels import HIT, PASSED, score_windows

    rays = cast_on_plane(points, (plane.middle, plane.normal, None), size_m, tolerance_m)
    bin_m = min(size_m) / _BINS_PER_SIDE
    kinds = np.where(rays.is_hit, HIT, np.where(rays.is_past, PASSED, 0))
    angles = np.deg2rad(np.arange(0, 180 if size_m[0] != size_m[1] else 90, _ANGLE_STEP_DEG))
    half = int(_radius(size_m) / bin_m)
    margin = _MARGIN_PER_SIDE * min(size_m)
    score, angle, x, y = score_windows(rays.crossings, kinds, angles, size_m, margin, bin_m, half)
    if score <= 0:
        return None
    c, s = np.cos(angle), np.sin(angle)
    pose = np.array([c * x - s * y, s * x + c * y, angle])
    if _explained(rays, pose, size_m)[0] < _WORTH_A_LOOK:
        return None
    centred = recast(points, rays, pose, size_m, tolerance_m)
    if centred is None:
        return None
    span = np.array([bin_m, bin_m, np.deg2rad(_ANGLE_STEP_DEG)])
    return weigh(centred, RectangleFit(np.zeros(3), np.diag(span**2), bin_m, 0.0), size_m)


def locate_plate(
    points: NDArray[np.float64], plate: Plate, size_m: tuple[float, float], tolerance_m: float
) -> Plate | None:
    """Fit the plane to the plate's own points and the rectangle of known size to all rays.

    Args:
        points: (N, 3) finite, in the LiDAR's frame.
        plate: From `place_plate`.
        size_m: Width and height of the plate.
        tolerance_m: Largest distance of a point from its plane.
    """
    span = 2 * min(size_m) / _BINS_PER_SIDE
    tight = float(np.clip(_TIGHT_RMS * plate.rms_m, _THINNEST_M, tolerance_m))
    rays = recast(points, plate.rays, plate.fit.pose, size_m, tight)
    if rays is None:
        return None
    fit = _fit(rays, size_m, span)
    centred = recast(points, rays, fit.pose, size_m, tight)
    if centred is None:
        return None
    hidden = _hidden_sides(centred, size_m)
    if not hidden.any():
        return weigh(rays, fit, size_m)
    return weigh(centred, _fit(centred, size_m, span / 2, hidden), size_m, hidden)


def _fit(
    rays: PlateRays,
    size_m: tuple[float, float],
    span_m: float,
    hidden: NDArray[np.bool_] | None = None,
) -> RectangleFit:
    tells = rays.is_hit | rays.is_past
    for side in np.flatnonzero(hidden) if hidden is not None else ():
        from_edge, _ = _from_side(rays, int(side), size_m)
        tells &= np.abs(from_edge) > _MARGIN_PER_SIDE * min(size_m) / 2
    return fit_rectangle(rays.crossings[tells], rays.is_hit[tells], size_m, np.zeros(3), span_m)


def _hidden_sides(rays: PlateRays, size_m: tuple[float, float]) -> NDArray[np.bool_]:
    """Return beyond which sides more rays end before the plate's plane than pass it."""
    margin = _MARGIN_PER_SIDE * min(size_m)
    hidden = np.zeros(4, np.bool_)
    for side in range(4):
        from_edge, beside = _from_side(rays, side, size_m)
        beyond = beside & (from_edge > 0) & (from_edge < margin)
        nearer = beyond & ~rays.is_hit & ~rays.is_past
        hidden[side] = nearer.sum() > (beyond & rays.is_past).sum()
    return hidden


def _from_side(
    rays: PlateRays, side: int, size_m: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return how far rays cross beyond a side of the plate at the middle, and which beside it."""
    axis, sign = side // 2, 2 * (side % 2) - 1
    from_edge = sign * rays.crossings[:, axis] - size_m[axis] / 2
    beside: NDArray[np.bool_] = np.abs(rays.crossings[:, 1 - axis]) < size_m[1 - axis] / 2
    return from_edge, beside


def weigh(
    rays: PlateRays,
    fit: RectangleFit,
    size_m: tuple[float, float],
    hidden: NDArray[np.bool_] | None = None,
) -> Plate:
    """Count what speaks for a plate and against it."""
    explained, counted = _explained(rays, fit.pose, size_m)
    x, y = _plate_coordinates(rays, fit.pose)
    on = rays.is_hit & (np.abs(x) < size_m[0] / 2) & (np.abs(y) < size_m[1] / 2)
    cell_x = np.floor((x[on] / size_m[0] + 0.5) * _FILL_CELLS).astype(int)
    cell_y = np.floor((y[on] / size_m[1] + 0.5) * _FILL_CELLS).astype(int)
    tells = rays.is_hit | rays.is_past
    found, slack = measure_sides(rays.crossings[tells], rays.is_hit[tells], size_m, fit.pose)
    fill = len(np.unique(cell_x * _FILL_CELLS + cell_y)) / _FILL_CELLS**2
    worst = (np.abs(found - size_m) + slack) / size_m
    agreement = float(np.prod(np.clip(1 - worst, 0, 1)))
    return Plate(
        rays=rays,
        fit=fit,
        explained=explained,
        score=_wilson_lower(explained, counted) * fill * agreement,
        side_hits=_side_densities(x, y, rays.is_hit, size_m),
        fill=fill,
        rms_m=float(np.sqrt(np.mean(rays.crossings[on, 2] ** 2))) if on.any() else 0.0,
        points=int(on.sum()),
        size_m=found,
        slack_m=slack,
        hidden=np.zeros(4, np.bool_) if hidden is None else hidden,
    )


def _explained(
    rays: PlateRays, pose: NDArray[np.float64], size_m: tuple[float, float]
) -> tuple[float, int]:
    """Return the share of rays explained, and of how many."""
    outside = _outside(rays, pose, size_m)
    on = int((rays.is_hit & (outside < 0)).sum())
    through = int((rays.is_past & (outside < 0)).sum())
    band = (outside >= 0) & (outside < _MARGIN_PER_SIDE * min(size_m))
    counted = on + through + int((rays.is_hit & band).sum())
    return (on / counted if counted else 0.0), counted


def _wilson_lower(share: float, count: int, z: float = 2.0) -> float:
    """Return the lower end of Wilson's interval of a share (Wilson 1927)."""
    if not count:
        return 0.0
    spread = z * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    return float((share + z**2 / (2 * count) - spread) / (1 + z**2 / count))


def _side_densities(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
    size_m: tuple[float, float],
) -> NDArray[np.float64]:
    """Return the density of hits beyond each side over that of as wide a band within it."""
    margin = _MARGIN_PER_SIDE * min(size_m)
    shares = []
    for ahead, beside, axis in ((-x, y, 0), (x, y, 0), (-y, x, 1), (y, x, 1)):
        here = is_hit & (np.abs(beside) < size_m[1 - axis] / 2)
        from_edge = ahead - size_m[axis] / 2
        beyond = int((here & (from_edge > 0) & (from_edge < margin)).sum())
        within = int((here & (from_edge <= 0) & (from_edge > -margin)).sum())
        shares.append(beyond / max(within, 1))
    return np.array(shares)


def _radius(size_m: tuple[float, float]) -> float:
    return 0.95 * float(np.hypot(*size_m))


def _outside(
    rays: PlateRays, pose: NDArray[np.float64], size_m: tuple[float, float]
) -> NDArray[np.float64]:
    from percept.calib.board_in_cloud.rectangle_kernels import edge_distances

    return edge_distances(rays.crossings, pose, size_m[0] / 2, size_m[1] / 2)


def _plate_coordinates(
    rays: PlateRays, pose: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y = rays.crossings[:, 0] - pose[0], rays.crossings[:, 1] - pose[1]
    return c * x + s * y, c * y - s * x


def recast(
    points: NDArray[np.float64],
    rays: PlateRays,
    pose: NDArray[np.float64],
    size_m: tuple[float, float],
    tolerance_m: float,
) -> PlateRays | None:
    """Refit the plane to the hits on the plate and cast anew, in the frame of the plate."""
    on_plate = rays.is_hit & (_outside(rays, pose, size_m) < 0)
    if on_plate.sum() < _FEWEST:
        return None
    mean, normal, _ = _plane_through(points[rays.rows[on_plate]])
    centre = rays.middle + rays.axes[:, :2] @ pose[:2]
    centre = centre - normal * (normal @ (centre - mean))
    x_axis = rays.axes[:, :2] @ np.array([np.cos(pose[2]), np.sin(pose[2])])
    return cast_on_plane(points, (centre, normal, x_axis), size_m, tolerance_m)


def cast_on_plane(
    points: NDArray[np.float64],
    plane: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None],
    size_m: tuple[float, float],
    tolerance_m: float,
) -> PlateRays:
    """Cast a cloud's rays on a plane given by a point, its normal and, if known, the x axis."""
    from percept.calib.board_in_cloud.kernels import HIT, PASSED, classify_rays

    middle, normal, x_axis = plane
    normal = -normal if normal @ middle > 0 else normal
    if x_axis is None:
        x_axis = np.eye(3)[int(np.argmin(np.abs(normal)))]
    x_axis = x_axis - normal * (normal @ x_axis)
    x_axis = x_axis / np.linalg.norm(x_axis)
    axes = np.column_stack([x_axis, np.cross(normal, x_axis), normal])
    crossings, kinds, rows = classify_rays(points, middle, axes, _radius(size_m), tolerance_m)
    return PlateRays(middle, axes, crossings, kinds == HIT, kinds == PASSED, rows)


def _plane_through(
    points: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return mean, normal and rms of points (N, 3) about their plane of least squares."""
    mean = points.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov((points - mean).T, bias=True))
    return mean, vectors[:, 0], float(np.sqrt(max(values[0], 0.0)))
