"""The graph of a rig: trees, round trips and the adjustment, against known worlds."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.lidars.rig_graph import (
    PairEdge,
    adjust_poses,
    closing_loops,
    culprit,
    maximum_spanning_tree,
    place_along,
    relative_motion,
)
from percept.calib.limits import LidarLimits

Matrix = NDArray[np.float64]

_SD = np.array([1e-3, 1e-3, 2e-3, 0.003, 0.004, 0.005])
_NAMES = ("top", "left", "right", "bottom")


def _pose(motion: Any) -> Matrix:
    """Return the transform of a rotation vector (rad) and a translation."""
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(motion[:3]).as_matrix()
    matrix[:3, 3] = motion[3:]
    return matrix


def _world(rng: np.random.Generator) -> dict[str, Matrix]:
    others = {name: _pose(rng.normal(size=6)) for name in _NAMES[1:]}
    return {"top": np.eye(4), **others}


def _noisy(T_a_b: Matrix, error: Any) -> Matrix:
    moved = T_a_b.copy()
    moved[:3, :3] = _pose([*error[:3], 0, 0, 0])[:3, :3] @ T_a_b[:3, :3]
    moved[:3, 3] += error[3:]
    return moved


def _edge(
    world: dict[str, Matrix], target: str, source: str, error: Any = None, overlap: float = 0.5
) -> PairEdge:
    T_target_source = np.linalg.inv(world[target]) @ world[source]
    noisy = _noisy(T_target_source, np.zeros(6) if error is None else error)
    return PairEdge(target, source, noisy, np.diag(_SD**2), overlap)


def test_the_tree_takes_the_weightiest_edges_and_paths_follow_it() -> None:
    world = _world(np.random.default_rng(0))
    edges = [
        _edge(world, "top", "left", overlap=0.9),
        _edge(world, "right", "bottom", overlap=0.1),
        _edge(world, "bottom", "left", overlap=0.8),  # turned against the path
        _edge(world, "top", "right", overlap=0.3),
    ]
    tree = maximum_spanning_tree(edges, "top")
    assert {edge.name for edge in tree} == {"top-left", "bottom-left", "top-right"}
    placed = place_along(tree, "top")
    assert placed["bottom"].path == ("top", "left", "bottom")
    for name in _NAMES:
        assert np.allclose(placed[name].T_root_sensor, world[name], atol=1e-12)


def test_what_the_root_sees_is_placed_by_that() -> None:
    world = _world(np.random.default_rng(0))
    pairs = list(combinations(_NAMES, 2))
    edges = [_edge(world, a, b, overlap=0.1 if a == "top" else 0.9) for a, b in pairs]
    assert {edge.target for edge in maximum_spanning_tree(edges, "top")} == {"top"}


def test_a_doubtful_edge_is_taken_only_where_there_is_no_other() -> None:
    world = _world(np.random.default_rng(0))
    direct = replace(_edge(world, "top", "left", overlap=0.9), trusted=False)
    around = [_edge(world, "top", "right"), _edge(world, "left", "right", overlap=0.1)]
    assert direct not in maximum_spanning_tree([direct, *around], "top")
    assert direct in maximum_spanning_tree([direct, around[0]], "top")


def test_a_sensor_that_no_edge_reaches_has_no_place() -> None:
    world = _world(np.random.default_rng(1))
    edges = [_edge(world, "top", "left"), _edge(world, "right", "bottom")]
    assert set(place_along(maximum_spanning_tree(edges, "top"), "top")) == {"top", "left"}
    assert not closing_loops(edges, "top", LidarLimits())


def test_reversing_twice_changes_nothing_and_covariances_add_up() -> None:
    edge = _edge(_world(np.random.default_rng(2)), "left", "right")
    again = edge.reversed().reversed()
    assert np.allclose(again.T_target_source, edge.T_target_source, atol=1e-12)
    assert np.allclose(again.covariance, edge.covariance, atol=1e-15)


def test_the_covariance_along_a_path_is_that_of_the_errors() -> None:
    rng = np.random.default_rng(3)
    world = _world(rng)
    motions = []
    for _ in range(3000):
        errors = rng.normal(size=(2, 6)) * _SD
        chain = [
            _edge(world, "left", "top", errors[0]),
            _edge(world, "left", "bottom", errors[1]),
        ]
        found = place_along(chain, "top")["bottom"].T_root_sensor
        motions.append(relative_motion(world["bottom"], found))
    exact = [_edge(world, "left", "top"), _edge(world, "left", "bottom")]
    stated = place_along(exact, "top")["bottom"].covariance
    assert np.std(motions, axis=0) == pytest.approx(np.sqrt(np.diag(stated)), rel=0.06)


def test_round_trips_close_without_errors_and_tell_an_error_with_them() -> None:
    world = _world(np.random.default_rng(4))
    pairs = [_edge(world, a, b) for a, b in combinations(_NAMES, 2)]
    loops = closing_loops(pairs, "top", LidarLimits())
    assert len(loops) == 3
    assert all(loop.path[0] == loop.path[-1] == "top" for loop, _ in loops)
    assert max(loop.translation_m for loop, _ in loops) < 1e-12
    assert all(loop.agrees for loop, _ in loops)
    pairs[-1] = _edge(world, "right", "bottom", [0, 0, 0.02, 0.04, 0, 0])
    wrong = [loop for loop, edges in closing_loops(pairs, "top", LidarLimits()) if not loop.agrees]
    assert wrong
    assert wrong[0].rotation_deg == pytest.approx(np.degrees(0.02), rel=1e-6)
    assert wrong[0].surprise > 3


def test_loops_are_as_surprising_as_their_noise() -> None:
    rng = np.random.default_rng(5)
    world = _world(rng)
    surprises = []
    for _ in range(400):
        pairs = combinations(_NAMES[:3], 2)
        edges = [_edge(world, a, b, rng.normal(size=6) * _SD) for a, b in pairs]
        ((loop, _),) = closing_loops(edges, "top", LidarLimits())
        surprises.append(loop.surprise)
    assert np.sqrt(np.mean(np.square(surprises))) == pytest.approx(1.0, rel=0.05)


def test_the_wrong_registration_is_named_where_the_others_can_check_it() -> None:
    world = _world(np.random.default_rng(6))
    edges = [_edge(world, a, b) for a, b in combinations(_NAMES, 2)]
    edges[3] = _edge(world, "left", "right", [0, 0, np.pi / 2, 0, 0, 0])
    assert culprit(edges, "top", LidarLimits()) is edges[3]
    triangle = [e for e in edges if "bottom" not in (e.target, e.source)]
    assert culprit(triangle, "top", LidarLimits()) is None


def test_the_adjustment_is_better_than_the_tree_and_knows_its_spread() -> None:
    rng = np.random.default_rng(7)
    world = _world(rng)
    errors: dict[str, list[Any]] = {"tree": [], "adjusted": [], "normalised": []}
    for _ in range(200):
        edges = [_edge(world, a, b, rng.normal(size=6) * _SD) for a, b in combinations(_NAMES, 2)]
        tree = place_along(maximum_spanning_tree(edges, "top"), "top")
        start = {name: placement.T_root_sensor for name, placement in tree.items()}
        found = adjust_poses(edges, start, "top")
        for name in _NAMES[1:]:
            error = relative_motion(world[name], found.T_root_sensor[name])
            errors["tree"].append(relative_motion(world[name], start[name]))
            errors["adjusted"].append(error)
            sd = np.sqrt(np.diag(found.covariance[name]))
            errors["normalised"].append(error / sd)
    rms = {key: np.sqrt(np.mean(np.square(values), axis=0)) for key, values in errors.items()}
    assert (rms["adjusted"] < 0.9 * rms["tree"]).all()
    # Six registrations of three sensors: the root of a half, as if they were no more than three.
    assert rms["normalised"] == pytest.approx(np.full(6, 0.68), abs=0.1)


def test_errors_of_clouds_are_covered_although_all_round_trips_close() -> None:
    rng = np.random.default_rng(10)
    world = {name: np.eye(4) for name in _NAMES}
    in_sd = []
    for _ in range(300):
        own = {name: rng.normal(size=6) * _SD / np.sqrt(2) for name in _NAMES}
        edges = [_edge(world, a, b, own[b] - own[a]) for a, b in combinations(_NAMES, 2)]
        found = adjust_poses(edges, world, "top")
        for name in _NAMES[1:]:
            error = relative_motion(world[name], found.T_root_sensor[name])
            in_sd.append(error / np.sqrt(np.diag(found.covariance[name])))
    assert np.sqrt(np.mean(np.square(in_sd), axis=0)) == pytest.approx(np.ones(6), abs=0.15)


def test_exact_edges_give_the_exact_rig_from_a_bad_start() -> None:
    rng = np.random.default_rng(8)
    world = _world(rng)
    edges = [_edge(world, a, b) for a, b in combinations(_NAMES, 2)]
    start = {n: _noisy(pose, 0.1 * rng.normal(size=6)) for n, pose in world.items()}
    start["top"] = np.eye(4)
    found = adjust_poses(edges, start, "top")
    for name in _NAMES[1:]:
        assert np.allclose(found.T_root_sensor[name], world[name], atol=1e-8)
    assert found.surprise < 1e-6


def test_registrations_that_disagree_widen_the_spread() -> None:
    world = _world(np.random.default_rng(9))
    edges = [_edge(world, a, b) for a, b in combinations(_NAMES[:3], 2)]
    start = {name: world[name] for name in _NAMES[:3]}
    calm = adjust_poses(edges, start, "top")
    edges[0] = _edge(world, "top", "left", [0, 0, 0.02, 0, 0, 0])
    torn = adjust_poses(edges, start, "top")
    assert torn.surprise > 3
    assert (np.diag(torn.covariance["left"]) > 9 * np.diag(calm.covariance["left"])).all()
