"""Where tracks and lights go: tables, the view and the overlay."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from percept.cli.track.follow import Followed
from percept.core.trajectory import Trajectory
from percept.export.light_table import LIGHTS, light_rows
from percept.export.overlay import OverlayWriter
from percept.export.tables import write_parquet
from percept.export.track_table import TRACKS, track_rows
from percept.export.view import ViewWriter

__all__ = ["TABLES", "add_to_overlay", "add_to_view", "write_tables"]

TABLES = ("poses.parquet", "tracks.parquet", "lights.parquet")
"""Names of the tables."""


def write_tables(folder: Path, followed: Followed) -> None:
    """Write tracks and lights, as far as there are any; those of the poses stand already."""
    if followed.drive is not None:
        rows = (track_rows(tracks) for tracks in followed.drive.frames())
        write_parquet(folder / "tracks.parquet", TRACKS, rows)
    if followed.lights is not None:
        states = (light_rows(lights) for lights in followed.lights)
        write_parquet(folder / "lights.parquet", LIGHTS, states)


def add_to_view(view: ViewWriter, poses: Trajectory | None, followed: Followed) -> None:
    """Let the vehicle move, and draw tracks and lights."""
    if poses is not None:
        view.add_poses(poses)
    if followed.drive is not None:
        for tracks in followed.drive.frames():
            view.add_tracks(tracks)
    for number, lights in enumerate(followed.lights or ()):
        view.add_lights(lights, () if number else followed.map_lights)


def add_to_overlay(
    overlay: OverlayWriter,
    poses: Trajectory | None,
    followed: Followed,
    log_times_ns: Mapping[int, int],
) -> None:
    """Write poses, tracks and lights as messages.

    Args:
        overlay: Takes them.
        poses: Where the vehicle was, or None.
        followed: Tracks and lights.
        log_times_ns: Recording times of scans and images by their stamps.
    """
    if poses is not None:
        overlay.add_poses(poses)
    if followed.drive is not None:
        for tracks in followed.drive.frames():
            overlay.add_tracks(tracks, log_times_ns.get(tracks.stamp_ns, tracks.stamp_ns))
    frame_id = "" if poses is None else poses.target
    faces = {light.light_id: light.corners_map for light in followed.map_lights}
    for lights in followed.lights or ():
        at_ns = log_times_ns.get(lights.stamp_ns, lights.stamp_ns)
        overlay.add_lights(lights, at_ns, faces=faces, frame_id=frame_id)
