"""Paint in rendered images against the synthetic street, which says where every line lies."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.lane_markings import PaintObservation, Sight
from percept.core.rig import CameraSensor
from percept.core.sight_lines import is_hidden
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.synthetic.drive import Drive, DriveConfig
from percept.datasets.synthetic.mesh import joined
from percept.datasets.synthetic.render import RenderConfig, render_image
from percept.datasets.synthetic.shapes import DETECTABLE
from percept.datasets.synthetic.street_mesh import street_parts
from percept.datasets.synthetic.terrain import LINES
from percept.lanes import (
    GroundSurface,
    flat_ground,
    ground_from_image,
    ground_from_points,
    observe_paint,
)
from percept.lanes.birdseye import BirdsEye

_F64 = NDArray[np.float64]

_DRIVE = Drive(DriveConfig(seed=5, seconds=1))
_CAMERA = _DRIVE.cameras[0]
_EGO_Y_M, _STOP_X_M = -5.25, 100.0
_KINK_X_M = 60.0  # the grade changes each 30 m
_FLAT_X_M = 64.0  # nearly 30 m without a change
_NEAR_M, _BESIDE_M, _STRAY_M = 15.0, 0.3, 0.5
_GROUND_MESHES = 7
_AMONG_CARS_M = (40.0, 70.0)


@dataclass(frozen=True, eq=False)
class Look:
    """An image of the street from a place on it."""

    image: NDArray[np.uint8]
    T_map_base: Transform

    def points_in_base(self, points: _F64) -> _F64:
        """Return places (N, 2) of the map on the road, in the vehicle's frame (N, 3)."""
        z = _DRIVE.world.profile.height(points[:, 0])
        return self.T_map_base.inverse().apply(np.column_stack([points, z]))

    def ground(self) -> GroundSurface:
        """Return the road's surface from points as LiDARs have them."""
        x0 = float(self.T_map_base.translation_m[0])
        x, y = np.meshgrid(np.arange(x0 - 5, x0 + 32, 0.2), np.arange(-9.0, 4.0, 0.5))
        points = self.points_in_base(np.column_stack([x.ravel(), y.ravel()]))
        return ground_from_points(points + np.random.default_rng(1).normal(0, 0.02, points.shape))

    def observe(
        self, ground: GroundSurface | None = None, occluders: _F64 | None = None
    ) -> PaintObservation:
        """Return the paint that is found."""
        return observe_paint(
            self.image,
            _CAMERA,
            stamp_ns=7,
            ground=ground or self.ground(),
            occluders=np.zeros((0, 7)) if occluders is None else occluders,
        )


@lru_cache(maxsize=32)
def _look(
    x_m: float,
    light: RenderConfig,
    *,
    objects: bool = False,
    paint: bool = True,
    y_m: float = _EGO_Y_M,
    yaw_deg: float = 0.0,
) -> Look:
    """Return the street seen from the right lane, with or without what stands on it."""
    T_map_base = _vehicle_at(x_m, y_m, yaw_deg)
    T_base_cam = _CAMERA.T_base_sensor
    assert T_base_cam is not None
    parts = [
        part.mesh_map
        for k, part in enumerate(street_parts(_DRIVE.world, 1.0, x_m))
        if (part.placed is None or objects)
        and (paint or part.placed is not None or k < _GROUND_MESHES)
    ]
    T_cam_map = (T_map_base @ T_base_cam).inverse()
    return Look(render_image(joined(parts), _CAMERA.pinhole(), T_cam_map, light), T_map_base)


def _vehicle_at(x_m: float, y_m: float, yaw_deg: float) -> Transform:
    """Return a vehicle that stands on the road with its two axles."""
    rear, front = _DRIVE.world.profile.height(np.array([x_m - 0.1, x_m + 2.8]))
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(0.0, -np.arctan2(front - rear, 2.9), np.radians(yaw_deg))
    matrix[:3, 3] = [x_m, y_m, rear]
    return Transform("map", "base_link", matrix)


def _errors(look: Look, seen: PaintObservation) -> tuple[_F64, NDArray[np.intp]]:
    """Return the error across of each stroke against the line next to it, and that line."""
    y = look.T_map_base.apply(seen.strokes_m)[:, 1]
    lines = np.array([line.y_m for line in LINES])
    which = np.abs(y[:, None] - lines).argmin(axis=1)
    return y - lines[which], which


def _near(seen: PaintObservation) -> NDArray[np.bool_]:
    return np.asarray(np.hypot(*seen.strokes_m[:, :2].T) < _NEAR_M)


