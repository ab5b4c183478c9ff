"""Made roads whose map is wrong in known places: what is found, and what is not."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import made_paint as made
import numpy as np
import pytest
from made_paint import LOUD, MEDIUM, QUIET, Noise, World, drive, made_world
from numpy.typing import NDArray
from paint_changes import (
    LINE_KINDS,
    STOP_KINDS,
    Change,
    Score,
    changed,
    is_about,
    kinds,
    rigidly,
    score,
    turned_ways,
    validated,
    with_ways,
    without,
)

from percept.core.map_findings import Kind
from percept.core.results import Verdict
from percept.hdmap.validate import Validation, validate_lanes

_NOISES = {"quiet": QUIET, "medium": MEDIUM, "loud": LOUD}
_LENGTH_M = 480.0
_CHANGES = 13
_PLANTED = {*LINE_KINDS, *STOP_KINDS}
_SEEDS = (0, 1)
_LATER_NS = 10**12
_drive_by = partial(drive, first_m=45.0, last_m=185.0)  # along the ways 1010 to 1014
_FRESH_SEEDS = range(100, 120)  # no setting was ever looked at with these
# Measured: 1.00, 0.95 and 0.87 for the worst kind, lines that the map lacks.
_LEAST_F1 = {"quiet": 0.95, "medium": 0.9, "loud": 0.8}
_MOST_FALSE_PER_KM = {"quiet": 0.2, "medium": 0.2, "loud": 1.5}

_Runs = list[tuple[list[Change], Validation]]


def _world(seed: int) -> tuple[World, list[Change]]:
    """Return a road, straight and bent in turn, and where its map is wrong."""
    return changed(made_world(_LENGTH_M, 0.008 * (seed % 2)), seed, _CHANGES)


def _runs(noise: Noise, seeds: Iterable[int]) -> _Runs:
    runs = []
    for seed in seeds:
        world, changes = _world(seed)
        runs.append((changes, validated(world, drive(world, noise, seed))))
    return runs


@pytest.fixture(scope="module")
def medium() -> _Runs:
    return _runs(MEDIUM, _SEEDS)


@pytest.fixture(scope="module")
def loud() -> _Runs:
    return _runs(LOUD, _SEEDS)


def _scores(runs: _Runs) -> dict[Kind, Score]:
    total = {kind: Score() for kind in Kind}
    for changes, result in runs:
        for kind, one in score(changes, result).items():
            total[kind].add(one)
    return total


def _told_and_right(runs: _Runs) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return of each finding its confidence, and whether it was planted."""
    found = [(f, changes) for changes, result in runs for f in result.discrepancies]
    told = np.array([finding.confidence for finding, _ in found])
    right = [any(is_about(change, finding) for change in changes) for finding, changes in found]
    return told, np.array(right)


def test_planted_changes_are_found(medium: _Runs, loud: _Runs) -> None:
    """Nothing else is found; where paint is hard to see, one of 26 may be missed."""
    for runs, most_lost in ((medium, 0), (loud, 1)):
        total = _scores(runs)
        assert {kind for kind in Kind if total[kind].found} == _PLANTED
        assert {kind: one for kind, one in total.items() if one.false} == {}
        assert sum(one.lost for one in total.values()) <= most_lost
        planted = sum(len(changes) for changes, _ in runs)
        assert sum(one.found for one in total.values()) > 0.85 * planted


@pytest.mark.slow  # 20 drives: half a minute for each noise
@pytest.mark.parametrize("noise", _NOISES)
def test_planted_changes_are_found_in_worlds_that_nothing_was_tuned_on(noise: str) -> None:
    runs = _runs(_NOISES[noise], _FRESH_SEEDS)
    total = _scores(runs)
    least = _LEAST_F1[noise]
    assert {kind: total[kind] for kind in _PLANTED if total[kind].f1 < least} == {}
    assert sum(total[kind].false for kind in set(Kind) - _PLANTED) <= 1
    told, right = _told_and_right(runs)
    assert right[told >= 0.85].mean() >= 0.95
    assert right.mean() >= told.mean() - 0.05


def test_findings_are_right_at_least_as_often_as_their_confidence_says(
    medium: _Runs, loud: _Runs
) -> None:
    told, right = _told_and_right([*medium, *loud])
    assert (told >= 0.85).sum() > 20
    assert right[told >= 0.85].mean() >= 0.95
    assert right.mean() >= told.mean() - 0.05


