"""What stands and moves where along the street.

The street is a set of conveyors: endless belts of slots that lie side by side. The belt of
still things has speed 0, every lane and footpath has its own speed. What a slot holds
depends only on the seed, the belt and the slot's number, so that a street of any length
needs no memory, and nothing ever collides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from percept.datasets.synthetic.creatures import make_deer, make_pedestrian
from percept.datasets.synthetic.ego import EGO_LANE_Y_M, EGO_SPEED_MPS, EGO_START_X_M
from percept.datasets.synthetic.furniture import (
    make_barrel,
    make_barricade,
    make_building,
    make_cone,
    make_lamp_post,
    make_sign,
    make_signal,
    make_tree,
)
from percept.datasets.synthetic.shapes import Shape
from percept.datasets.synthetic.signals import SignalPlan, draw_plan
from percept.datasets.synthetic.terrain import STOP_LINE_WIDTH_M
from percept.datasets.synthetic.vehicles import make_car, make_cyclist, make_truck

__all__ = [
    "BLOCK_M",
    "CONVEYORS",
    "Block",
    "Conveyor",
    "Placed",
    "Signal",
    "StopLine",
    "block_at",
    "slot_objects",
]

BLOCK_M = 120.0

_Make = Callable[[np.random.Generator], Shape]
_EGO_BELTS = (1, 2)
_PARKED_SHARE = 0.65
_EAST_STOP_M, _WEST_STOP_M = 100.0, 112.4
_SIGNAL_BASE_M = 4.9
_ARM_HEIGHT_M = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A shape on the street; it moves along x at a constant speed and never turns.

    Attributes:
        object_id: Unique and lasting.
        shape: What it is.
        x_m: Position at time 0.
        y_m: Position across the street.
        z_m: Height of its frame over the ground below its origin.
        yaw_rad: Heading.
        vx_mps: Speed along x.
    """

    object_id: int
    shape: Shape
    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    vx_mps: float = 0.0

    def x_at(self, time_s: float) -> float:
        """Return x at a time since the start of the drive."""
        return self.x_m + self.vx_mps * time_s


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """One signal head and its plan; `head.object_id` is the light's id in the map."""

    head: Placed
    plan: SignalPlan


@dataclass(frozen=True, slots=True)
class StopLine:
    """A bar of paint across the lanes of one direction.

    Attributes:
        near_x_m: The edge that drivers reach first.
        far_x_m: The other edge.
        y_range_m: From its right end to its left end as the map's y rises.
    """

    near_x_m: float
    far_x_m: float
    y_range_m: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """The still part of one slot of `BLOCK_M` of street.

    Attributes:
        objects: Scenery and still objects; signal heads are not among them.
        signals: Heads for traffic along +x (first two) and along -x.
        stop_lines: For traffic along +x and along -x.
    """

    objects: tuple[Placed, ...]
    signals: tuple[Signal, ...]
    stop_lines: tuple[StopLine, StopLine]


@dataclass(frozen=True, slots=True)
class Conveyor:
    """A belt of moving things.

    Attributes:
        number: Part of the ids of what is on it.
        y_m: Middle of the lane or path.
        speed_mps: Along x, negative towards -x.
        slot_m: Length of a slot.
        fill: Share of slots that hold something.
        makers: What a filled slot may hold, each as likely.
    """

    number: int
    y_m: float
    speed_mps: float
    slot_m: float
    fill: float
    makers: tuple[_Make, ...]