@pytest.mark.parametrize("x_m", [_KINK_X_M - 24, _KINK_X_M - 12, _KINK_X_M - 6, _FLAT_X_M])
def test_lines_lie_within_centimetres_where_the_grade_changes(x_m: float) -> None:
    look = _look(x_m, RenderConfig())
    seen = look.observe()
    errors, which = _errors(look, seen)
    near = _near(seen)
    assert set(which[near]) >= {0, 1, 2, 3}
    for line in range(4):
        assert np.abs(errors[near & (which == line)]).mean() < 0.05, LINES[line]
    assert np.abs(errors[near]).mean() < 0.03
    assert np.abs(errors).max() < _STRAY_M
    # The stated spreads cover a pitch and heights that are less well known than here.
    assert np.sqrt(np.mean((errors / seen.sd_m) ** 2)) < 1.2
    assert seen.sd_m[near].max() < 0.15


def test_stated_spreads_are_those_of_cameras_that_are_placed_a_little_wrong() -> None:
    look, rng = _look(_FLAT_X_M, RenderConfig()), np.random.default_rng(3)
    scores = []
    for _ in range(12):
        turned = _turned(_CAMERA, *rng.normal(0, 0.1, 3))
        noisy = look.ground()
        tilted = replace(noisy, z_m=noisy.z_m + rng.normal(0, 1) * noisy.sd_m)
        seen = observe_paint(look.image, turned, stamp_ns=7, ground=tilted)
        errors, _ = _errors(look, seen)
        paint = np.abs(errors) < _STRAY_M
        assert paint.mean() > 0.95
        scores.append((errors / seen.sd_m)[paint])
    assert 0.5 < np.sqrt(np.mean(np.concatenate(scores) ** 2)) < 2.0


def test_flat_ground_will_do_on_a_flat_road() -> None:
    look = _look(_FLAT_X_M, RenderConfig())
    seen = look.observe(flat_ground())
    errors, _ = _errors(look, seen)
    assert np.abs(errors[_near(seen)]).mean() < 0.05
    assert np.sqrt(np.mean((errors / seen.sd_m) ** 2)) < 1.2


@pytest.mark.parametrize("pitch_deg", [-1.0, 1.0])
def test_parallel_lines_correct_the_pitch_where_there_is_no_lidar(pitch_deg: float) -> None:
    look = _look(_FLAT_X_M, RenderConfig())
    wrong = _turned(_CAMERA, 0.0, pitch_deg, 0.0)
    ground = ground_from_image(look.image, wrong)
    assert ground.source == "lines"
    assert any("parallel" in note for note in ground.notes)
    for surface, bound, holds in ((flat_ground(), 0.1, False), (ground, 0.1, True)):
        seen = observe_paint(look.image, wrong, stamp_ns=7, ground=surface)
        errors, _ = _errors(look, seen)
        far = (seen.strokes_m[:, 0] > 10) & _near(seen) & (np.abs(errors) < 1.0)
        assert (np.abs(errors[far]).mean() < bound) == holds
    assert observe_paint(look.image, wrong, stamp_ns=7, ground=ground).notes == ground.notes


def test_an_image_without_lines_leaves_the_ground_flat_and_says_so() -> None:
    ground = ground_from_image(_look(_FLAT_X_M, RenderConfig(), paint=False).image, _CAMERA)
    assert ground.source == "flat"
    assert "flat" in ground.notes[0]


@pytest.mark.parametrize("yaw_deg", [-6.0, 6.0])
def test_a_line_that_the_vehicle_crosses_is_no_upright_edge(yaw_deg: float) -> None:
    # The line at -7 m meets the ground below the camera, as an upright edge would.
    y_m = -7.0 - np.tan(np.radians(yaw_deg)) * 1.6
    look = _look(_FLAT_X_M, RenderConfig(), y_m=y_m, yaw_deg=yaw_deg)
    seen = look.observe(flat_ground())
    own = np.abs(look.T_map_base.apply(seen.strokes_m)[:, 1] + 7.0) < 0.1
    assert own.sum() > 20
    np.testing.assert_allclose(seen.direction_rad[own], -np.radians(yaw_deg), atol=0.03)


@pytest.mark.parametrize("noise", [0.0, 1.5, 4.5])
@pytest.mark.parametrize("x_m", [_KINK_X_M - 8, _FLAT_X_M])
def test_nearly_all_paint_is_found_and_nearly_nothing_else(x_m: float, noise: float) -> None:
    look = _look(x_m, RenderConfig(noise_sd=noise, seed=4))
    _check_found(look, look.observe())