def test_names_of_findings_are_all_different_and_the_surest_comes_first(loud: _Runs) -> None:
    for _, result in loud:
        names = [finding.finding_id for finding in result.discrepancies]
        assert len(set(names)) == len(names)
        confidences = [finding.confidence for finding in result.discrepancies]
        assert confidences == sorted(confidences, reverse=True)


def test_sizes_and_stretches_of_findings_are_those_that_were_planted(medium: _Runs) -> None:
    sizes, lengths = 0, 0
    for changes, result in medium:
        by_element = {(f.kind, f.map_element_id): f for f in result.discrepancies}
        for change in changes:
            finding = by_element.get((change.kind, change.element_id))
            if change.kind in (Kind.MOVED, Kind.STOP_LINE_MOVED):
                assert finding is not None
                bound = 0.06 if change.kind is Kind.MOVED else 0.15
                assert finding.offset_m == pytest.approx(change.size_m, abs=bound)
                assert abs(finding.offset_m - change.size_m) < 3 * finding.sd_m < 0.5
                sizes += 1
            elif change.kind is Kind.MISSING_ON_ROAD:
                assert finding is not None
                assert 0.85 * change.length_m < finding.length_m < change.length_m + 10.0
                assert finding.looks
                lengths += 1
    assert sizes >= 5
    assert lengths >= 3


@pytest.mark.parametrize("bend", [0.0, 0.008])
def test_a_map_that_is_right_gives_no_finding(bend: float) -> None:
    world = made_world(300.0, bend)
    result = validated(world, drive(world, MEDIUM, 51))
    assert result.verdict is Verdict.GOOD, result.why
    assert result.discrepancies == ()


@pytest.mark.slow  # 20 drives: half a minute for each noise
@pytest.mark.parametrize("noise", _NOISES)
def test_a_map_that_is_right_gives_few_findings_on_many_roads(noise: str) -> None:
    """Measured: none with quiet and medium noise, and with loud noise 1.1 in a kilometre."""
    count = 0
    for seed in _FRESH_SEEDS:
        world = made_world(_LENGTH_M, 0.008 * (seed % 2))
        count += len(validated(world, drive(world, _NOISES[noise], seed + 1000)).discrepancies)
    assert count <= _MOST_FALSE_PER_KM[noise] * len(_FRESH_SEEDS) * _LENGTH_M / 1000.0


@pytest.mark.parametrize(
    ("bend", "offset"), [(0.0, (0.0, 0.5)), (0.008, (0.5, 0.0)), (0.008, (-0.35, 0.35))]
)
def test_an_offset_of_the_whole_map_is_one_finding(
    bend: float, offset: tuple[float, float]
) -> None:
    world = made_world(300.0, bend)
    noise = replace(MEDIUM, pose_drift_m=0.03, pose_constant_m=offset)
    (found,) = validated(world, drive(world, noise, 3)).discrepancies
    assert found.kind is Kind.GLOBAL_OFFSET
    shift = (found.points_map - found.points_expected_map)[:, :2].mean(axis=0)
    np.testing.assert_allclose(shift, offset, atol=0.15)
    assert found.confidence > 0.8


def test_changes_are_found_beside_an_offset_of_the_whole_map() -> None:
    world, changes = changed(made_world(_LENGTH_M), 5, _CHANGES)
    noise = replace(MEDIUM, pose_drift_m=0.03, pose_constant_m=(0.0, 0.5))
    result = validated(world, drive(world, noise, 5))
    assert [f.kind for f in result.discrepancies].count(Kind.GLOBAL_OFFSET) == 1
    total = score(changes, result)
    assert sum(one.found for one in total.values()) >= len(changes) - 1
    assert sum(one.false for one in total.values()) == 1  # the offset itself


def test_an_offset_along_a_straight_road_without_stop_lines_is_said_not_to_be_observable() -> None:
    world = made_world(170.0)
    bare = replace(world, road=replace(world.road, stops={}))
    bare = replace(bare, markings=made.map_of(bare.road))
    along = replace(QUIET, pose_constant_m=(0.5, 0.0))
    assert validated(bare, drive(bare, along, 1)).discrepancies == ()
    both = replace(QUIET, pose_constant_m=(0.5, 0.4))
    (found,) = validated(bare, drive(bare, both, 1)).discrepancies
    assert found.offset_m == pytest.approx(0.4, abs=0.05)
    assert "cannot be observed" in found.observed