_TRAFFIC: tuple[_Make, ...] = (make_car, make_car, make_truck)
CONVEYORS: tuple[Conveyor, ...] = (
    Conveyor(1, EGO_LANE_Y_M, EGO_SPEED_MPS, 45.0, 0.7, _TRAFFIC),
    Conveyor(2, -1.75, 10.0, 45.0, 0.7, _TRAFFIC),
    Conveyor(3, 1.75, -9.0, 45.0, 0.8, _TRAFFIC),
    Conveyor(4, 5.25, -7.0, 50.0, 0.7, _TRAFFIC),
    Conveyor(5, -7.15, 4.0, 32.0, 0.8, (make_cyclist,)),
    Conveyor(6, 7.15, -4.5, 40.0, 0.8, (make_cyclist,)),
    Conveyor(7, -11.7, 1.3, 14.0, 0.7, (make_pedestrian,)),
    Conveyor(8, -12.6, -1.2, 18.0, 0.6, (make_pedestrian,)),
    Conveyor(9, 11.7, -1.3, 16.0, 0.7, (make_pedestrian,)),
    Conveyor(10, 12.6, 1.1, 22.0, 0.6, (make_pedestrian,)),
)
"""All that moves: traffic, cyclists and pedestrians, each at its lane's own speed."""


@lru_cache(maxsize=1024)
def slot_objects(seed: int, conveyor: Conveyor, slot: int) -> tuple[Placed, ...]:
    """Return what a slot of a conveyor holds: nothing or one object."""
    rng = _generator(seed, conveyor.number, slot)
    if rng.uniform() > conveyor.fill:
        return ()
    shape = conveyor.makers[int(rng.integers(len(conveyor.makers)))](rng)
    spare = max(conveyor.slot_m - shape.length_m - 2.0, 0.0)
    x = slot * conveyor.slot_m + conveyor.slot_m / 2 + rng.uniform(-0.5, 0.5) * spare
    if conveyor.number in _EGO_BELTS and abs(x - EGO_START_X_M) < 20.0:
        return ()
    yaw = 0.0 if conveyor.speed_mps > 0 else float(np.pi)
    y = conveyor.y_m + rng.uniform(-0.06, 0.06)
    identity = _identity(conveyor.number, slot, 0)
    return (Placed(identity, shape, float(x), float(y), 0.0, yaw, conveyor.speed_mps),)


@lru_cache(maxsize=64)
def block_at(seed: int, slot: int) -> Block:
    """Return the still part of a block."""
    rng = _generator(seed, 0, slot)
    start = slot * BLOCK_M
    places = [*_parked(rng), *_works(rng), *_wildlife(rng), *_signs(rng), *_scenery(rng), *_posts()]
    objects = tuple(
        Placed(_identity(0, slot, k), shape, start + x, y, 0.0, yaw)
        for k, (shape, x, y, yaw) in enumerate(places)
    )
    plan = draw_plan(rng, slot)
    signals = tuple(
        Signal(
            Placed(_identity(99, slot, k), make_signal(None), start + x, y, _SIGNAL_BASE_M, yaw),
            plan,
        )
        for k, (x, y, yaw) in enumerate(_heads())
    )
    east = StopLine(start + _EAST_STOP_M, start + _EAST_STOP_M + STOP_LINE_WIDTH_M, (-6.9, -0.25))
    west = StopLine(start + _WEST_STOP_M, start + _WEST_STOP_M - STOP_LINE_WIDTH_M, (0.25, 6.9))
    return Block(objects, signals, (east, west))


_Place = tuple[Shape, float, float, float]


def _parked(rng: np.random.Generator) -> Iterator[_Place]:
    """Yield parked cars in the parking lanes, and a truck in the last place of each."""
    right = (4.0, 10.5, 17.0, 23.5, 30.0, 36.5, 81.0, 91.0)
    left = (6.0, 13.0, 20.0, 27.0, 34.0, 41.0, 48.0, 55.0, 90.0)
    for side, places in ((-1, right), (1, left)):
        for x in places:
            if rng.uniform() > _PARKED_SHARE:
                continue
            shape = make_truck(rng) if x == places[-1] else make_car(rng)
            yaw = (0.0 if side < 0 else np.pi) + rng.uniform(-0.01, 0.01)
            y = side * (10.15 - shape.width_m / 2)
            yield shape, x + rng.uniform(-0.4, 0.4), y, float(yaw)


