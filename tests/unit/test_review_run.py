"""Runs as the review reads them, and what it makes of findings."""

from __future__ import annotations

import csv
import json
import math
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from made_review_run import make_review_run

from percept.core.errors import InputError
from percept.core.map_findings import Kind, Status
from percept.hdmap.osm import OsmWay, read_osm
from percept.hdmap.osm_write import LayerFeature, write_osm_change, write_osm_layer
from percept.review import ReviewStore, read_run
from percept.review.claims import claim, finding_values
from percept.review.exports import (
    Standing,
    finding_tags,
    places_of,
    standing,
    tag_changes,
    write_decisions_csv,
    write_decisions_json,
)

_REPAINTED = {
    "id": "type-101-0",
    "kind": "type",
    "map_element_id": 123,
    "along_m": 4.0,
    "length_m": 38.2,
    "expected": "solid white",
    "observed": "dashed white",
    "observations": 6,
    "visits": 2,
    "offset_m": 0.04,
    "status": "open",
}


def _run_of(folder: Path, *rows: dict[str, Any]) -> Any:
    return read_run(make_review_run(folder, findings=len(rows), pictures=False, rows=list(rows)))


def test_a_finding_is_one_sentence(tmp_path: Path) -> None:
    new = {**_REPAINTED, "id": "b", "kind": "missing_in_map", "map_element_id": 0, "expected": ""}
    run = _run_of(tmp_path, _REPAINTED, {**new, "visits": 1, "observations": 1, "offset_m": None})
    assert claim(run.by_id["type-101-0"]) == (
        "way 123: map says solid white, seen dashed white over 38 m, 6 looks in 2 visits, "
        "offset +0.04 m"
    )
    told = {**_REPAINTED, "observed": "dashed over 38 m", "length_m": 38.0, "offset_m": None}
    assert claim(_run_of(tmp_path / "told", told).findings[0]) == (
        "way 123: map says solid white, seen dashed over 38 m, 6 looks in 2 visits"
    )
    small = {**_REPAINTED, "observed": "none", "length_m": 0.4, "offset_m": None}
    assert claim(_run_of(tmp_path / "small", small).findings[0]) == (
        "way 123: map says solid white, seen none, 6 looks in 2 visits"
    )
    assert claim(run.by_id["b"]) == (
        "not in the map: map says nothing, seen dashed white over 38 m, 1 look in 1 visit"
    )


def test_the_most_urgent_comes_first(tmp_path: Path) -> None:
    run = read_run(make_review_run(tmp_path, findings=60, pictures=False))
    urgency = [finding.urgency for finding in run.findings]
    assert urgency == sorted(urgency, reverse=True)
    sure = {"confidence": 0.9, "status": "open"}
    colour = {**_REPAINTED, **sure, "id": "c", "kind": "colour"}
    light = {**_REPAINTED, **sure, "id": "l", "kind": "traffic_light_missing", "confidence": 0.8}
    assert [f.finding_id for f in _run_of(tmp_path, colour, light).findings] == ["l", "c"]


def test_every_kind_has_words_and_plain_values(tmp_path: Path) -> None:
    rows = [{**_REPAINTED, "id": str(kind), "kind": str(kind)} for kind in Kind]
    for finding in _run_of(tmp_path, *rows).findings:
        assert json.loads(json.dumps(finding_values(finding), allow_nan=False))["name"]


def test_what_is_not_known_is_null(tmp_path: Path) -> None:
    rows = [{**_REPAINTED, "offset_m": None, "x": None, "latitude": math.nan, "stamp_ns": 0}]
    values = finding_values(_run_of(tmp_path, *rows).findings[0])
    assert [values[name] for name in ("offset", "x", "latitude", "time")] == [None, None, None, ""]
    late = {**_REPAINTED, "stamp_ns": 1_500_000_123_456_789_012}
    values = finding_values(_run_of(tmp_path, late).findings[0])
    assert values["time"] == "2017-07-14 02:42:03.456 UTC"
    assert values["stamp"] == "1500000123456789012"


