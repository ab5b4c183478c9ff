"""Parts of the synthetic world on their own."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from percept.core.errors import GeometryError
from percept.core.geodesy import LocalFrame
from percept.datasets.synthetic.creatures import make_deer, make_pedestrian
from percept.datasets.synthetic.ego import EgoMotion
from percept.datasets.synthetic.furniture import make_barrel, make_sign
from percept.datasets.synthetic.layout import CONVEYORS, block_at, slot_objects
from percept.datasets.synthetic.primitives import Material, box, ellipsoid, extents, frustum
from percept.datasets.synthetic.shapes import Shape
from percept.datasets.synthetic.signals import SignalPlan, draw_plan
from percept.datasets.synthetic.street_mesh import street_mesh
from percept.datasets.synthetic.terrain import KNOT_SPACING_M, make_profile
from percept.datasets.synthetic.tessellate import mesh_of_shape
from percept.datasets.synthetic.vehicles import make_car, make_cyclist, make_truck
from percept.datasets.synthetic.world import World

GREY = Material((0.5, 0.5, 0.5), 0.5)


def test_extents_are_those_of_sampled_surfaces() -> None:
    rng = np.random.default_rng(0)
    rpy = (0.3, -0.4, 1.1)
    sphere = rng.standard_normal((200_000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    egg = ellipsoid((1, 2, 3), (0.5, 0.2, 0.9), GREY, rpy)
    cloud = (sphere * egg.size) @ egg.rotation.T + egg.centre
    assert np.abs(np.stack([cloud.min(0), cloud.max(0)]) - egg.bounds()).max() < 2e-3
    cone = frustum((0, 0, 0), (1, 2, 0.5), (0.4, 0.1), GREY)
    angle = rng.uniform(0, 2 * np.pi, 100_000)
    end = rng.integers(0, 2, 100_000)
    radius = np.where(end == 0, 0.4, 0.1)
    ring = np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), (2 * end - 1) * cone.size[2]]
    )
    cloud = ring @ cone.rotation.T + cone.centre
    assert np.abs(np.stack([cloud.min(0), cloud.max(0)]) - cone.bounds()).max() < 1e-4
    brick = box((0, 0, 1), (2, 1, 0.5), GREY, (0, 0, np.pi / 2))
    assert np.allclose(brick.bounds(), [[-0.5, -1, 0.75], [0.5, 1, 1.25]])
    both = extents([brick, cone])
    assert np.array_equal(both[1], np.maximum(brick.bounds()[1], cone.bounds()[1]))


def test_a_frustum_without_length_is_refused() -> None:
    with pytest.raises(GeometryError, match="two different ends"):
        frustum((1, 1, 1), (1, 1, 1), 0.1, GREY)


@pytest.mark.parametrize(
    ("make", "low", "high"),
    [
        (make_car, (4.0, 1.6, 1.3), (5.1, 2.0, 1.8)),
        (make_truck, (6.4, 2.1, 2.7), (9.0, 2.6, 3.7)),
        (make_cyclist, (1.5, 0.4, 1.5), (2.0, 0.8, 2.0)),
        (make_pedestrian, (0.4, 0.4, 1.4), (1.0, 0.8, 2.0)),
        (make_deer, (1.2, 0.3, 1.2), (2.0, 0.6, 1.8)),
        (make_barrel, (0.5, 0.5, 0.8), (0.8, 0.8, 1.1)),
        (make_sign, (0.5, 0.05, 2.0), (0.9, 0.2, 3.0)),
    ],
)
def test_shapes_have_the_size_of_what_they_show(
    make: Callable[[np.random.Generator], Shape],
    low: tuple[float, ...],
    high: tuple[float, ...],
) -> None:
    for seed in range(20):
        shape = make(np.random.default_rng(seed))
        size = np.array([shape.length_m, shape.width_m, shape.height_m])
        assert (size >= low).all(), size
        assert (size <= high).all(), size
        mesh = mesh_of_shape(shape)
        span = np.ptp(mesh.vertices, axis=0)
        assert (span <= size + 1e-9).all()
        assert (span >= 0.93 * size).all()


def test_mean_height_is_the_integral_of_the_profile() -> None:
    profile = make_profile(np.random.default_rng(4))
    places = np.array([-1000.3, -0.2, 0.0, 29.4, 31.0, 479.9, 480.1, 5000.7])
    for x, mean in zip(places, profile.mean_height(places, 1.5), strict=True):
        places_m = np.linspace(x - 1.5, x + 1.5, 20_001)
        area = np.trapezoid(profile.height(places_m), places_m)
        assert mean == pytest.approx(area / 3.0, abs=1e-6)
    period_m = len(profile.heights_m) * KNOT_SPACING_M
    assert np.allclose(profile.height(places), profile.height(places + period_m), atol=1e-9)


def test_twist_and_acceleration_integrate_to_the_motion() -> None:
    ego = EgoMotion(make_profile(np.random.default_rng(4)), 0)
    times_s = np.arange(0, 10, 0.001)
    poses = ego.poses(times_s)
    assert np.abs(poses[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1) - np.eye(3)).max() < 1e-12
    velocity, turning = ego.twist(times_s)
    velocity_map = np.einsum("nij,nj->ni", poses[:, :3, :3], velocity)
    walked = np.cumsum(velocity_map[:-1] + velocity_map[1:], axis=0) * 0.0005
    assert np.abs(walked - (poses[1:, :3, 3] - poses[0, :3, 3])).max() < 1e-5
    heading = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    assert np.abs(np.gradient(heading, times_s) - turning[:, 2])[5:-5].max() < 2e-3
    acceleration = ego.acceleration_map(times_s, np.zeros(3))
    assert (
        np.abs(
            np.cumsum(acceleration, axis=0)[-1] * 0.001 - np.diff(velocity_map[[0, -1]], axis=0)
        ).max()
        < 0.02
    )
    assert np.abs(acceleration).max() < 3.0


def test_local_frame_agrees_with_the_radii_of_curvature() -> None:
    frame = LocalFrame(43.7822, -79.4661, 160.0)
    assert np.allclose(frame.geodetic(np.zeros(3)), (43.7822, -79.4661, 160.0), atol=1e-9)
    sine2 = np.sin(np.radians(43.7822)) ** 2
    e2 = 0.00669437999014
    across = 6378137.0 / np.sqrt(1 - e2 * sine2)
    along = 6378137.0 * (1 - e2) / (1 - e2 * sine2) ** 1.5
    latitude, longitude, altitude = frame.geodetic(np.array([0.0, 10.0, 2.0]))
    assert np.radians(latitude - 43.7822) * (along + 160) == pytest.approx(10.0, abs=1e-4)
    assert altitude == pytest.approx(162.0, abs=1e-4)
    latitude, longitude, _ = frame.geodetic(np.array([10.0, 0.0, 0.0]))
    east = np.radians(longitude + 79.4661) * (across + 160) * np.cos(np.radians(43.7822))
    assert east == pytest.approx(10.0, abs=1e-4)


def test_signals_follow_the_timing_rules() -> None:
    times_s = np.arange(0, 200, 0.01)
    for block in range(12):
        plan = draw_plan(np.random.default_rng(block), block)
        states = [plan.at(float(t)) for t in times_s]
        if plan.flash is not None:
            lit = np.array([s.lit for s in states])
            starts = times_s[1:][np.diff(lit.astype(int)) == 1]
            per_minute = 60 / np.diff(starts).mean()
            assert 50 <= per_minute <= 60
            assert 1 / 2 <= lit.mean() <= 2 / 3
            assert {s.colour for s in states} == {plan.flash}
            continue
        colours = [s.colour for s in states]
        changes = {(a, b) for a, b in pairwise(colours) if a != b}
        assert changes == {("green", "yellow"), ("yellow", "red"), ("red", "green")}
        assert 3.0 <= plan.yellow_s <= 6.0
        assert all(s.lit and not s.flashing for s in states)


def test_a_plan_starts_where_its_offset_says() -> None:
    plan = SignalPlan(9.0, 10.0, 4.0, 10.0)
    assert [plan.at(t).colour for t in (0.0, 0.9, 1.1, 4.9, 5.1, 14.9, 15.1)] == [
        "green", "green", "yellow", "yellow", "red", "red", "green",
    ]  # fmt: skip


@pytest.mark.parametrize("seed", range(8))
def test_nothing_on_the_street_overlaps(seed: int) -> None:
    """Boxes of still and moving objects stay apart, at several times and places."""
    world = World.from_seed(seed)
    for time_s, x_m in ((0.0, 20.0), (9.0, 92.0), (31.0, 268.0)):
        found = [
            o for o in world.objects(time_s, x_m, 100.0) if o.shape.label not in ("tree", "pole")
        ]
        ego_x, ego_y = EgoMotion(world.profile, 0).poses(np.array([time_s]))[0, :2, 3]
        boxes = []
        for placed in found:
            cos, sin = abs(np.cos(placed.yaw_rad)), abs(np.sin(placed.yaw_rad))
            half_x = (placed.shape.length_m * cos + placed.shape.width_m * sin) / 2
            half_y = (placed.shape.length_m * sin + placed.shape.width_m * cos) / 2
            x = placed.x_at(time_s)
            boxes.append((x - half_x, x + half_x, placed.y_m - half_y, placed.y_m + half_y))
        for left, right, low, high in boxes:
            assert right < ego_x - 1.0 or left > ego_x + 3.9 or high < ego_y - 1 or low > ego_y + 1
        for i, a in enumerate(boxes):
            for j, b in enumerate(boxes[:i]):
                apart = a[1] < b[0] or b[1] < a[0] or a[3] < b[2] or b[3] < a[2]
                assert apart, (found[i].shape.label, found[j].shape.label, a, b)


def test_ids_are_unique_and_lasting() -> None:
    world = World.from_seed(2)
    now = {o.object_id: o for o in world.objects(0.0, 20.0, 100.0)}
    assert len(now) == len(world.objects(0.0, 20.0, 100.0))
    later = {o.object_id: o for o in world.objects(1.0, 28.0, 100.0)}
    assert len(set(now) & set(later)) > 100
    slot_objects.cache_clear()
    block_at.cache_clear()
    again = {o.object_id: o for o in world.objects(0.0, 20.0, 100.0)}
    assert list(again) == list(now)
    assert all(
        again[k].x_m == now[k].x_m and again[k].shape.label == now[k].shape.label for k in now
    )
    belts = {k // 10**9 for k in now} - {0}
    assert len(belts) >= 8
    assert belts <= {c.number for c in CONVEYORS}


def test_the_mesh_shows_lamps_paint_and_ground() -> None:
    world = World.from_seed(0)
    lit = [street_mesh(world, t, 60.0, 80.0) for t in (0.0, 1000.0)]
    assert all(mesh.emission.max() == 1.0 for mesh in lit)
    mesh = lit[0]
    paint = mesh.layer == 1
    corners = mesh.vertices[mesh.faces[paint]].reshape(-1, 3)
    on_road = np.abs(corners[:, 1]) < 8
    assert on_road.sum() > 100
    assert np.abs(corners[on_road, 2] - world.profile.height(corners[on_road, 0])).max() < 1e-9