def _works(rng: np.random.Generator) -> Iterator[_Place]:
    """Yield two sites of road works: a barricade at each end, barrels and cones between."""
    for x, y in ((43.5, -9.1), (70.0, -9.1), (66.0, 9.1)):
        yield make_barricade(rng), x, y, float(np.pi / 2 + rng.normal(0, 0.05))
    for x, y in ((47, -8.5), (51, -8.5), (55, -8.5), (59, -8.5), (69, 8.6), (73, 8.6)):
        yield make_barrel(rng), x + rng.uniform(-0.4, 0.4), y + rng.uniform(-0.1, 0.1), 0.0
    for x, y in ((61.5, -8.5), (63.5, -8.5), (65.5, -8.5), (67.5, -8.5), (76, 8.6), (78.5, 8.6)):
        yaw = rng.uniform(0, np.pi / 2)
        yield make_cone(rng), x + rng.uniform(-0.3, 0.3), y + rng.uniform(-0.1, 0.1), float(yaw)


def _wildlife(rng: np.random.Generator) -> Iterator[_Place]:
    """Yield deer on the verge, which look anywhere, and at the roadside, along the street."""
    for x, y in ((68, 14.4), (100, -14.3), (106, 14.3)):
        yield make_deer(rng), x + rng.uniform(-1, 1), y, float(rng.uniform(-np.pi, np.pi))
    for x, y in ((76, -8.8), (83, 8.8)):
        yaw = rng.choice([0.0, np.pi]) + rng.uniform(-0.3, 0.3)
        yield make_deer(rng), x + rng.uniform(-0.3, 0.3), y, float(yaw)


def _signs(rng: np.random.Generator) -> Iterator[_Place]:
    """Yield signs that face the traffic of their side."""
    for x in (22.0, 40.0, 75.0):
        yield make_sign(rng), x, -10.75, float(np.pi / 2 + rng.normal(0, 0.05))
    for x in (32.0, 84.0):
        yield make_sign(rng), x, 10.75, float(-np.pi / 2 + rng.normal(0, 0.05))


def _scenery(rng: np.random.Generator) -> Iterator[_Place]:
    """Yield trees on the verge, street lamps, and the buildings behind."""
    for side in (-1, 1):
        for i in range(7):
            yield make_tree(rng), 8.5 + 17 * i + rng.uniform(-1.5, 1.5), side * 14.3, 0.0
        for x in (12.0, 52.0, 92.0):
            yield make_lamp_post(7.0, 2.2), x, side * 10.8, float(-side * np.pi / 2)
        for i in range(4):
            building = make_building(rng, float(rng.uniform(17, 25)))
            setback = 17.0 + rng.uniform(0, 3)
            yield building, 15.0 + 30 * i, side * (setback + building.width_m / 2), 0.0


def _posts() -> Iterator[_Place]:
    """Yield the mast arms that the signals hang from, on the far side of the crossing."""
    yield make_lamp_post(_ARM_HEIGHT_M, 9.0), 114.0, -11.0, float(np.pi / 2)
    yield make_lamp_post(_ARM_HEIGHT_M, 9.0), 98.4, 11.0, float(-np.pi / 2)


def _heads() -> tuple[tuple[float, float, float], ...]:
    """Return x, y and yaw of the heads, hung before the arms, facing their traffic."""
    east = tuple((113.75, y, float(np.pi / 2)) for y in (-5.25, -2.4))
    return east + tuple((98.65, y, float(-np.pi / 2)) for y in (5.25, 2.4))


def _generator(seed: int, conveyor: int, slot: int) -> np.random.Generator:
    return np.random.default_rng([seed, conveyor, slot + 2**31])


def _identity(conveyor: int, slot: int, k: int) -> int:
    """Return a unique id: belt, slot and number in the slot, readable in decimal."""
    return conveyor * 10**9 + (slot + 10**5) * 10**3 + k