def test_a_sensor_that_is_mounted_askew_is_told_from_an_offset_of_the_map() -> None:
    world = made_world(170.0)
    there = drive(world, replace(QUIET, pose_constant_m=(0.0, 0.4)), 1)
    other = replace(QUIET, pose_constant_m=(0.0, -0.4))
    back = drive(world, other, 2, backward=True, start_ns=_LATER_NS)
    (found,) = validated(world, there, back).discrepancies
    assert found.kind is Kind.GLOBAL_OFFSET
    assert "whichever way the vehicle heads" in found.observed


def test_slow_drift_is_a_note_and_no_finding() -> None:
    world = made_world(400.0)
    result = validated(world, drive(world, replace(MEDIUM, pose_drift_m=0.3), 7))
    assert [f for f in result.discrepancies if f.kind is not Kind.GLOBAL_OFFSET] == []
    assert np.ptp([offset.lateral_m for offset in result.offsets]) > 0.3
    assert "findings are relative to that" in result.notes[0]


def test_the_shift_is_that_of_the_poses() -> None:
    world = made_world(300.0, 0.008)
    noise = replace(MEDIUM, pose_drift_m=0.0, pose_drift_deg=0.0, pose_constant_m=(0.0, 0.4))
    result = validated(world, drive(world, noise, 7))
    assert len(result.offsets) > 20
    for offset in result.offsets[1:]:
        assert offset.lateral_m == pytest.approx(0.4 * math.cos(offset.yaw_rad), abs=0.12)
        assert abs(offset.heading_rad) < math.radians(0.3)


def test_lines_behind_a_truck_are_not_observed_and_not_missing() -> None:
    world = made_world(250.0)
    far = [ident for ident in world.road.ways if ident % 10 >= 3]
    result = validated(world, _drive_by(without(world, *far), MEDIUM, 1, hidden=7.5))
    assert result.discrepancies == ()
    rows = [row for row in result.coverage if row.map_element_id in far]
    assert any(row.reason == "occluded" for row in rows)
    assert all(row.observed_share == 0 for row in rows)


def test_lines_in_the_dark_are_not_observed() -> None:
    world = made_world(300.0)
    unlit = [ident for ident in world.road.ways if 1010 <= ident < 1020]
    result = validated(world, drive(without(world, *unlit), MEDIUM, 1, dark=(50.0, 165.0)))
    assert not [f for f in result.discrepancies if f.map_element_id in unlit]
    rows = [row for row in result.coverage if row.map_element_id == 1011]
    assert any(row.reason == "too dark" for row in rows)
    assert sum(row.observed_share for row in rows) < 0.5 * len(rows)


def test_a_line_that_moved_further_than_the_gate_is_told_to_be_perhaps_the_same() -> None:
    world = made_world(250.0)
    far = made.moved_aside(world.road.ways[1010].points, 1.6)
    ways = world.road.ways | {1010: replace(world.road.ways[1010], points=far)}
    result = validated(world, _drive_by(with_ways(world, ways), QUIET, 1))
    assert sorted(f.kind for f in result.discrepancies) == [
        Kind.MISSING_IN_MAP,
        Kind.MISSING_ON_ROAD,
    ]
    (extra,) = [f for f in result.discrepancies if f.kind is Kind.MISSING_IN_MAP]
    assert "perhaps line 1010" in extra.observed


def test_paint_along_a_border_that_the_map_calls_unpainted_is_missing_in_the_map() -> None:
    world = made_world(250.0)
    markings = tuple(
        replace(m, painted=False, type="unknown", colour="unknown") if m.element_id == 1010 else m
        for m in world.markings
    )
    (found,) = validated(
        replace(world, markings=markings), _drive_by(world, MEDIUM, 1)
    ).discrepancies
    assert (found.kind, found.map_element_id) == (Kind.MISSING_IN_MAP, 1010)
    assert "solid white line" in found.observed


def test_a_lane_whose_two_lines_moved_a_little_is_wider() -> None:
    world = made_world(250.0)
    ways = dict(world.road.ways)
    for ident, aside in ((1010, -0.22), (1011, 0.22)):
        ways[ident] = replace(ways[ident], points=made.moved_aside(ways[ident].points, aside))
    (found,) = validated(world, _drive_by(with_ways(world, ways), QUIET, 1)).discrepancies
    assert found.kind is Kind.LANE_WIDTH
    assert found.offset_m == pytest.approx(0.44, abs=0.08)
    assert "lanelet 5010" in found.expected


