"""The whole street at one time as triangles in the map frame, for the camera renderer."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.datasets.synthetic.furniture import make_signal
from percept.datasets.synthetic.layout import Placed
from percept.datasets.synthetic.mesh import Mesh, joined
from percept.datasets.synthetic.terrain import (
    KERB_HEIGHT_M,
    KNOT_SPACING_M,
    LINES,
    ROAD_HALF_WIDTH_M,
    SIDEWALK_EDGE_M,
    Profile,
)
from percept.datasets.synthetic.tessellate import mesh_of_quads, mesh_of_shape
from percept.datasets.synthetic.world import World

__all__ = ["PAINT_LAYER", "StreetPart", "street_mesh", "street_parts"]

PAINT_LAYER = 1

_FAR_M = 120.0
_PAINT = {"white": (0.72, 0.72, 0.7), "yellow": (0.7, 0.45, 0.04)}
_ASPHALT, _CONCRETE, _KERB, _GRASS = (
    (0.075, 0.075, 0.08),
    (0.34, 0.33, 0.31),
    (0.42, 0.42, 0.4),
    (0.09, 0.16, 0.05),
)
_WINDOW = (0.06, 0.09, 0.13)
_STOREY_M, _BAY_M = 3.2, 3.0


def street_mesh(world: World, time_s: float, x_m: float, reach_m: float = 110.0) -> Mesh:
    """Return ground, paint, objects, scenery and signals within a reach along the street.

    The same surfaces as the rays of the LiDARs meet; windows on the buildings are paint that
    only cameras see.
    """
    return joined([part.mesh_map for part in street_parts(world, time_s, x_m, reach_m)])


class StreetPart(NamedTuple):
    """A part of the street with its owner.

    Attributes:
        mesh_map: Triangles in the map frame.
        placed: The object or signal head that they are; None for ground and paint.
        lamp: For a signal head the lamp that shines, `red`, `yellow`, `green` or `off`.
    """

    mesh_map: Mesh
    placed: Placed | None = None
    lamp: str = ""


def street_parts(
    world: World, time_s: float, x_m: float, reach_m: float = 110.0
) -> Iterator[StreetPart]:
    """Yield what `street_mesh` joins, in the same order."""
    span = (x_m - reach_m, x_m + reach_m)
    for mesh in (*_ground(world.profile, span), *_paint(world, x_m, reach_m)):
        yield StreetPart(mesh)
    for placed in world.objects(time_s, x_m, reach_m):
        T_map_object = world.place(placed, time_s)
        yield StreetPart(_moved(mesh_of_shape(placed.shape), T_map_object), placed)
        if placed.shape.label == "building":
            yield StreetPart(_moved(_windows(placed), T_map_object), placed)
    for signal in world.signals(x_m, reach_m):
        state = signal.plan.at(time_s)
        head = make_signal(state.colour if state.lit else None)
        mesh = _moved(mesh_of_shape(head), world.place(signal.head, time_s))
        yield StreetPart(mesh, signal.head, state.colour if state.lit else "off")


def _moved(mesh: Mesh, T_map_object: NDArray[np.float64]) -> Mesh:
    vertices = mesh.vertices @ T_map_object[:3, :3].T + T_map_object[:3, 3]
    return Mesh(vertices, mesh.faces, mesh.colours, mesh.emission, mesh.layer)


def _ground(profile: Profile, span: tuple[float, float]) -> Iterator[Mesh]:
    """Yield the strips between kerbs, sidewalk edges and the far sides, and the kerbs."""
    x = _pieces(*span)
    high = KERB_HEIGHT_M
    yield _strip(profile, x, (-ROAD_HALF_WIDTH_M, 0.0), (ROAD_HALF_WIDTH_M, 0.0), _ASPHALT, 0)
    for side in (-1.0, 1.0):
        kerb, walk, far = (side * y for y in (ROAD_HALF_WIDTH_M, SIDEWALK_EDGE_M, _FAR_M))
        yield _strip(profile, x, (kerb, 0.0), (kerb, high), _KERB, 0)
        yield _strip(profile, x, (kerb, high), (walk, high), _CONCRETE, 0)
        yield _strip(profile, x, (walk, high), (far, high), _GRASS, 0)


def _paint(world: World, x_m: float, reach_m: float) -> Iterator[Mesh]:
    """Yield lines and stop bars as faces in the plane of the road."""
    low, high = x_m - reach_m, x_m + reach_m
    for line in LINES:
        left, right = (line.y_m - line.width_m / 2, 0.0), (line.y_m + line.width_m / 2, 0.0)
        for start, end in _dashes(line.period_m, line.dash_m, low, high):
            x = _pieces(start, end)
            yield _strip(world.profile, x, left, right, _PAINT[line.colour], PAINT_LAYER)
    for stop in world.stop_lines(x_m, reach_m):
        start, end = sorted((stop.near_x_m, stop.far_x_m))
        x = _pieces(start, end)
        y0, y1 = stop.y_range_m
        white = _PAINT["white"]
        yield _strip(world.profile, x, (y0, 0.0), (y1, 0.0), white, PAINT_LAYER)


def _dashes(
    period_m: float, dash_m: float, low: float, high: float
) -> Iterator[tuple[float, float]]:
    if period_m == 0:
        yield low, high
        return
    for k in range(int(np.floor(low / period_m)), int(np.ceil(high / period_m))):
        yield k * period_m, k * period_m + dash_m


def _pieces(start: float, end: float) -> NDArray[np.float64]:
    """Return start, the profile's knots between, and end: between them the road is flat."""
    first = int(np.floor(start / KNOT_SPACING_M)) + 1
    knots = np.arange(first, int(np.ceil(end / KNOT_SPACING_M))) * KNOT_SPACING_M
    return np.concatenate([[start], knots, [end]])


def _strip(
    profile: Profile,
    x: NDArray[np.float64],
    right: tuple[float, float],
    left: tuple[float, float],
    colour: tuple[float, float, float],
    layer: int,
) -> Mesh:
    """Return quadrilaterals between two edges (y, height over the road) along x (N,)."""
    z = profile.height(x)
    edges = [np.column_stack([x, np.full(len(x), y), z + up]) for y, up in (right, left)]
    corners = np.stack([edges[0][:-1], edges[0][1:], edges[1][1:], edges[1][:-1]], axis=1)
    return mesh_of_quads(corners, colour, layer)


def _windows(building: Placed) -> Mesh:
    """Return windows on the two long walls, in the building's frame."""
    wall = building.shape.primitives[0]
    half_length, half_depth, _ = wall.size.tolist()
    top = float(wall.centre[2] + wall.size[2])
    bays = np.arange(int(2 * half_length / _BAY_M)) * _BAY_M - half_length + 1.0
    sills = np.arange(int((top - 1.0) / _STOREY_M)) * _STOREY_M + 1.2
    corners = [
        [[x, y, z], [x + 1.3, y, z], [x + 1.3, y, z + 1.5], [x, y, z + 1.5]]
        for y in (-half_depth, half_depth)
        for z in sills
        for x in bays
    ]
    return mesh_of_quads(np.array(corners).reshape(-1, 4, 3), _WINDOW, PAINT_LAYER)
