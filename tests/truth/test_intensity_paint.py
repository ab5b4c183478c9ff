"""Paint in the intensity of the synthetic LiDARs, several sweeps put together."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from percept.core.lane_markings import PaintObservation, Sight
from percept.core.transform import Transform
from percept.datasets.synthetic.drive import Drive, DriveConfig
from percept.datasets.synthetic.lidar import cloud_of_scan
from percept.datasets.synthetic.terrain import LINES
from percept.lanes import ground_from_points, observe_intensity

_F64 = NDArray[np.float64]

_SWEEPS = range(2, 22, 2)
_LOOK = 12
_TOP = 0


@lru_cache(maxsize=1)
def _seen() -> tuple[PaintObservation, Transform]:
    """Return what ten sweeps of the LiDAR on the roof show, and where the vehicle was."""
    drive = Drive(DriveConfig(seed=3, seconds=3))
    model = drive.lidars[_TOP]
    place = drive.rig.lidars()[model.name].T_base_sensor
    assert place is not None

    def pose(number: int) -> Transform:
        seconds = drive.ego.seconds(drive.scan_stamp_ns(model, number))
        return Transform("map", "base_link", drive.ego.poses(np.array([float(seconds)]))[0])

    T_map_base = pose(_LOOK)
    sweeps = {}
    for number in _SWEEPS:
        cloud = cloud_of_scan(drive.scan(_TOP, number), model.name)
        assert cloud.intensity is not None
        T_now_sensor = T_map_base.inverse() @ pose(number) @ place
        sweeps[number] = np.column_stack([T_now_sensor.apply(cloud.points_xyz), cloud.intensity])
    seen = observe_intensity(
        np.concatenate(list(sweeps.values())),
        stamp_ns=1,
        sensor=model.name,
        frame_id="base_link",
        ground=ground_from_points(sweeps[_LOOK][:, :3]),
    )
    return seen, T_map_base


def test_strokes_lie_on_lines() -> None:
    seen, T_map_base = _seen()
    y = T_map_base.apply(seen.strokes_m)[:, 1]
    lines = np.array([line.y_m for line in LINES])
    errors = np.abs(y[:, None] - lines).min(axis=1)
    assert len(errors) > 60
    assert (errors < 0.3).mean() > 0.95
    assert errors[errors < 0.3].mean() < 0.03
    assert np.sqrt(np.mean((errors / seen.sd_m)[errors < 0.3] ** 2)) < 1.5
    assert np.isnan(seen.yellow).all()


def test_solid_lines_have_strokes_where_points_are_dense() -> None:
    seen, T_map_base = _seen()
    strokes = T_map_base.apply(seen.strokes_m)
    x = np.arange(-8.0, 15.0, 0.25) + float(T_map_base.translation_m[0])
    checked = 0
    for line in LINES[:1] + LINES[2:4]:
        z = T_map_base.translation_m[2]
        points = np.column_stack([x, np.full(len(x), line.y_m), np.full(len(x), z)])
        dense = seen.coverage.at(T_map_base.inverse().apply(points)[:, :2]) == Sight.SEEN
        own = strokes[np.abs(strokes[:, 1] - line.y_m) < 0.1, 0]
        apart = np.abs(x[dense][:, None] - own).min(axis=1, initial=np.inf)
        checked += int(dense.sum())
        assert (apart < seen.step_m).mean() > 0.85, line
    assert checked > 60