@pytest.mark.parametrize("name", ["run.json", "discrepancies.parquet", "map_lines.json"])
def test_a_folder_that_is_no_finished_validation_is_told(tmp_path: Path, name: str) -> None:
    make_review_run(tmp_path, findings=3, pictures=False)
    (tmp_path / name).unlink()
    with pytest.raises(InputError, match=f"no finished validation of a map; it has no {name}"):
        read_run(tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("run.json", "[]", "is no object"),
        ("run.json", "{", "cannot be read as JSON"),
        ("map_lines.json", '{"lines": [{"id": 1}], "paths": []}', "holds no map lines"),
        (
            "map_lines.json",
            '{"lines": [], "paths": [{"points": [[1, NaN]]}]}',
            "holds no map lines",
        ),
        ("discrepancies.parquet", "PAR1 but not really", "cannot be read as a table"),
    ],
)
def test_a_file_that_is_not_as_it_should_be_is_told(
    tmp_path: Path, name: str, content: str, message: str
) -> None:
    make_review_run(tmp_path, findings=3, pictures=False)
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=message):
        read_run(tmp_path)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ({"kind": "bent"}, "row 0: 'bent' is not a valid Kind"),
        ({"status": "maybe"}, "row 0: 'maybe' is not a valid Status"),
        ({"points": "[[1]]"}, "row 0"),
        ({"points": "nothing"}, "row 0"),
        ({"confidence": None}, "row 0: confidence is empty"),
        ({"length_m": math.inf}, "row 0: length_m is not finite"),
    ],
)
def test_a_bad_row_is_named(tmp_path: Path, row: dict[str, Any], message: str) -> None:
    make_review_run(tmp_path, findings=1, pictures=False)
    path = tmp_path / "discrepancies.parquet"
    table = pq.read_table(path)
    values = {**table.to_pylist()[0], **_REPAINTED, "points": "[]", **row}
    pq.write_table(pa.Table.from_pylist([values], schema=table.schema), path)
    with pytest.raises(InputError, match=message):
        read_run(tmp_path)


def test_two_findings_of_one_id_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="two findings of one id"):
        _run_of(tmp_path, _REPAINTED, _REPAINTED)


# ---- exports


def test_what_an_earlier_review_said_stands_until_something_else_is_said(tmp_path: Path) -> None:
    rows = [
        {**_REPAINTED, "id": str(n), "status": "confirmed" if n < 2 else "open"} for n in range(4)
    ]
    run = _run_of(tmp_path, *rows)
    with ReviewStore(tmp_path / "review.sqlite") as store:
        store.decide(run.by_id["0"].decided(Status.OPEN, "not sure after all"))
        store.decide(run.by_id["2"].decided(Status.REJECTED, "worn"))
        stands = standing(run, store.latest())
    assert {one.finding.finding_id: one.status for one in stands} == {
        "1": Status.CONFIRMED,
        "2": Status.REJECTED,
    }


