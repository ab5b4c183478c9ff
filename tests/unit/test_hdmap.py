"""Lanelet2 files: what is read, in which frame it lies, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from percept.core.errors import InputError
from percept.core.geodesy import LocalFrame
from percept.hdmap import HdMap, load_map
from percept.hdmap.osm import read_osm

ORIGIN = LocalFrame(49.0, 8.4, 110.0)
HEAD = '<?xml version="1.0"?>\n'


def node(identity: int, x: float, y: float, z: float, tags: str = "") -> str:
    return (
        f'<node id="{identity}" lat="" lon=""><tag k="local_x" v="{x}"/>'
        f'<tag k="local_y" v="{y}"/><tag k="ele" v="{z}"/>{tags}</node>'
    )


def way(identity: int, nodes: tuple[int, ...], **tags: str) -> str:
    refs = "".join(f'<nd ref="{ref}"/>' for ref in nodes)
    return f'<way id="{identity}">{refs}{tagged(**tags)}</way>'


def tagged(**tags: str) -> str:
    return "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())


def written(folder: Path, *elements: str, root: str = "osm") -> Path:
    path = folder / "map.osm"
    path.write_text(f"{HEAD}<{root}>{''.join(elements)}</{root}>", encoding="utf-8")
    return path


def read(folder: Path, *elements: str) -> HdMap:
    return load_map(written(folder, *elements))


EDGE = (node(1, 0, 2, 5), node(2, 0, 1.6, 5))  # whoever drives along +x sees it left to right
LIGHT = way(7, (1, 2), type="traffic_light", subtype="red_yellow_green", height="1.2")


def test_a_light_is_the_lower_edge_of_its_face(tmp_path: Path) -> None:
    (light,) = read(tmp_path, *EDGE, LIGHT).lights
    assert light.light_id == 7
    expected = np.array([[0, 2, 5], [0, 1.6, 5], [0, 1.6, 6.2], [0, 2, 6.2]])
    np.testing.assert_allclose(light.corners_map, expected)
    np.testing.assert_allclose(light.facing, [-1, 0, 0], atol=1e-12)
    assert light.bulbs == ("red", "yellow", "green")
    assert light.group_ids == ()


@pytest.mark.parametrize("area", [{"area": "yes"}, {}])
def test_an_outline_runs_clockwise_for_who_obeys_it(tmp_path: Path, area: dict[str, str]) -> None:
    clockwise = (node(1, 0, 2, 5), node(2, 0, 2, 6), node(3, 0.1, 1.6, 6), node(4, 0.1, 1.6, 5))
    nodes = (1, 2, 3, 4) if area else (1, 2, 3, 4, 1)
    (light,) = read(tmp_path, *clockwise, way(7, nodes, type="traffic_light", **area)).lights
    expected = np.array([[0, 2, 5], [0.1, 1.6, 5], [0.1, 1.6, 6], [0, 2, 6]])
    np.testing.assert_allclose(light.corners_map, expected, atol=1e-9)
    assert light.facing[0] < -0.9


def test_bulbs_are_read_from_the_top_and_from_the_left(tmp_path: Path) -> None:
    bulbs = (
        node(11, 0, 1.9, 5.2, tagged(color="green")),
        node(12, 0, 1.8, 5.22, tagged(color="yellow")),
        node(13, 0, 1.7, 5.2, tagged(color="red")),
        node(14, 0, 1.7, 4.8, tagged(color="green", arrow="right")),
        node(15, 0, 1.7, 4.6, tagged(color="amber")),
    )
    of_light = way(8, (15, 14, 13, 12, 11), type="light_bulbs", traffic_light_id="7")
    (light,) = read(tmp_path, *EDGE, *bulbs, LIGHT, of_light).lights
    assert light.bulbs == ("green", "yellow", "red", "green")


def test_a_subtype_that_names_no_colours_says_nothing(tmp_path: Path) -> None:
    (light,) = read(tmp_path, *EDGE, LIGHT.replace("red_yellow_green", "pedestrian")).lights
    assert light.bulbs == ()


def test_rules_make_groups(tmp_path: Path) -> None:
    rules = "".join(
        f'<relation id="{rule}"><member type="way" role="{role}" ref="7"/>'
        f"{tagged(type='regulatory_element', subtype=kind)}</relation>"
        for rule, role, kind in (
            (22, "refers", "traffic_light"),
            (21, "refers", "traffic_light"),
            (23, "ref_line", "traffic_light"),
            (24, "refers", "right_of_way"),
        )
    )
    (light,) = read(tmp_path, *EDGE, LIGHT, rules).lights
    assert light.group_ids == (21, 22)


def test_what_an_editor_deleted_is_not_there(tmp_path: Path) -> None:
    deleted = LIGHT.replace('id="7"', 'id="8" action="delete"')
    street = read(tmp_path, *EDGE, LIGHT, deleted, EDGE[0].replace('id="1"', 'id="3"'))
    assert [light.light_id for light in street.lights] == [7]
    gone = read(tmp_path, EDGE[0], EDGE[1].replace('id="2"', 'id="2" action="delete"'), LIGHT)
    assert not gone.lights
    assert sum(gone.dropped.values()) == 1


@pytest.mark.parametrize(
    ("light", "reason"),
    [
        (LIGHT.replace('v="1.2"', 'v="nan"'), "without a height"),
        (LIGHT.replace('k="height"', 'k="hight"'), "without a height"),
        (LIGHT.replace('ref="2"', 'ref="1"'), "without width"),
        (LIGHT.replace('ref="2"', 'ref="9"'), "that the file does not hold"),
    ],
)
def test_a_light_without_a_face_is_counted(tmp_path: Path, light: str, reason: str) -> None:
    street = read(tmp_path, *EDGE, light)
    assert not street.lights
    assert [key for key in street.dropped if reason in key]


def test_members_may_be_missing_and_relations_may_be_cyclic(tmp_path: Path) -> None:
    rings = "".join(
        f'<relation id="{a}"><member type="relation" role="refers" ref="{b}"/></relation>'
        for a, b in ((31, 32), (32, 31), (33, 33), (34, 99))
    )
    street = read(tmp_path, *EDGE, rings)
    assert set(street.relations) == {31, 32, 33, 34}
    assert list(street.dropped.values()) == [1]


def geodetic_node(identity: int, xyz: tuple[float, float, float], *, ele: bool = True) -> str:
    lat, lon, alt = ORIGIN.geodetic(np.array(xyz))
    height = f'<tag k="ele" v="{alt!r}"/>' if ele else ""
    return f'<node id="{identity}" lat="{lat!r}" lon="{lon!r}">{height}</node>'


META = '<MetaInfo origin_lat="49" origin_lon="8.4" origin_ele="110"/>'


def test_points_lie_east_north_and_up_of_the_origin(tmp_path: Path) -> None:
    xyz = (812.5, -640.25, 12.0)
    path = written(tmp_path, META, geodetic_node(1, xyz))
    for street in (load_map(path), load_map(path, ORIGIN)):
        assert street.origin == ORIGIN
        np.testing.assert_allclose(street.points.xyz_map, [xyz], atol=1e-6)


def test_an_origin_that_is_given_wins_over_local_coordinates(tmp_path: Path) -> None:
    local = tagged(local_x="1", local_y="2", ele="113") + "</node>"
    lat, lon, _ = ORIGIN.geodetic(np.array([40.0, 30.0, 0.0]))
    path = written(tmp_path, f'<node id="1" lat="{lat!r}" lon="{lon!r}">{local}')
    np.testing.assert_allclose(load_map(path).points.xyz_map, [[1, 2, 113]])
    np.testing.assert_allclose(load_map(path, ORIGIN).points.xyz_map[0], [40, 30, 3], atol=1e-3)


def test_points_without_a_height_are_counted(tmp_path: Path) -> None:
    street = read(tmp_path, META, geodetic_node(1, (5.0, 5.0, 0.0), ele=False))
    np.testing.assert_allclose(street.points.xyz_map, [[5, 5, 0]], atol=1e-4)
    assert list(street.dropped.values()) == [1]


@pytest.mark.parametrize(
    ("elements", "said"),
    [
        ((geodetic_node(1, (0, 0, 0)),), "--origin"),
        ((geodetic_node(1, (0, 0, 0)), EDGE[1]), "1 of 2 points have no local_x"),
        ((META, EDGE[0].replace("local_x", "x")), "node 1 has no latitude"),
        ((META.replace('"49"', '"99"'), EDGE[0]), "is no place"),
        ((META.replace('"49"', '"north"'), EDGE[0]), "origin_lat='north' is no number"),
        ((EDGE[0].replace('v="5"', 'v="inf"'),), "node 1: ele='inf' is no number"),
        ((EDGE[0].replace('v="5"', 'v="-1e300"'),), "node 1: ele='-1e300' is no place on earth"),
        ((EDGE[0].replace('lat=""', 'lat="149"'),), "node 1: lat='149' is no angle"),
        ((EDGE[0].replace('id="1"', 'id="one"'),), "id='one' is no id"),
        ((EDGE[0].replace('id="1"', f'id="{2**64}"'),), "is no id"),
        ((EDGE[0], EDGE[0]), "node 1 stands in it twice"),
        ((EDGE[0], '<way id="5"><nd/></way>'), "way 5: ref='' is no id"),
        ((), "holds no points"),
    ],
)
def test_a_map_that_cannot_be_used_is_refused(
    tmp_path: Path, elements: tuple[str, ...], said: str
) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, *elements)
    assert said in str(error.value)
    assert str(error.value).startswith(f"{tmp_path}/map.osm: ")
    assert "\n" not in str(error.value)


def bomb() -> str:
    entities = '<!ENTITY e0 "ha">' + "".join(
        f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 12)
    )
    return f'{HEAD}<!DOCTYPE osm [{entities}]><osm><node id="&e11;"/></osm>'


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"plain text, no map", "is no XML"),
        (HEAD.encode() + b"<osm><node id='1'", "is no XML"),
        (HEAD.encode() + b"<osm><node id='1'></osm>", "is no XML"),
        (b"<html></html>", "its root is <html>"),
        (bytes(range(256)) * 8, "is no XML"),
        (bomb().encode(), "document type"),
        (bomb().replace('"1.0"', '"1.0" encoding="UTF-16"').encode("utf-16"), "document type"),
        (b'<!DOCTYPE osm SYSTEM "http://127.0.0.1:9/x.dtd"><osm/>', "document type"),
        (b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><osm>&x;</osm>', "document type"),
        (b"<osm>" + b"<way>" * 99_999 + b"</way>" * 99_999 + b"</osm>", "way without an id"),
    ],
)
def test_hostile_files_are_refused_in_one_line(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "map.osm"
    path.write_bytes(content)
    with pytest.raises(InputError) as error:
        load_map(path)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_place_in_a_file_is_told_once(tmp_path: Path) -> None:
    path = tmp_path / "map.osm"
    path.write_text("<osm>\n<node id='1'></osm>", encoding="utf-8")
    with pytest.raises(InputError, match=r"node line 2 and osm, line 2, column 20\)$"):
        load_map(path)


def test_letters_that_xml_writes_otherwise_are_read_as_they_are(tmp_path: Path) -> None:
    street = read(tmp_path, *EDGE, way(7, (1, 2), type="a &amp; b &#38; &lt;c&gt; &quot;&#x2028;"))
    assert street.line_strings[7].tags["type"] == 'a & b & <c> "\u2028'


def test_a_file_that_cannot_be_opened_or_is_too_large(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot be read \(No such file"):
        read_osm(tmp_path / "none.osm")
    with pytest.raises(InputError, match=r"cannot be read \(Is a directory"):
        read_osm(tmp_path)
    huge = tmp_path / "huge.osm"
    with huge.open("wb") as stream:
        stream.truncate(600 * 2**20)
    with pytest.raises(InputError, match="has 600 MiB; maps may have 512"):
        read_osm(huge)


def test_a_long_text_is_refused_and_many_points_are_not(tmp_path: Path) -> None:
    path = tmp_path / "map.osm"
    path.write_bytes(b"<osm><node id='" + b"9" * 12_000_000 + b"'/></osm>")
    with pytest.raises(InputError, match="is no id"):
        load_map(path)
    street = read(tmp_path, "".join(node(k, k, 0, 0) for k in range(20_000)))
    assert len(street.points) == 20_000
    np.testing.assert_array_equal(street.points.xyz_map[:, 0], np.arange(20_000))
