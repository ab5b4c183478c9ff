"""Lights of the synthetic street: map, images and boxes meet, also with a pose that errs."""

from __future__ import annotations

from collections import Counter
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.rig import CameraSensor
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.synthetic.drive import MAP_ORIGIN, Drive, DriveConfig
from percept.datasets.synthetic.lanelet_map import make_map, write_map
from percept.datasets.synthetic.render import RenderConfig
from percept.datasets.synthetic.visible import VisibleBoxes, picture_with_boxes
from percept.hdmap import HdMap, load_map
from percept.lights.association import match_lights
from percept.lights.projection import project_lights

TIMES_S = (0.5, 2.0, 3.5, 5.0, 6.5)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return Drive(DriveConfig(seed=3, cameras=("cam_front", "cam_rear")))


@pytest.fixture(scope="module")
def street(drive: Drive, tmp_path_factory: pytest.TempPathFactory) -> HdMap:
    path = tmp_path_factory.mktemp("map") / "map.osm"
    write_map(make_map(drive.world, MAP_ORIGIN, range(-1, 3)), path)
    return load_map(path)


def pose(drive: Drive, time_s: float) -> Transform:
    return Transform("map", "base_link", drive.ego.poses(np.array([time_s]))[0])


@lru_cache(maxsize=16)
def lights_seen(
    drive: Drive, camera: CameraSensor, time_s: float
) -> tuple[NDArray[np.float64], tuple[int, ...], tuple[str, ...]]:
    """Boxes, ids and states of the lights that are seen in full in a rendered picture."""
    T_map_base = pose(drive, time_s)
    assert camera.T_base_sensor is not None
    T_cam_map = (T_map_base @ camera.T_base_sensor).inverse()
    x_m = float(T_map_base.translation_m[0])
    config = RenderConfig(supersampling=2, noise_sd=0.0)
    seen: VisibleBoxes = picture_with_boxes(
        drive.world, camera.pinhole(), T_cam_map, time_s, x_m, config
    )[1]
    rows = [k for k, label in enumerate(seen.labels) if label.startswith("light_")]
    states = tuple(seen.labels[row].removeprefix("light_") for row in rows)
    return seen.boxes_px[rows], tuple(seen.ids[rows].tolist()), states


def test_lights_of_the_map_are_those_of_the_world(drive: Drive, street: HdMap) -> None:
    by_id = {light.light_id: light for light in street.lights}
    signals = [s for s in drive.world.signals(60.0, 150.0) if s.head.object_id in by_id]
    assert len(signals) >= 8
    for signal in signals:
        light = by_id[signal.head.object_id]
        T_map_head = drive.world.place(signal.head, 0.0)
        face = np.array(
            [[0.18, 0.12, 0], [-0.18, 0.12, 0], [-0.18, 0.12, 1.06], [0.18, 0.12, 1.06]]
        )
        expected = face @ T_map_head[:3, :3].T + T_map_head[:3, 3]
        np.testing.assert_allclose(light.corners_map, expected, atol=1e-5)
        np.testing.assert_allclose(light.facing, T_map_head[:3, 1], atol=1e-9)
        assert light.bulbs == ("red", "yellow", "green")
        others = [o for o in street.lights if o.group_ids == light.group_ids]
        assert all(np.allclose(o.facing, light.facing) for o in others)
        assert len(others) == 2


def test_projections_lie_on_the_pictures(drive: Drive, street: HdMap) -> None:
    compared = 0
    for camera in drive.cameras:
        for time_s in TIMES_S:
            found = project_lights(street.lights, pose(drive, time_s), camera)
            boxes, ids, _ = lights_seen(drive, camera, time_s)
            rows = {light: row for row, light in enumerate(found.ids.tolist())}
            assert set(rows) <= set(ids) | {i for i in rows if found.boxes_px[rows[i], 3] < 8}
            for box, light in zip(boxes, ids, strict=True):
                if light in rows:  # the rest is beyond the range or too small
                    off = np.abs(box - found.boxes_px[rows[light]])
                    # The picture shows the sides of the housing too, 0.12 m before and behind.
                    assert off.max() < 1.0 + 0.03 * (box[3] - box[1])
                    compared += 1
    assert compared >= 14


@pytest.mark.parametrize("wrong_deg", [(1.0, 0.0), (-1.0, 0.0), (0.5, 0.5)])
def test_a_camera_that_looks_elsewhere_and_a_wrong_place(
    drive: Drive, street: HdMap, wrong_deg: tuple[float, float]
) -> None:
    outcomes: Counter[str] = Counter()
    rng = np.random.default_rng(4)
    for camera in drive.cameras:
        for time_s in TIMES_S:
            boxes, ids, states = lights_seen(drive, camera, time_s)
            error = np.eye(4)
            error[:3, :3] = rotation_from_rpy(0.0, *np.radians(wrong_deg))
            error[:3, 3] = rng.normal(size=3)
            error[:3, 3] *= 0.5 / np.linalg.norm(error[:3, 3])
            wrong = pose(drive, time_s) @ Transform("base_link", "base_link", error)
            found = project_lights(street.lights, wrong, camera)
            matches = match_lights(found, boxes, states)
            for light, box in matches.pairs.tolist():
                outcomes["right" if found.ids[light] == ids[box] else "wrong"] += 1
            outcomes["missed"] += len(set(ids) & set(found.ids[matches.missed].tolist()))
    assert outcomes["right"] >= 14
    assert outcomes["wrong"] == outcomes["missed"] == 0