@pytest.mark.parametrize(
    ("light", "least"),
    [
        (RenderConfig(exposure=0.15, seed=4), 0.9),
        (RenderConfig(sun=0.0, ambient=0.5, seed=4), 0.9),
        # The lines of the pair run together where they are a pixel wide: fog hides the gap first.
        (RenderConfig(fog_per_m=0.01, seed=4), 0.8),
    ],
    ids=["dim", "overcast", "fog"],
)
def test_paint_is_found_in_dim_light_and_fog(light: RenderConfig, least: float) -> None:
    look = _look(_KINK_X_M - 8, light)
    _check_found(look, look.observe(), least)


def _check_found(look: Look, seen: PaintObservation, least: float = 0.9) -> None:
    shares = _found_shares(look, seen)
    assert min(shares.values()) > least, shares
    errors, which = _errors(look, seen)
    assert (np.abs(errors) < _BESIDE_M).mean() > 0.98
    is_yellow = np.isin(which, (2, 3))
    assert ((seen.yellow > 0.5) == is_yellow).mean() > 0.95
    assert np.abs(np.median(seen.width_m[which == 0]) - LINES[0].width_m) < 0.05


def _found_shares(look: Look, seen: PaintObservation) -> dict[float, float]:
    """Return by line the share of its seen length within reach that has strokes."""
    x0 = float(look.T_map_base.translation_m[0])
    found = look.T_map_base.apply(seen.strokes_m)
    shares = {}
    for line in LINES[:4]:
        x = np.arange(x0 + 2.0, x0 + _NEAR_M, 0.1)
        if line.period_m:
            x = x[(x % line.period_m > 0.3) & (x % line.period_m < line.dash_m - 0.3)]
        places = look.points_in_base(np.column_stack([x, np.full(len(x), line.y_m)]))
        near = np.hypot(*places[:, :2].T) < _NEAR_M
        x = x[near & (seen.coverage.at(places[:, :2]) == Sight.SEEN)]
        if len(x) > 5:
            own = found[np.abs(found[:, 1] - line.y_m) < 0.1, 0]
            apart = np.abs(x[:, None] - own).min(axis=1, initial=np.inf)
            shares[line.y_m] = float((apart <= seen.step_m).mean())
    return shares


def test_a_road_without_paint_gives_none() -> None:
    for noise in (0.0, 4.5):
        look = _look(_KINK_X_M - 8, RenderConfig(noise_sd=noise, seed=2), paint=False)
        seen = look.observe()
        assert len(seen.strokes_m) <= 1
        assert not len(seen.bars_m)
        assert (seen.coverage.sights == Sight.SEEN).mean() > 0.2


@pytest.mark.parametrize("away_m", [12.0, 10.0, 8.0, 6.5])
def test_stop_lines_lie_within_their_stated_spread(away_m: float) -> None:
    stop = next(s for s in _DRIVE.world.stop_lines(_STOP_X_M, 60) if s.y_range_m[0] < _EGO_Y_M < 0)
    look = _look(stop.near_x_m - away_m, RenderConfig())
    seen = look.observe()
    assert len(seen.bars_m) == 1
    ends = seen.bars_m[0]
    truth = look.points_in_base(np.column_stack([np.full(2, stop.near_x_m), stop.y_range_m[::-1]]))
    error = float(ends[:, 0].mean() - truth[:, 0].mean())
    assert abs(error) < 0.3
    assert abs(error) < 3 * seen.bar_sd_m[0]
    assert seen.bar_sd_m[0] < 0.25
    assert abs(seen.bar_width_m[0] - (stop.far_x_m - stop.near_x_m)) < 0.15
    assert ends[0, 1] > ends[1, 1]
    in_sight = np.minimum(truth[:, 1], 0.6 * (ends[:, 0] - 1.6) + [0.7, 0.0])
    np.testing.assert_allclose(ends[:, 1], in_sight, atol=0.6)


