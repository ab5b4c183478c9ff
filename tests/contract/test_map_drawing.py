"""Maps as GeoJSON, SVG and PNG: what other programs read, whatever a map says of itself."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from lxml import etree
from made_osm import lanelet, node, relation, way, write_osm
from made_xodr import geometry, lane, mark, road, write_xodr

from percept.core.errors import InputError
from percept.core.geodesy import LocalFrame
from percept.export.map_drawing import map_image, map_png, map_svg
from percept.export.map_geojson import map_geojson
from percept.export.map_scene import map_scene
from percept.hdmap import HdMap, load_map

ORIGIN = LocalFrame(43.7822, -79.4661, 160.0)
HOSTILE = "<script>alert('\"&')</script>\u2028"
WHITE, YELLOW, RED = (236, 240, 244), (250, 200, 40), (226, 84, 64)


@pytest.fixture
def street(tmp_path: Path) -> HdMap:
    """A lane 60 m long along +x with a light, a stop line and names that are an attack."""
    nodes = [node(k, x, y) for k, (x, y) in enumerate([(0, 0), (60, 0), (0, 4), (60, 4)], start=1)]
    nodes += [node(5, 50, 0), node(6, 50, 4), node(7, 55, 3.0, 5.0), node(8, 55, 2.0, 5.0)]
    lines = (
        way(11, [1, 2], type="line_thin", subtype="solid", name=HOSTILE),
        way(12, [3, 4], type="line_thin", subtype="dashed", color="yellow"),
        way(13, [5, 6], type="stop_line"),
        way(14, [7, 8], type="traffic_light", subtype="red_yellow_green", height="1"),
    )
    ring = [("way", "outer", k) for k in (15, 16)]
    area = way(15, [1, 3, 4], type="virtual"), way(16, [4, 2, 1], type="virtual")
    lanes = (lanelet(21, [12], [11], name=HOSTILE), relation(22, ring, type="multipolygon"))
    meta = '<MetaInfo origin_lat="43.7822" origin_lon="-79.4661" origin_ele="160"/>'
    return load_map(write_osm(tmp_path / "map.osm", meta, *nodes, *lines, *area, *lanes))


def test_geojson_is_of_longitudes_and_latitudes(street: HdMap) -> None:
    text = map_geojson(street)
    document = json.loads(text)
    assert document["type"] == "FeatureCollection"
    assert "crs" not in document
    by_id = {feature["id"]: feature for feature in document["features"]}
    assert set(by_id) == {11, 12, 13, 14, 15, 16, 21, 22}
    line = by_id[12]
    assert line["geometry"]["type"] == "LineString"
    assert (line["properties"]["kind"], line["properties"]["colour"]) == ("line", "yellow")
    assert line["properties"]["width_m"] is None
    lon, lat, alt = line["geometry"]["coordinates"][1]
    east_north = ORIGIN.local(np.array([[lat, lon, alt]]))[0]
    np.testing.assert_allclose(east_north, [60, 4, -160], atol=1e-3)
    assert by_id[11]["properties"]["tags"]["name"] == HOSTILE
    assert by_id[14]["geometry"]["type"] == "Point"
    assert by_id[14]["properties"]["bulbs"] == ["red", "yellow", "green"]


@pytest.mark.parametrize("identity", [21, 22])
def test_rings_of_geojson_are_closed_and_counterclockwise(street: HdMap, identity: int) -> None:
    features = json.loads(map_geojson(street))["features"]
    (ring,) = next(f["geometry"]["coordinates"] for f in features if f["id"] == identity)
    assert ring[0] == ring[-1]
    assert len(ring) == 5
    lon, lat = np.array(ring)[:, 0], np.array(ring)[:, 1]
    assert ((lon[:-1] - lon[0]) * (lat[1:] - lat[0])).sum() > (
        (lon[1:] - lon[0]) * (lat[:-1] - lat[0])
    ).sum()


def test_geojson_needs_to_know_where_a_map_lies(tmp_path: Path) -> None:
    street = load_map(write_osm(tmp_path / "map.osm", node(1, 0, 0)))
    with pytest.raises(InputError, match="--origin"):
        map_geojson(street)


def test_the_picture_has_paint_in_its_colour(street: HdMap) -> None:
    scene = map_scene(street, 1000)
    image = map_image(scene, "map")
    assert image.shape[1] == 1000
    rows = image[-scene.height_px :]

    def pixels(colour: tuple[int, int, int]) -> int:
        return int((np.abs(rows.astype(int) - colour[::-1]).max(axis=2) < 12).sum())

    solid, dashed = pixels(WHITE), pixels(YELLOW)
    # Dashes are as long as their gaps.
    assert dashed == pytest.approx(solid / 2, rel=0.25)
    assert pixels(RED) > 20
    decoded = cv2.imdecode(np.frombuffer(map_png(scene, "map"), np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    np.testing.assert_array_equal(decoded, image)


def test_the_svg_is_xml_in_which_names_stay_text(street: HdMap) -> None:
    text = map_svg(map_scene(street), HOSTILE)
    assert "<script" not in text
    root = etree.fromstring(text)
    space = "{http://www.w3.org/2000/svg}"
    titles = [title.text or "" for title in root.iter(f"{space}title")]
    assert "way 12: line dashed yellow" in titles
    assert "lanelet 21 road" in titles
    assert sum("traffic light 14" in title for title in titles) == 1
    assert root.findtext(f"{space}text") == HOSTILE


def test_a_pair_is_drawn_as_two_lines(tmp_path: Path) -> None:
    pair = lane(0, mark("solid broken", "yellow"))
    path = write_xodr(
        tmp_path / "map.xodr", road([geometry("<line/>", length=60.0)], [(0, pair)], length=60.0)
    )
    scene = map_scene(load_map(path), 1000)
    (shape,) = (one for one in scene.shapes if one.colour == YELLOW)
    solid, *dashes = shape.lines_px
    assert len(dashes) == 10
    # Solid on the left of +x: above in the picture.
    assert solid[:, 1].max() < min(dash[:, 1].min() for dash in dashes)


def test_a_map_of_one_point_can_be_drawn(tmp_path: Path) -> None:
    scene = map_scene(load_map(write_osm(tmp_path / "map.osm", node(1, 3, 4))))
    assert map_image(scene, "").ndim == 3
    etree.fromstring(map_svg(scene, ""))