def test_tables_hold_what_was_decided(tmp_path: Path) -> None:
    formula = {**_REPAINTED, "observed": "=HYPERLINK(1)", "offset_m": -0.5}
    stands = [Standing(_run_of(tmp_path, formula).findings[0], Status.UNSURE, '@ä,\n"x"', "now")]
    write_decisions_csv(tmp_path / "d.csv", stands)
    write_decisions_json(tmp_path / "d.json", stands)
    with (tmp_path / "d.csv").open(encoding="utf-8", newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["comment"] == '\'@ä,\n"x"'
    assert row["observed"] == "'=HYPERLINK(1)"
    assert row["offset_m"] == "-0.5"
    (plain,) = json.loads((tmp_path / "d.json").read_text(encoding="utf-8"))
    assert plain.keys() == row.keys()
    assert plain["comment"] == '@ä,\n"x"'
    assert plain["observed"] == "=HYPERLINK(1)"


def test_only_mechanical_edits_of_whole_ways_become_changes(tmp_path: Path) -> None:
    make_review_run(tmp_path, findings=1, pictures=False)
    lines = json.loads((tmp_path / "map_lines.json").read_text())
    straight = [[0.0, 0.0], [50.0, 0.0], [100.0, 0.0]]
    lines["lines"] = [{**lines["lines"][0], "id": way, "points": straight} for way in range(1, 8)]

    def row(identity: int, way: int, **values: Any) -> dict[str, Any]:
        whole = {"id": str(identity), "map_element_id": way, "along_m": 1.0, "length_m": 98.0}
        return {**_REPAINTED, **whole, **values}

    rows = [
        row(1, 1),
        row(2, 2, kind="colour", observed="yellow over 98 m (97 % of the votes)"),
        row(3, 3, length_m=40.0),  # a part of it
        row(4, 4, length_m=60.0),
        row(5, 4, along_m=50.0, length_m=50.0),  # both parts together
        row(6, 5, length_m=60.0),
        row(7, 5, along_m=10.0, length_m=50.0),  # the same part twice
        row(8, 6, kind="moved"),
        row(9, 7),
        row(10, 7, observed="solid_solid white"),
        row(11, 1, kind="colour", observed="yellow"),
        row(12, 0),
        row(13, 2, observed="unknown white"),
    ]
    make_review_run(tmp_path, findings=len(rows), pictures=False, rows=rows)
    (tmp_path / "map_lines.json").write_text(json.dumps(lines))
    run = read_run(tmp_path)
    changes = tag_changes(run, [Standing(f, Status.CONFIRMED, "", "") for f in run.findings])
    assert changes.tags == {
        1: {"subtype": "dashed", "color": "yellow"},
        2: {"color": "yellow"},
        4: {"subtype": "dashed"},
    }
    assert changes.left == Counter(
        {
            "only a part of the way": 3,
            "moved is drawn by hand": 1,
            "one way with two answers": 2,
            "type is drawn by hand": 2,
        }
    )


def test_the_layer_is_a_map_that_reads_back(tmp_path: Path) -> None:
    run = read_run(make_review_run(tmp_path, findings=12, pictures=False))
    places = places_of(tmp_path)
    assert len(places) == 11  # the offset of the whole map has no place
    features = [
        LayerFeature(
            places[f.finding_id], finding_tags(Standing(f, Status.CONFIRMED, "<&\x00>", ""))
        )
        for f in run.findings
        if f.finding_id in places
    ]
    write_osm_layer(tmp_path / "layer.osm", features)
    layer = read_osm(tmp_path / "layer.osm")
    assert Xml.parse(tmp_path / "layer.osm").getroot().get("upload") == "never"  # noqa: S314
    assert max([*layer.nodes, *layer.ways]) < 0
    alone = [node for node in layer.nodes.values() if node.tags]
    assert len(layer.ways) + len(alone) == len(features)
    way = next(iter(layer.ways.values()))
    assert way.tags["percept:comment"] == "<&\ufffd>"
    finding = run.by_id[way.tags["percept:finding"]]
    assert way.tags["percept:kind"] == finding.kind
    first = layer.nodes[way.nodes[0]]
    assert (first.latitude_deg, first.longitude_deg) == pytest.approx(
        places[finding.finding_id][0], abs=1e-9
    )


def test_a_change_keeps_all_nodes_and_tags(tmp_path: Path) -> None:
    tags = {"type": "line_thin", "subtype": "dashed", "note": '"<>&'}
    write_osm_change(tmp_path / "c.osc", {7: OsmWay(nodes=(3, 1, 2), tags=tags)})
    root = Xml.parse(tmp_path / "c.osc").getroot()  # noqa: S314
    (way,) = root.findall("./modify/way")
    assert (root.tag, way.get("id")) == ("osmChange", "7")
    assert [nd.get("ref") for nd in way.findall("nd")] == ["3", "1", "2"]
    assert {tag.get("k"): tag.get("v") for tag in way.findall("tag")} == tags


def test_places_that_are_not_geojson_are_told(tmp_path: Path) -> None:
    for content in (None, "{}", '{"features": [{"id": 1, "geometry": {"type": "Point"}}]}'):
        if content is not None:
            (tmp_path / "discrepancies.geojson").write_text(content)
        with pytest.raises(InputError, match="cannot be read as GeoJSON"):
            places_of(tmp_path)
