"""A rig from a tree of frames, as tf and URDF have it: frames, but no kinds of sensors."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path

from percept.core.errors import InputError
from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.transform import Transform

__all__ = ["rig_of_frames"]

_NO_LIDAR = re.compile(
    r"cam(era|_|[0-9]|$)|optical|image|imu|gnss|gps|ins$|wheel|radar|footprint", re.IGNORECASE
)
_NO_SENSOR = "no LiDAR by its name, and a camera's intrinsics are not in this format"


def rig_of_frames(
    T_parent_child: Sequence[Transform],
    path: Path,
    notes: Counter[str],
    lidars: Collection[str] | None = None,
) -> Rig:
    """Return the LiDARs of a tree of frames, placed in its root.

    Args:
        T_parent_child: The edges of the tree.
        path: The file.
        notes: Gets a line for every frame that is left out.
        lidars: The frames of LiDARs where the file says so; None goes by the names: what has
            no other frame below it and is not called a camera or another kind of sensor.

    Raises:
        InputError: If the frames are no tree, or none is a LiDAR's.
    """
    edges = {edge.source: edge for edge in T_parent_child}
    roots = sorted({edge.target for edge in T_parent_child} - set(edges))
    if len(edges) != len(T_parent_child) or len(roots) != 1:
        raise InputError(f"the frames are no tree: roots {roots}", where=path)
    parents = {edge.target for edge in T_parent_child}
    sensors: dict[str, LidarSensor | CameraSensor] = {}
    for frame in edges:
        if frame in lidars if lidars is not None else _may_be_lidar(frame, parents):
            sensors[frame] = LidarSensor(frame, None, frame, _from_root(frame, edges, path))
        elif frame not in parents:
            notes[f"frame {frame}: {_NO_SENSOR}: left out"] += 1
    if not sensors:
        raise InputError(
            "has no LiDAR, and cameras need intrinsics, which it has not",
            where=path,
            remedy="Write the camera into a rig.yaml",
        )
    return Rig(roots[0], sensors)


def _may_be_lidar(frame: str, parents: Collection[str]) -> bool:
    return frame not in parents and not _NO_LIDAR.search(frame)


def _from_root(frame: str, edges: dict[str, Transform], path: Path) -> Transform:
    T_above_frame = edges[frame]
    for _ in edges:
        above = edges.get(T_above_frame.target)
        if above is None:
            return T_above_frame
        T_above_frame = above @ T_above_frame
    raise InputError(f"frame '{frame}' is above itself", where=path)