def test_boxes_shade_the_ground_behind_them_and_nothing_else() -> None:
    look = _look(_FLAT_X_M, RenderConfig())
    boxes = np.array([[9.0, -1.0, 0.8, 4.0, 1.8, 1.6, 0.3], [14.0, 5.0, 0.5, 1.0, 1.0, 1.0, 0.0]])
    free, shaded = look.observe(), look.observe(occluders=boxes)
    eye = BirdsEye(_CAMERA, look.ground()).eye_m
    grid = shaded.coverage
    rows, columns = np.indices(grid.sights.shape)
    places = np.stack([rows, columns], axis=-1).reshape(-1, 2) * grid.cell_m + 0.125
    places += np.asarray(grid.corner_m)
    on_ground = np.column_stack([places, look.ground().height(places)])
    larger, smaller = boxes.copy(), boxes.copy()
    larger[:, 3:6] += 0.4  # coverage makes boxes larger by 0.2, and steps are coarse
    hidden = grid.sights.ravel() == Sight.OCCLUDED
    was_seen = free.coverage.sights.ravel() == Sight.SEEN
    assert hidden.sum() > 100
    assert (hidden[was_seen & _ray_cast(eye, on_ground, smaller)]).all()
    assert _ray_cast(eye, on_ground, larger)[hidden].all()
    assert (grid.sights.ravel()[~hidden] == free.coverage.sights.ravel()[~hidden]).all()
    assert (grid.at(shaded.strokes_m[:, :2]) == Sight.SEEN).all()


def _ray_cast(eye: _F64, points: _F64, boxes: _F64) -> NDArray[np.bool_]:
    """Return which points are behind or in a box, by stepping along the lines of sight."""
    hidden = np.zeros(len(points), bool)
    for share in np.linspace(0.0, 0.97, 400):
        at = eye + share * (points - eye)
        for x, y, z, length, width, height, yaw in boxes:
            c, s = np.cos(yaw), np.sin(yaw)
            dx, dy = at[:, 0] - x, at[:, 1] - y
            inside = (np.abs(c * dx + s * dy) < length / 2) & (np.abs(c * dy - s * dx) < width / 2)
            hidden |= inside & (np.abs(at[:, 2] - z) < height / 2)
    return hidden


@pytest.mark.parametrize("x_m", _AMONG_CARS_M)
def test_parked_cars_hide_paint_and_look_like_little_of_it(x_m: float) -> None:
    look = _look(x_m, RenderConfig(), objects=True)
    boxes = _true_boxes(look)
    bare, told = look.observe(), look.observe(occluders=boxes)
    for seen, share in ((bare, 0.9), (told, 0.97)):
        errors, _ = _errors(look, seen)
        assert len(errors) > 30
        assert (np.abs(errors) < _BESIDE_M).mean() > share
    eye = BirdsEye(_CAMERA, look.ground()).eye_m
    assert not is_hidden(eye, told.strokes_m, boxes).any()


def _true_boxes(look: Look) -> _F64:
    rows = []
    for placed in _DRIVE.world.objects(1.0, float(look.T_map_base.translation_m[0]), 50.0):
        if placed.shape.label in DETECTABLE:
            shape = placed.shape
            middle = _DRIVE.world.place(placed, 1.0) @ np.append(shape.middle, 1.0)
            at = look.T_map_base.inverse().apply(middle[None, :3])[0]
            rows.append([*at, shape.length_m, shape.width_m, shape.height_m, placed.yaw_rad])
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def test_too_dark_and_too_far_are_told_apart_from_no_paint() -> None:
    dark = _look(_FLAT_X_M, RenderConfig(exposure=0.001, noise_sd=1.0)).observe()
    assert not len(dark.strokes_m)
    assert (dark.coverage.sights == Sight.TOO_DARK).sum() > 500
    assert not (dark.coverage.sights == Sight.SEEN).any()
    seen = _look(_FLAT_X_M, RenderConfig()).observe()
    places = np.array([[20.9, 0.0], [8.0, 8.5], [500.0, 0.0], [9.0, 0.0]])
    assert seen.coverage.at(places).tolist() == [
        Sight.TOO_FAR,
        Sight.OUT_OF_VIEW,
        Sight.OUT_OF_VIEW,
        Sight.SEEN,
    ]
    assert np.hypot(*seen.strokes_m[:, :2].T).max() < 21.0


def _turned(
    camera: CameraSensor, roll_deg: float, pitch_deg: float, yaw_deg: float
) -> CameraSensor:
    """Return a camera whose place in the rig is wrong by some angles about its own place."""
    place = camera.T_base_sensor
    assert place is not None
    turn = np.array(place.matrix)
    turn[:3, :3] = rotation_from_rpy(*np.radians([roll_deg, pitch_deg, yaw_deg])) @ turn[:3, :3]
    return replace(camera, T_base_sensor=Transform(place.target, place.source, turn))
