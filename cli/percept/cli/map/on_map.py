"""Poses of a log in the frame of a map."""

from __future__ import annotations

from pathlib import Path

from percept.cli.odometry.found import FoundPoses
from percept.core.errors import InputError
from percept.core.results import Verdict
from percept.core.trajectory import Trajectory
from percept.hdmap import HdMap, check_on_map
from percept.hdmap.coordinates import LAID_ANYWHERE
from percept.hdmap.road_heights import RoadHeights

__all__ = ["poses_on_map"]

_MAP = "map"


def poses_on_map(
    found: FoundPoses, hd_map: HdMap, heights: RoadHeights, log: Path
) -> tuple[Trajectory, list[str]]:
    """Return the poses in the frame of the map, and notes.

    Args:
        found: The poses of the log.
        hd_map: The map.
        heights: Of its roads.
        log: The log, for messages.

    Raises:
        InputError: If nothing tells where they lie in the map, or they lie beside it.
    """
    if found.verdict is Verdict.BAD:
        raise InputError(f"its poses cannot be used ({'; '.join(found.why)})", where=log)
    poses = _in_frame(found, hd_map, log)
    check_on_map(hd_map, poses.matrices[:, :3, 3], str(log))
    levelled, lift_m = heights.levelled(poses)
    if not lift_m:
        return poses, []
    note = f"Heights of the poses lie {-lift_m:+.1f} m over those of the map: brought to them."
    return levelled, [note]


def _in_frame(found: FoundPoses, hd_map: HdMap, log: Path) -> Trajectory:
    if found.source.startswith("gnss"):
        if hd_map.georeference is None:
            raise InputError(
                "the poses come from GNSS, and nothing tells where on earth the map lies",
                where=log,
                remedy="Give the place of the map's frame with --origin LAT,LON[,ALT]",
            )
        return hd_map.georeference.to_map(found.trajectory)
    if found.trajectory.target != _MAP:
        better = "".join(f"; {n.rstrip('.')}" for n in found.notes if n.startswith("not from"))
        raise InputError(
            f"poses by {found.source} are in '{found.trajectory.target}': nothing tells where "
            f"that is in the map{better}",
            where=log,
            remedy="Record GNSS fixes, or poses in the frame 'map'",
        )
    if hd_map.dropped[LAID_ANYWHERE]:
        raise InputError(
            f"poses by {found.source} are in the frame of the map, and the map does not say where "
            "that lies",
            where=log,
            remedy="Give the place of the map's frame with --origin LAT,LON[,ALT]",
        )
    return found.trajectory
