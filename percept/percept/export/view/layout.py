"""How the window of a view is divided."""

from __future__ import annotations

from collections.abc import Mapping

import rerun.blueprint as rrb

__all__ = ["TIMELINE", "view_layout"]

TIMELINE = "bag_time"
"""The time that a view is played in: that of the measurements."""


def view_layout(cameras: Mapping[str, str] | None = None, *, scene: bool = True) -> rrb.Blueprint:
    """Return the layout of a view: the scene, the images below it, and plots at the side.

    Args:
        cameras: By name of the camera, the entity that its image hangs below.
        scene: Whether there is anything in the 3D view.
    """
    images = [rrb.Spatial2DView(origin=at, name=name) for name, at in (cameras or {}).items()]
    parts: list[rrb.Spatial3DView | rrb.Grid] = []
    if scene or not images:
        behind = rrb.EyeControls3D(position=(-35, 0, 25), look_target=(8, 0, 0), eye_up=(0, 0, 1))
        parts.append(rrb.Spatial3DView(origin="world", name="Scans and boxes", eye_controls=behind))
    if images:
        parts.append(rrb.Grid(*images))
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(*parts), _side(images=bool(images)), column_shares=[3, 1]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        collapse_panels=True,
    )


def _side(*, images: bool) -> rrb.Vertical:
    plots = [
        rrb.TimeSeriesView(origin="plots/objects", name="Objects by class"),
        rrb.TimeSeriesView(origin="plots/milliseconds", name="Milliseconds by stage"),
    ]
    if images:
        plots.insert(1, rrb.TimeSeriesView(origin="plots/boxes", name="Boxes by camera and model"))
    notes = rrb.TextLogView(origin="notes", name="Notes")
    return rrb.Vertical(*plots, notes, row_shares=[*(2 for _ in plots), 1])