def test_the_way_a_line_is_drawn_only_turns_the_signs(medium: _Runs) -> None:
    world, _ = _world(1)
    _, straight = medium[1]
    turned = validated(turned_ways(world), drive(world, MEDIUM, 1))
    assert kinds(turned) == kinds(straight)
    by_element = {(f.kind, f.map_element_id): f for f in straight.discrepancies}
    moved = [finding for finding in turned.discrepancies if finding.kind is Kind.MOVED]
    assert moved
    for finding in moved:
        before = by_element[finding.kind, finding.map_element_id].offset_m
        sign = -1 if finding.map_element_id % 2 else 1
        assert finding.offset_m == pytest.approx(sign * before, abs=0.03)


def test_moving_map_and_poses_together_changes_nothing(medium: _Runs) -> None:
    world, _ = _world(1)
    poses, looks = drive(world, MEDIUM, 1)
    _, before = medium[1]
    T = np.eye(4)
    T[:2, :2] = [[math.cos(1.1), -math.sin(1.1)], [math.sin(1.1), math.cos(1.1)]]
    T[:3, 3] = 81_234.5, 43_210.9, 42.0
    elsewhere, moved = rigidly(world, poses, T)
    after = validated(elsewhere, (moved, looks))
    assert kinds(after) == kinds(before)
    for one, other in zip(before.discrepancies, after.discrepancies, strict=True):
        assert other.confidence == pytest.approx(one.confidence, abs=1e-3)
        assert other.length_m == pytest.approx(one.length_m, abs=1e-3)
        placed = one.points_map @ T[:3, :3].T + T[:3, 3]
        np.testing.assert_allclose(other.points_map, placed, atol=1e-3)


def test_a_border_that_is_drawn_twice_is_not_missing() -> None:
    world = made_world(200.0)
    twin = replace(world.markings[6], element_id=77)
    twice = SimpleNamespace(markings=(*world.markings, twin), lanelets=world.lanelets)
    result = validate_lanes(twice, [("drive", *drive(world, MEDIUM, 0))])
    assert result.discrepancies == ()


def test_paint_on_a_crosswalk_is_no_line_and_no_stop_line() -> None:
    world = made_world(200.0)
    across = np.array([[115.0, -7.0, 0.0], [115.0, 0.0, 0.0]])
    ways = dict(world.road.ways)
    for number, y in enumerate((-6.0, -5.0, -4.0)):
        stripe = np.array([[113.5, y, 0.0], [116.5, y, 0.0]])
        ways[7000 + number] = made.Way(7000 + number, stripe, "solid", "white")
    stops = world.road.stops | {7010: across}
    painted = replace(world, road=replace(world.road, ways=ways, stops=stops))
    crosswalk = replace(world.markings[0], element_id=77, kind="crosswalk", points_map=across)
    right = replace(painted, markings=(*world.markings, crosswalk))
    result = validated(right, _drive_by(painted, QUIET, 1))
    assert result.discrepancies == ()
    assert result.dropped["strokes on crosswalks"] > 20
    assert result.dropped["bars on crosswalks"] >= 3
    (found,) = validated(painted, _drive_by(painted, QUIET, 1)).discrepancies
    assert found.kind is Kind.STOP_LINE_MISSING_IN_MAP


def test_a_line_askew_is_trusted_less_than_one_along_the_lane() -> None:
    world = made_world(200.0)
    trust = []
    for aside in (0.0, 2.0):
        points = np.array([[100.0, -5.9, 0.0], [120.0, -5.9 + aside, 0.0]])
        ways = world.road.ways | {7000: made.Way(7000, points, "solid", "white")}
        (found,) = validated(world, _drive_by(with_ways(world, ways), QUIET, 1)).discrepancies
        assert found.kind is Kind.MISSING_IN_MAP
        trust.append(found.confidence)
    assert trust[0] > 0.8
    assert trust[1] < 0.5 * trust[0]


def test_which_of_two_lines_moved_cannot_be_told_from_the_two_alone() -> None:
    world = made_world(200.0)
    markings = tuple(m for m in world.markings if m.element_id % 10 < 2 or m.kind != "line")
    ways = {k: way for k, way in world.road.ways.items() if k % 10 < 2}
    ways[1010] = replace(ways[1010], points=made.moved_aside(ways[1010].points, 0.6))
    two = replace(with_ways(world, ways), markings=markings)
    result = validated(two, drive(two, QUIET, 1))
    assert {f.kind for f in result.discrepancies} == {Kind.MOVED}
    assert any("or the other lines moved" in f.observed for f in result.discrepancies)
    assert all(f.confidence <= 0.6 for f in result.discrepancies)
