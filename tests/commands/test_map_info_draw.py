"""`percept map info` and `percept map draw` as a user runs them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from made_osm import lanelet, node, relation, way, write_osm
from made_xodr import geometry, lane, mark, road, write_xodr
from typer.testing import Result

Run = Callable[..., Result]


@pytest.fixture
def street(tmp_path: Path) -> Path:
    nodes = [node(k, x, y) for k, (x, y) in enumerate([(0, 0), (60, 0), (0, 4), (60, 4)], start=1)]
    lines = (
        way(11, [1, 2], type="line_thin", subtype="solid"),
        way(12, [3, 4], type="line_thin", subtype="dashed", color="yellow"),
        way(13, [1, 99], type="stop_line"),
        way(14, [1, 2], type="curbstone").replace("<way ", '<way action="delete" '),
        way(15, [1, 3], type="fog\u001b[2J".replace("\u001b", "\u009b")),
    )
    rule = relation(31, [("way", "refers", 77)], type="regulatory_element", subtype="right_of_way")
    lanes = lanelet(21, [12], [11]), lanelet(22, [12], [13])
    return write_osm(tmp_path / "map.osm", *nodes, *lines, *lanes, rule)


def test_info_counts_what_is_there(run: Run, street: Path) -> None:
    done = run("map", "info", street, "--json")
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    counts = ("lanelets", "linestrings", "points", "regulatory_elements", "areas", "traffic_lights")
    assert [document[name] for name in counts] == [1, 3, 4, 1, 0, 0]
    assert document["lane_km"] == 0.06
    assert {(m["type"], m["colour"], m["count"], m["length_m"]) for m in document["markings"]} == {
        ("solid", "white", 1, 60.0),
        ("dashed", "yellow", 1, 60.0),
    }
    assert document["extent_m"] == {"x": [0.0, 60.0], "y": [0.0, 4.0], "z": [0.0, 0.0]}
    assert document["georeference"] is None
    assert len(document["dropped"]) == 4


def test_info_for_people(run: Run, street: Path) -> None:
    done = run("map", "info", street)
    assert done.exit_code == 0
    assert "4 points, 3 line strings, 1 lanelets, 0 areas, 1 rules, 0 traffic lights" in done.stdout
    assert "lanes for vehicles: 0.06 km" in done.stdout
    assert "line dashed yellow" in done.stdout
    assert "the map does not say where on the earth it lies" in done.stdout
    assert "noted: 1 members of relations that the file does not hold" in done.stdout
    assert "\u009b" not in done.stdout


def test_info_of_an_opendrive_file(run: Run, tmp_path: Path) -> None:
    text = road([geometry("<line/>", length=60.0)], [(0, lane(0, mark("broken")))], length=60.0)
    done = run("map", "info", write_xodr(tmp_path / "map.xodr", text), "--json")
    document = json.loads(done.stdout)
    assert (document["linestrings"], document["lanelets"]) == (1, 0)
    assert document["markings"][0]["type"] == "dashed"


@pytest.mark.parametrize("kind", ["png", "svg", "geojson"])
def test_draw(run: Run, street: Path, tmp_path: Path, kind: str) -> None:
    out = tmp_path / f"drawn.{kind}"
    flags = ("--origin", "49,8.4") if kind == "geojson" else ()
    if kind == "geojson":  # by latitude and longitude, which the points have to have
        street.write_text(street.read_text().replace('lat="" lon=""', 'lat="49" lon="8.4"'))
    before = street.read_bytes()
    done = run("map", "draw", street, "--to", out, *flags)
    assert done.exit_code == 0, done.output
    assert out.stat().st_size > 500
    assert street.read_bytes() == before
    assert run("map", "draw", street, "--to", out, *flags).exit_code == 2
    assert run("map", "draw", street, "--to", out, "--force", *flags).exit_code == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"drawn.{kind}", "map.osm"]


def test_draw_refuses_what_it_cannot_do(run: Run, street: Path, tmp_path: Path) -> None:
    assert "is no .png, .svg or .geojson" in run("map", "draw", street, "--to", "x.pdf").stderr
    unknown = run("map", "draw", street, "--to", tmp_path / "x.geojson")
    assert unknown.exit_code == 3
    assert "--origin" in unknown.stderr
    missing = run("map", "draw", tmp_path / "no.osm", "--to", tmp_path / "x.png")
    assert (missing.exit_code, missing.stderr.count("\n")) == (3, 1)
    nowhere = run("map", "draw", street, "--to", tmp_path / "no" / "x.png")
    assert nowhere.exit_code == 2
    assert "cannot be written" in nowhere.stderr
    same = write_osm(tmp_path / "map.svg", street.read_text())
    assert run("map", "draw", same, "--to", same, "--force").exit_code == 2


def test_a_wrong_origin_is_refused(run: Run, street: Path) -> None:
    done = run("map", "info", street, "--origin", "north")
    assert done.exit_code == 2
    assert "LAT,LON" in done.stderr
