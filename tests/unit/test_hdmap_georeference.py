"""Where maps lie on the earth: grids, origins, points known one way only, drives far away."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_osm import node, way, write_osm
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.geodesy import LocalFrame
from percept.core.trajectory import Trajectory
from percept.hdmap import Georeference, check_on_map, load_map
from percept.hdmap.georeference import fit_georeference
from percept.hdmap.transverse_mercator import TransverseMercator, georeference_of_grid

F64 = NDArray[np.float64]
CORNER = (35.9, 139.93)  # UTM zone 54, 1.07 degrees west of its meridian
UTM = TransverseMercator.utm(54)
SQUARE = np.floor(UTM.grid(np.array([CORNER]))[0] / 100e3) * 100e3


def places(reach_m: float, count: int = 40) -> F64:
    """Return latitudes, longitudes and altitudes (N, 3) of random places about `CORNER`."""
    rng = np.random.default_rng(3)
    local = np.column_stack([rng.uniform(-reach_m, reach_m, (count, 2)), rng.uniform(0, 30, count)])
    geodetic = LocalFrame(*CORNER, 0.0).geodetics(local)
    geodetic[:, 2] = local[:, 2]
    return geodetic


def grid_node(identity: int, geodetic: F64, *, local: bool = True) -> str:
    x, y = (UTM.grid(geodetic[None])[0] - SQUARE).tolist()
    lat, lon, ele = geodetic.tolist()
    text = node(identity, x, y, ele).replace('lat="" lon=""', f'lat="{lat!r}" lon="{lon!r}"')
    return text if local else text.replace("local_", "far_")


@pytest.mark.parametrize("reach_m", [20.0, 500.0, 5000.0])
def test_a_map_in_a_square_of_the_grid(reach_m: float) -> None:
    geodetic = places(reach_m)
    points = np.column_stack([UTM.grid(geodetic) - SQUARE, geodetic[:, 2]])
    found = fit_georeference(points, geodetic)
    assert found is not None
    assert found.residual_m < 2e-3
    assert found.points == len(points)
    # The third degree of the grid is left out: 1 mm where it matters.
    np.testing.assert_allclose(found.map_points(geodetic), points, atol=4e-3)
    assert found.scale == pytest.approx(0.99971, abs=2e-5)
    # Convergence of meridians of a transverse Mercator: to first order dlon * sin(lat).
    assert np.degrees(found.rotation_rad) == pytest.approx(
        -1.07 * np.sin(np.radians(35.9)), abs=2e-3
    )


def test_points_go_there_and_back() -> None:
    geodetic = places(3000.0)
    found = georeference_of_grid(UTM, UTM.grid(geodetic))
    assert found is not None
    np.testing.assert_allclose(found.geodetic(found.map_points(geodetic)), geodetic, atol=1e-8)
    frame = Georeference.of_origin(LocalFrame(*CORNER, 12.0))
    np.testing.assert_allclose(frame.geodetic(frame.map_points(geodetic)), geodetic, atol=1e-8)


def test_a_point_that_was_moved_in_one_way_only_does_not_count() -> None:
    geodetic = places(100.0)
    points = np.column_stack([UTM.grid(geodetic) - SQUARE, geodetic[:, 2]])
    points[5] += 40.0
    found = fit_georeference(points, geodetic)
    assert found is not None
    assert found.points == len(points) - 1
    np.testing.assert_allclose(found.map_points(geodetic[:5]), points[:5], atol=1e-3)


@pytest.mark.parametrize(
    "change",
    [
        lambda points: points * [1.0, -1.0, 1.0],
        lambda points: points * 3.0,
        lambda points: np.random.default_rng(0).uniform(0, 100, points.shape),
        lambda points: np.full_like(points, np.nan),
    ],
)
def test_coordinates_that_do_not_go_together_say_nothing(change: object) -> None:
    geodetic = places(100.0)
    points = np.column_stack([UTM.grid(geodetic) - SQUARE, geodetic[:, 2]])
    assert callable(change)
    assert fit_georeference(change(points), geodetic) is None


def test_poses_from_north_and_east_come_into_the_grid() -> None:
    geodetic = places(800.0)
    found = fit_georeference(
        np.column_stack([UTM.grid(geodetic) - SQUARE, geodetic[:, 2]]), geodetic
    )
    assert found is not None
    # A drive east along a parallel; the base looks east, which is +x of the local frame.
    way_of = np.array([[CORNER[0], CORNER[1] + 1e-5 * k, 25.0] for k in range(30)])
    matrices = np.tile(np.eye(4), (30, 1, 1))
    matrices[:, :3, 3] = found.frame.local(way_of)
    drive = Trajectory("enu", "base_link", np.arange(30, dtype=np.int64), matrices)
    mapped = found.to_map(drive)
    assert (mapped.target, mapped.source) == ("map", "base_link")
    expected = UTM.grid(way_of) - SQUARE
    np.testing.assert_allclose(mapped.matrices[:, :2, 3], expected, atol=2e-3)
    np.testing.assert_allclose(mapped.matrices[:, 2, 3], 25.0, atol=1e-6)
    ahead = np.diff(expected, axis=0)
    yaw = np.arctan2(mapped.matrices[:-1, 1, 0], mapped.matrices[:-1, 0, 0])
    np.testing.assert_allclose(yaw, np.arctan2(ahead[:, 1], ahead[:, 0]), atol=2e-4)
    np.testing.assert_allclose(drive.matrices[:, :3, :3], np.tile(np.eye(3), (30, 1, 1)))


def test_a_map_with_a_grid_says_where_it_lies(tmp_path: Path) -> None:
    geodetic = places(60.0, 12)
    nodes = [grid_node(k + 1, place) for k, place in enumerate(geodetic)]
    street = load_map(write_osm(tmp_path / "map.osm", *nodes))
    assert street.origin is None
    assert street.georeference is not None
    np.testing.assert_allclose(
        street.georeference.geodetic(street.points.xyz_map), geodetic, atol=1e-8
    )


def test_points_without_local_coordinates_are_placed_as_the_others(tmp_path: Path) -> None:
    geodetic = places(60.0, 12)
    nodes = [grid_node(k + 1, place, local=k > 2) for k, place in enumerate(geodetic)]
    street = load_map(write_osm(tmp_path / "map.osm", *nodes))
    expected = UTM.grid(geodetic) - SQUARE
    np.testing.assert_allclose(street.points.xyz_map[:, :2], expected, atol=1e-3)
    assert [n for key, n in street.dropped.items() if "placed by latitude" in key] == [3]


def test_a_map_of_latitudes_alone_has_no_frame_unless_any_will_do(tmp_path: Path) -> None:
    nodes = [grid_node(k + 1, place, local=False) for k, place in enumerate(places(60.0, 12))]
    path = write_osm(tmp_path / "map.osm", *nodes)
    with pytest.raises(InputError, match="12 of 12 points have no local_x and local_y"):
        load_map(path)
    street = load_map(path, anywhere=True)
    assert street.origin is not None
    assert np.abs(street.points.xyz_map).max() < 100.0
    assert [n for key, n in street.dropped.items() if "about its own middle" in key] == [12]


def test_a_map_that_contradicts_itself_is_told_of(tmp_path: Path) -> None:
    nodes = [grid_node(k + 1, place) for k, place in enumerate(places(60.0, 12))]
    wrapped = [node.replace('"local_x" v="', '"local_x" v="9') for node in nodes[:6]] + nodes[6:]
    street = load_map(write_osm(tmp_path / "map.osm", *wrapped))
    assert street.georeference is None
    assert [n for key, n in street.dropped.items() if "do not go together" in key] == [12]


def test_an_origin_that_contradicts_the_points_is_told_of(tmp_path: Path) -> None:
    nodes = [grid_node(k + 1, place) for k, place in enumerate(places(60.0, 12))]
    meta = '<MetaInfo origin_lat="35.9" origin_lon="139.93" origin_ele="0"/>'
    street = load_map(write_osm(tmp_path / "map.osm", meta, *nodes))
    assert [n for key, n in street.dropped.items() if "by the map's own origin" in key] == [12]
    assert street.points.xyz_map[:, 0].min() > 1000.0


def test_points_without_any_coordinates_are_refused_wherever_they_may_lie(tmp_path: Path) -> None:
    nowhere = '<node id="1" lat="" lon=""/>'
    with pytest.raises(InputError, match="1 of 1 points have no local_x"):
        load_map(write_osm(tmp_path / "map.osm", nowhere), anywhere=True)
    grid = [grid_node(k + 2, place) for k, place in enumerate(places(60.0, 12))]
    with pytest.raises(InputError, match="node 1 has no latitude and longitude"):
        load_map(write_osm(tmp_path / "map.osm", nowhere, *grid))


def test_local_coordinates_alone_say_nothing_of_the_earth(tmp_path: Path) -> None:
    street = load_map(write_osm(tmp_path / "map.osm", node(1, 0, 0), node(2, 50, 0)))
    assert (street.origin, street.georeference) == (None, None)


def test_how_far_a_drive_is_from_the_map(tmp_path: Path) -> None:
    elements = (node(1, 0, 0), node(2, 100, 0), node(3, 100, 50), way(9, [1, 2, 3]))
    street = load_map(write_osm(tmp_path / "map.osm", *elements))
    points = np.array([[50.0, -30.0, 7.0], [100.0, 25.0, 0.0], [100.0, 90.0, 0.0]])
    np.testing.assert_allclose(street.distance_m(points), [30.0, 0.0, 40.0], atol=0.11)
    assert check_on_map(street, points + np.array([[5e3], [0.0], [5e3]]), "d") < 0.2
    with pytest.raises(InputError, match=r"^drive: is not on the map.*12\.0 km.*--origin"):
        check_on_map(street, points + np.array([12_050.0, 0, 0]), "drive")
    with pytest.raises(InputError, match="no nearer than 150 m"):
        check_on_map(street, np.array([[250.0, 25.0, 0.0]]), "drive")
    with pytest.raises(InputError, match="no positions"):
        check_on_map(street, np.zeros((0, 3)), "drive")
