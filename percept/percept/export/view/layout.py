"""How the window of a view is divided."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import rerun.blueprint as rrb

__all__ = ["TIMELINE", "VEHICLE", "VEHICLE_PATH", "ViewParts", "view_layout"]

TIMELINE = "bag_time"
"""The time that a view is played in: that of the measurements."""

VEHICLE = "world/percept/vehicle"
"""The entity that moves as the vehicle does, where its poses are known."""

VEHICLE_PATH = "world/percept/path"
"""The entity of all places where the vehicle was."""


@dataclass(frozen=True, slots=True)
class ViewParts:
    """What a view has to show.

    Attributes:
        cameras: By name of the camera, the entity that its image hangs below.
        scene: Whether there is anything in the 3D view.
        scans: Whether there are scans.
        poses: Whether the vehicle moves in it.
        tracks: Whether there are tracks.
        hidden: Entities that are not shown until asked for.
        lights: Whether there are traffic lights.
        health: Whether the health of sensors and detectors is known.
    """

    cameras: Mapping[str, str] = field(default_factory=dict)
    scene: bool = True
    scans: bool = True
    poses: bool = False
    tracks: bool = False
    hidden: tuple[str, ...] = ()
    lights: bool = False
    health: bool = False


def view_layout(parts: ViewParts | None = None) -> rrb.Blueprint:
    """Return the layout of a view: the scene, images and states below it, plots at the side.

    Args:
        parts: What there is to show; a scene alone where not given.
    """
    shown = parts or ViewParts()
    images = [rrb.Spatial2DView(origin=at, name=name) for name, at in shown.cameras.items()]
    rows: list[rrb.Spatial3DView | rrb.Grid | rrb.StateTimelineView] = []
    if shown.scene or not images:
        rows.append(_scene(shown))
    if images:
        rows.append(rrb.Grid(*images))
    if shown.lights or shown.health:
        rows.append(rrb.StateTimelineView(origin="states", name="Lights and health"))
    shares = [1 if isinstance(row, rrb.StateTimelineView) else 3 for row in rows]
    main = rrb.Vertical(*rows, row_shares=shares)
    return rrb.Blueprint(
        rrb.Horizontal(main, _side(shown), column_shares=[3, 1]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        collapse_panels=True,
    )


def _scene(shown: ViewParts) -> rrb.Spatial3DView:
    behind = rrb.EyeControls3D(
        position=(-35, 0, 25),
        look_target=(8, 0, 0),
        eye_up=(0, 0, 1),
        tracking_entity=VEHICLE if shown.poses else None,
    )
    name = "Scans and tracks" if shown.tracks else "Scans and boxes"
    return rrb.Spatial3DView(
        origin="world",
        name=name,
        eye_controls=behind,
        overrides={at: rrb.EntityBehavior(visible=False) for at in shown.hidden},
    )


def _side(shown: ViewParts) -> rrb.Vertical:
    plots = {
        "objects": ("Objects by class", shown.scans),
        "tracks": ("Class probability", shown.tracks),
        "boxes": ("Boxes by camera and model", bool(shown.cameras)),
        "milliseconds": ("Milliseconds by stage", shown.scans or bool(shown.cameras)),
    }
    views = [
        rrb.TimeSeriesView(origin=f"plots/{plot}", name=name)
        for plot, (name, is_there) in plots.items()
        if is_there
    ]
    notes = rrb.TextLogView(origin="notes", name="Notes")
    return rrb.Vertical(*views, notes, row_shares=[*(2 for _ in views), 1])
