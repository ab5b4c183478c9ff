"""The street at a time: which objects and signals are near a place, ready for rays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.datasets.synthetic.layout import (
    BLOCK_M,
    CONVEYORS,
    Block,
    Placed,
    Signal,
    StopLine,
    block_at,
    slot_objects,
)
from percept.datasets.synthetic.shapes import PACKED_WIDTH
from percept.datasets.synthetic.terrain import (
    KERB_HEIGHT_M,
    LINES,
    ROAD_HALF_WIDTH_M,
    Profile,
    make_profile,
)

__all__ = ["PackedScene", "World"]

_PAINT = {"white": (0.65, 1.5), "yellow": (0.5, 1.2)}


@dataclass(frozen=True, slots=True, eq=False)
class PackedScene:
    """Objects and paint as the ray caster reads them; see `raycast.cast_columns`."""

    ids: NDArray[np.int64]
    heights: NDArray[np.float64]
    objects: NDArray[np.float64]
    first: NDArray[np.int64]
    primitives: NDArray[np.float64]
    lines: NDArray[np.float64]
    bars: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """An endless street that depends only on its seed.

    Attributes:
        seed: Any number >= 0.
        profile: Heights of the road.
    """

    seed: int
    profile: Profile

    @classmethod
    def from_seed(cls, seed: int) -> World:
        """Make the world of a seed."""
        return cls(seed, make_profile(np.random.default_rng([seed, 10**6])))

    def blocks(self, x_m: float, reach_m: float) -> tuple[Block, ...]:
        """Return the blocks that overlap x - reach ... x + reach."""
        slots = _slots(x_m, reach_m, BLOCK_M)
        return tuple(block_at(self.seed, slot) for slot in slots)

    def objects(self, time_s: float, x_m: float, reach_m: float) -> tuple[Placed, ...]:
        """Return objects and scenery within a distance along the street, in a fixed order.

        Signal heads are left out; see `signals`.

        Args:
            time_s: Time since the start of the drive.
            x_m: Place along the street.
            reach_m: Largest distance of an object's origin from it.
        """
        found = [o for block in self.blocks(x_m, reach_m) for o in block.objects]
        for conveyor in CONVEYORS:
            belt_x = x_m - conveyor.speed_mps * time_s
            for slot in _slots(belt_x, reach_m, conveyor.slot_m):
                found.extend(slot_objects(self.seed, conveyor, slot))
        return tuple(o for o in found if abs(o.x_at(time_s) - x_m) <= reach_m)

    def signals(self, x_m: float, reach_m: float) -> tuple[Signal, ...]:
        """Return the signal heads within a distance along the street."""
        heads = [s for block in self.blocks(x_m, reach_m) for s in block.signals]
        return tuple(s for s in heads if abs(s.head.x_m - x_m) <= reach_m)

    def stop_lines(self, x_m: float, reach_m: float) -> tuple[StopLine, ...]:
        """Return the stop lines of the blocks within a distance along the street."""
        return tuple(line for block in self.blocks(x_m, reach_m) for line in block.stop_lines)

    def place(self, placed: Placed, time_s: float) -> NDArray[np.float64]:
        """Return `T_map_object` (4, 4) at a time."""
        x = placed.x_at(time_s)
        cos, sin = math.cos(placed.yaw_rad), math.sin(placed.yaw_rad)
        T_map_object = np.eye(4)
        T_map_object[:2, :2] = [[cos, -sin], [sin, cos]]
        T_map_object[:3, 3] = x, placed.y_m, float(self.profile.ground(x, placed.y_m)) + placed.z_m
        return T_map_object

    def packed(self, time_s: float, x_m: float, reach_m: float) -> PackedScene:
        """Return all that rays can meet around a place at about a time."""
        placed = (
            *self.objects(time_s, x_m, reach_m),
            *(signal.head for signal in self.signals(x_m, reach_m)),
        )
        shapes = [o.shape.packed for o in placed]
        first = np.cumsum([0, *(len(rows) for rows in shapes)]).astype(np.int64)
        return PackedScene(
            np.array([o.object_id for o in placed], dtype=np.int64),
            self.profile.heights_m,
            np.array([_pack(o) for o in placed]).reshape(-1, 10),
            first,
            np.concatenate([np.zeros((0, PACKED_WIDTH)), *shapes]),
            _packed_lines(),
            self._packed_bars(x_m, reach_m),
        )

    def _packed_bars(self, x_m: float, reach_m: float) -> NDArray[np.float64]:
        rows = [
            (*sorted((s.near_x_m, s.far_x_m)), *s.y_range_m, *_PAINT["white"])
            for s in self.stop_lines(x_m, reach_m)
        ]
        return np.array(rows, dtype=np.float64).reshape(-1, 6)


def _slots(x_m: float, reach_m: float, slot_m: float) -> range:
    return range(math.floor((x_m - reach_m) / slot_m), math.floor((x_m + reach_m) / slot_m) + 1)


def _pack(placed: Placed) -> tuple[float, ...]:
    step = KERB_HEIGHT_M if abs(placed.y_m) > ROAD_HALF_WIDTH_M else 0.0
    cos, sin = math.cos(placed.yaw_rad), math.sin(placed.yaw_rad)
    middle = placed.shape.middle.tolist()
    height = placed.z_m + step
    return (placed.x_m, placed.y_m, height, cos, sin, placed.vx_mps, *middle, placed.shape.radius_m)


def _packed_lines() -> NDArray[np.float64]:
    return np.array(
        [(s.y_m, s.width_m / 2, s.period_m, s.dash_m, *_PAINT[s.colour]) for s in LINES]
    )
