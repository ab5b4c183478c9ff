"""Strokes on stations, the shift that most lines agree on, and places on lanes."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from percept.hdmap.elements import Lanelet, MapMarking
from percept.hdmap.validate.lanes import in_lanes
from percept.hdmap.validate.localise import ShiftFilter
from percept.hdmap.validate.match import match_strokes, nearest_only, vote
from percept.hdmap.validate.stations import Stations, cut_lines, usable_markings


def _marking(lateral_m: float, ident: int = 1, length_m: float = 20.0) -> MapMarking:
    points = np.array([[0.0, lateral_m, 0.0], [length_m, lateral_m, 0.0]])
    return MapMarking(
        element_id=ident, kind="line", points_map=points, type="solid", colour="white",
        painted=True, width_m=0.15, name="",
    )  # fmt: skip


@pytest.fixture
def stations() -> Stations:
    return cut_lines([_marking(0.0), _marking(3.5, 2)])


def test_a_line_is_cut_into_half_metres(stations: Stations) -> None:
    assert len(stations) == 80
    np.testing.assert_allclose(stations.points[:2, 0], [0.25, 0.75])
    np.testing.assert_allclose(stations.normals[0], [0, 1])
    assert [line.length_m for line in stations.lines] == [20.0, 20.0]


def test_markings_without_a_length_are_left_out_and_counted() -> None:
    dropped: Counter[str] = Counter()
    bent = MapMarking(
        element_id=3, kind="line", points_map=np.array([[0.0, 0, 0], [np.nan, 1, 0]]),
        type="solid", colour="white", painted=True, width_m=0.1, name="",
    )  # fmt: skip
    assert len(usable_markings([_marking(0.0), bent, _marking(0.0, length_m=0.0)], dropped)) == 1
    assert sum(dropped.values()) == 2


def test_a_stroke_votes_for_the_station_beside_it_with_its_offset(stations: Stations) -> None:
    points = np.array([[5.2, 0.3], [8.3, -0.2], [6.0, 0.0]])
    direction = np.array([0.0, np.pi / 2 - 0.01, np.pi])
    found = match_strokes(points, direction, stations, 1.0, 0.5)
    assert set(found.stroke.tolist()) == {0, 2}  # the second one lies across the line
    first = found[found.stroke == 0]
    assert first.station.tolist() == [10]
    np.testing.assert_allclose(first.offset_m, [0.3])


def test_a_stroke_between_two_lines_belongs_to_the_nearer_one(stations: Stations) -> None:
    found = match_strokes(np.array([[5.2, 1.6]]), np.zeros(1), stations, 2.0, 0.5)
    found = nearest_only(found, 1)
    assert set(stations.line[found.station].tolist()) == {0}


def test_two_strokes_beside_each_other_are_a_pair_about_their_middle(stations: Stations) -> None:
    points = np.array([[5.2, 0.2], [5.25, 0.44], [8.2, 0.3]])
    found = nearest_only(match_strokes(points, np.zeros(3), stations, 1.0, 0.5), 3, 0.3)
    votes = vote(found, np.full(3, 0.02), np.full(3, 0.12), np.array([1.0, np.nan, 0.0]), 0.5)
    assert votes.station.tolist() == [10, 16]
    np.testing.assert_allclose(votes.offset_m, [0.32, 0.3])
    np.testing.assert_allclose(votes.pair, [1.0, 0.0])
    np.testing.assert_allclose(votes.yellow, [1.0, 0.0])


def test_paint_further_off_than_the_line_itself_is_left_over(stations: Stations) -> None:
    points = np.array([[5.2, 0.0], [5.2, 0.8]])
    found = nearest_only(match_strokes(points, np.zeros(2), stations, 1.0, 0.5), 2)
    votes = vote(found, np.full(2, 0.02), np.full(2, 0.12), np.zeros(2), 0.5)
    np.testing.assert_allclose(votes.offset_m, [0.0])
    assert found.stroke[votes.used].tolist() == [0]


def _push(shifts: ShiftFilter, offsets: list[float], moved_m: float = 1.0) -> float:
    offset = np.repeat(offsets, 20)
    line = np.repeat(np.arange(len(offsets)), 20)
    ones = np.ones(len(offset))
    return shifts.push(moved_m, offset, ones, line, 0.01 * ones).lateral_m


def test_the_shift_is_that_of_most_lines() -> None:
    shifts = ShiftFilter(20.0, 0.5)
    assert _push(shifts, [0.5, 0.5, -0.2]) == pytest.approx(0.5, abs=0.02)
    assert shifts.shift.heading_rad == pytest.approx(0.01)
    assert not shifts.shift.ambiguous


def test_a_line_that_is_moved_for_long_does_not_draw_the_shift_to_itself() -> None:
    shifts = ShiftFilter(20.0, 0.5)
    for _ in range(50):
        _push(shifts, [0.0, 0.0])
    for _ in range(200):
        _push(shifts, [0.0, 0.6])
    assert shifts.shift.lateral_m == pytest.approx(0.0, abs=0.02)
    assert shifts.shift.ambiguous


def test_the_shift_follows_when_all_lines_jump() -> None:
    shifts = ShiftFilter(20.0, 0.5)
    for _ in range(50):
        _push(shifts, [0.0, 0.0, 0.0])
    for _ in range(60):
        _push(shifts, [0.7, 0.7, 0.7])
    assert shifts.shift.lateral_m == pytest.approx(0.7, abs=0.02)


def test_no_line_leaves_the_shift_as_it_was() -> None:
    shifts = ShiftFilter(20.0, 0.5)
    _push(shifts, [0.3, 0.3])
    none = np.zeros(0)
    after = shifts.push(1.0, none, none, none.astype(np.int64), none)
    assert after.lateral_m == pytest.approx(0.3, abs=0.02)


def test_places_on_lanes_and_on_the_paint_of_their_borders() -> None:
    left = np.array([[0.0, 3.5, 0.0], [20.0, 3.5, 0.0]])
    right = np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
    lanelet = Lanelet(
        lanelet_id=1, tags={}, left_ids=(1,), right_ids=(2,), left_map=left, right_map=right,
        centreline_id=0, rule_ids=(),
    )  # fmt: skip
    points = np.array([[10.0, 1.0], [10.0, -0.4], [10.0, -2.0], [30.0, 1.0]])
    assert in_lanes(points, {1: lanelet}).tolist() == [True, True, False, False]
    assert not in_lanes(points, {}).any()
