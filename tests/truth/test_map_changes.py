"""Changes planted into the map of a synthetic drive: what is told of them is what was done."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from percept.core.errors import UsageError
from percept.core.map_findings import Kind
from percept.datasets.synthetic.drive import MAP_ORIGIN, Drive, DriveConfig, generate_drive
from percept.datasets.synthetic.lanelet_map import make_map, write_map
from percept.datasets.synthetic.map_changes import plan_changes, plant_changes
from percept.datasets.synthetic.map_sight import DriveSight
from percept.datasets.synthetic.map_sites import LineSite, Site
from percept.datasets.synthetic.sensor_rig import make_cameras
from percept.hdmap import HdMap, load_map

BLOCKS = range(-2, 8)
KINDS = set(Kind) - {Kind.LANE_WIDTH, Kind.GLOBAL_OFFSET}


def sight_of(seed: int, seconds: float) -> DriveSight:
    drive = Drive(DriveConfig(seed=seed, cameras=()))
    camera = make_cameras(("cam_front",), (640, 400))[0]
    return DriveSight(drive.world, drive.ego, camera, seconds)


def planned(sight: DriveSight, count: int) -> list[Site]:
    return plan_changes(sight, lambda _: BLOCKS, count)


def planted(folder: Path, seed: int, count: int, seconds: float) -> tuple[HdMap, HdMap, list[Any]]:
    """The true map, the changed one, and the rows of the changes, all read back."""
    sight = sight_of(seed, seconds)
    street = make_map(sight.world, MAP_ORIGIN, BLOCKS)
    write_map(street, folder / "true.osm")
    changes = plant_changes(street, sight, planned(sight, count), seed)
    write_map(street, folder / "changed.osm")
    rows = json.loads(json.dumps([change.row() for change in changes], allow_nan=False))
    return load_map(folder / "true.osm"), load_map(folder / "changed.osm"), rows


def paint(hd_map: HdMap, element: int) -> tuple[str | None, str | None, np.ndarray[Any, Any]]:
    tags = hd_map.line_strings[element].tags
    return tags.get("subtype"), tags.get("color"), hd_map.points_of(element)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_map_differs_where_and_how_it_is_said(tmp_path: Path, seed: int) -> None:
    true, changed, rows = planted(tmp_path, seed, 20, 60.0)
    assert len(rows) == 20
    assert {row["kind"] for row in rows} == KINDS
    touched = set()
    for row in rows:
        kind, element, points = row["kind"], row["map_element_id"], np.array(row["points"])
        gone = row.get("removed_element_id", 0)
        touched |= {element, gone}
        assert [row["x"], row["y"]] == pytest.approx(points.mean(axis=0))
        if gone:
            assert (element == 0) == (kind != "missing_in_map")
            assert element == 0 or changed.line_strings[element].tags["type"] == "virtual"
            assert kind.endswith("missing_in_map") or kind == "missing_in_map"
            assert gone not in changed.line_strings
            np.testing.assert_allclose(true.points_of(gone)[:, :2], points, atol=1e-6)
            continue
        if element not in true.line_strings:
            assert kind in ("missing_on_road", "stop_line_missing", "traffic_light_missing")
            np.testing.assert_allclose(changed.points_of(element)[:, :2], points, atol=1e-6)
            continue
        was, now = paint(true, element), paint(changed, element)
        shift = now[2] - was[2]
        np.testing.assert_allclose(was[2][:, :2], points, atol=1e-6)
        assert ((was[0] != now[0]), (was[1] != now[1])) == (kind == "type", kind == "colour")
        axis = {"moved": 1, "stop_line_moved": 0}.get(kind)
        if axis is None:
            assert row["offset_m"] is None
            np.testing.assert_allclose(shift, 0.0, atol=1e-9)
        else:  # the road's paint relative to the map's, the elements run along +x
            np.testing.assert_allclose(shift[:, axis], -row["offset_m"], atol=1e-5)
            low, high = (0.5, 0.9) if axis else (0.8, 1.5)
            assert low <= abs(row["offset_m"]) <= high
    for element, way in true.line_strings.items():
        own = {element, int(way.tags.get("traffic_light_id", 0))}
        if not own & touched:
            assert way.tags == changed.line_strings[element].tags
            np.testing.assert_array_equal(true.points_of(element), changed.points_of(element))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_changed_map_stays_whole(tmp_path: Path, seed: int) -> None:
    true, changed, rows = planted(tmp_path, seed, 20, 60.0)
    assert not changed.dropped
    assert changed.lanelets.keys() == true.lanelets.keys()
    for lanelet in changed.lanelets.values():
        for border in (*lanelet.left_ids, *lanelet.right_ids):
            assert border in changed.line_strings
    virtual = [m for m in changed.line_strings.values() if m.tags["type"] == "virtual"]
    assert len(virtual) == sum(row["kind"] == "missing_in_map" for row in rows)
    lights = {
        word: sum(row["kind"] == f"traffic_light_{word}" for row in rows)
        for word in ("missing", "missing_in_map")
    }
    assert len(changed.lights) - len(true.lights) == lights["missing"] - lights["missing_in_map"]
    assert all(light.group_ids and len(light.bulbs) == 3 for light in changed.lights)


def test_kinds_are_spread_evenly_and_stay_apart() -> None:
    for seed in range(4):
        sites = planned(sight_of(seed, 40.0), 14)
        counts = Counter(site.kind for site in sites)
        assert set(counts) == KINDS
        assert max(counts.values()) <= 2
        for k, site in enumerate(sites):
            assert not any(site.clashes(other) for other in sites[k + 1 :])


def test_nothing_is_planted_where_the_camera_does_not_see_it() -> None:
    """In world 0 a vehicle hides the left lane from 300 m to 360 m: nothing is planted there."""
    sight = sight_of(0, 60.0)
    hidden = np.column_stack([np.arange(302.0, 360.0, 2.0), np.zeros(29), np.zeros(29)])
    hidden[:, 2] = sight.world.profile.height(hidden[:, 0])
    assert (sight.looks(hidden, 4.0, 15.0) < 3).mean() > 0.5
    sites = planned(sight, 27)
    low, high = sight.span_m
    for site in sites:
        assert low <= site.x_m <= high
        assert site.seen(sight)
        if isinstance(site, LineSite) and site.track >= 3:
            assert not 300.0 <= site.x_m < 360.0


def test_a_box_hides_what_lies_behind_it_alone() -> None:
    sight = sight_of(0, 60.0)
    x = np.arange(302.0, 360.0, 2.0)
    for y, seen in ((-7.0, True), (-3.5, True), (3.5, False)):
        points = np.column_stack([x, np.full(len(x), y), sight.world.profile.height(x)])
        assert ((sight.looks(points, 4.0, 15.0) >= 3).all()) == seen


def test_the_same_seed_plants_the_same_changes() -> None:
    first, again = (planned(sight_of(3, 40.0), 12) for _ in range(2))
    assert [(s.kind, s.x_m) for s in first] == [(s.kind, s.x_m) for s in again]
    other = planned(sight_of(4, 40.0), 12)
    assert [(s.kind, s.x_m) for s in first] != [(s.kind, s.x_m) for s in other]


def test_too_many_changes_are_refused_with_what_would_fit() -> None:
    with pytest.raises(UsageError) as refused:
        planned(sight_of(5, 12.0), 8)
    message = str(refused.value)
    assert "a drive of 12 s has places for" in message
    seconds = float(message.split("--seconds ")[1].rstrip("."))
    assert len(planned(sight_of(5, seconds), 8)) == 8
    fits = int(message.split("at most ")[1].split(",")[0])
    assert len(planned(sight_of(5, 12.0), fits)) == fits


def test_a_drive_writes_its_changes_and_leaves_the_road_alone(tmp_path: Path) -> None:
    small = DriveConfig(seed=5, seconds=13.0, cameras=(), beam_share=0.05, noise=0.0)
    for name, count in (("same", 0), ("changed", 3)):
        generate_drive(small.model_copy(update={"map_changes": count}), tmp_path / name)
    same, changed = (tmp_path / name / "truth" for name in ("same", "changed"))
    for name in ("markings.geojson", "poses.parquet", "objects.parquet"):
        assert (same / name).read_bytes() == (changed / name).read_bytes()
    assert json.loads((same / "map_changes.json").read_text()) == []
    rows = json.loads((changed / "map_changes.json").read_text())
    assert len(rows) == 3
    maps = [load_map(tmp_path / name / "map.osm") for name in ("same", "changed")]
    assert {row["map_element_id"] for row in rows} <= {0, *maps[1].line_strings}
    assert all(row["offset_m"] is None or math.isfinite(row["offset_m"]) for row in rows)


def test_elements_of_the_map_are_short(tmp_path: Path) -> None:
    path = tmp_path / "map.osm"
    write_map(make_map(Drive(DriveConfig(cameras=())).world, MAP_ORIGIN, range(3)), path)
    street = load_map(path)
    for marking in street.markings:
        assert np.linalg.norm(np.diff(marking.points_map, axis=0), axis=1).sum() < 30.1
    heads = {rule for light in street.lights for rule in light.group_ids}
    obeying = [lanelet for lanelet in street.lanelets.values() if lanelet.rule_ids]
    assert {rule for lanelet in obeying for rule in lanelet.rule_ids} == heads
    assert len(heads) == 6
    assert len(obeying) == 12
    stops = {x for marking in street.markings if marking.kind == "stop_line"
             for x in marking.points_map[:, 0].tolist()}  # fmt: skip
    for lanelet in obeying:  # a lanelet ends where its stop line is
        assert lanelet.left_map[-1, 0] in stops
