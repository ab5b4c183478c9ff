"""The paint that LiDARs show, beside the looks of the cameras: also at night, and to all sides."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import partial

from percept.cli.map.drive import MapDrive
from percept.cli.map.looks import Looked
from percept.core.lane_markings import PaintObservation, Sight
from percept.detection.runner import ordered_map
from percept.lanes.intensity import observe_intensity
from percept.lanes.sweeps import RoadView, SweepWindow

__all__ = ["with_lidar_paint"]

_Look = tuple[Looked, PaintObservation | None]


def with_lidar_paint(
    looks: Iterator[Looked], drive: MapDrive, dropped: Counter[str]
) -> Iterator[_Look]:
    """Yield looks as they come, about every 2 m of way with the paint that LiDARs show.

    Args:
        looks: Of the cameras, with the sweeps that belong to them.
        drive: The drive that they are of.
        dropped: Takes the views of LiDARs whose intensity tells nothing of paint.
    """
    if drive.lidars is None:
        return ((looked, None) for looked in looks)
    observe = partial(_observed, drive.lidars.streams.names[0], drive.poses.source)
    found = ordered_map(observe, _views(looks), workers=1)
    return ((looked, _telling(paint, dropped)) for looked, paint in found)


def _views(looks: Iterator[Looked]) -> Iterator[tuple[Looked, RoadView | None]]:
    window = SweepWindow()
    for looked in looks:
        sweep = looked.sweep
        yield looked, None if sweep is None else window.push(sweep)


def _observed(sensor: str, frame_id: str, job: tuple[Looked, RoadView | None]) -> _Look:
    looked, view = job
    if view is None:
        return looked, None
    paint = observe_intensity(
        view.points_base,
        stamp_ns=looked.stamp_ns,
        sensor=sensor,
        frame_id=frame_id,
        ground=view.ground,
    )
    return looked, paint


def _telling(paint: PaintObservation | None, dropped: Counter[str]) -> PaintObservation | None:
    """Return paint where intensity can show any; where not, that is not what hides the road."""
    if paint is None or (paint.coverage.sights == Sight.SEEN).any():
        return paint
    dropped["views of the LiDAR whose intensity tells nothing of paint"] += 1
    return None
