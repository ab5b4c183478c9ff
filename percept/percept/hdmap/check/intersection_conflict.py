"""Which lanelets cross each other's way, and which begin at the same place."""

from __future__ import annotations

from typing import NamedTuple

from percept.hdmap.check.checked_map import CheckedMap

__all__ = ["Conflict", "conflicts_of", "have_same_source"]

_SLIGHT_SHARE = 0.01


class Conflict(NamedTuple):
    """Another lanelet on a lanelet's way.

    Attributes:
        lanelet_id: The other one.
        share: How much of the ground of the lanelet it covers, 0 to 1.
    """

    lanelet_id: int
    share: float

    @property
    def slight(self) -> bool:
        """Whether so little is covered that borders drawn by hand may be the reason."""
        return self.share < _SLIGHT_SHARE


def conflicts_of(checked: CheckedMap, lanelet_id: int) -> tuple[Conflict, ...]:
    """Return lanelets for vehicles that cover ground of a lanelet, ids rising.

    As of Lanelet2's routing graph (relation `Conflicting`): not those that follow it, lead to it
    or lie beside it.
    """
    routing, ground = checked.hd_map.routing, checked.lanelet_ground(lanelet_id)
    beside = (*routing.left.get(lanelet_id, ()), *routing.right.get(lanelet_id, ()))
    related = {
        *routing.following_ids(lanelet_id),
        *routing.previous_ids(lanelet_id),
        *(neighbour.lanelet_id for neighbour in beside),
    }
    return tuple(
        Conflict(
            other, float(ground.intersection(checked.lanelet_ground(other)).area / ground.area)
        )
        for other in checked.conflicting(lanelet_id)
        if other not in related and other in routing.left
    )


def have_same_source(checked: CheckedMap, lanelet_id: int, other_id: int) -> bool:
    """Return whether vehicles reach two lanelets from the same lanelet, one after the other."""
    routing = checked.hd_map.routing
    return bool(set(routing.previous_ids(lanelet_id)) & set(routing.previous_ids(other_id)))
