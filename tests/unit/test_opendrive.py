"""OpenDRIVE: curves against their definitions, marks in our words, files that are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_xodr import geometry, lane, mark, road, write_xodr
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.special import fresnel

from percept.core.errors import InputError
from percept.core.geodesy import LocalFrame
from percept.hdmap import HdMap, load_map

F64 = NDArray[np.float64]
MIDDLE = (0, lane(0, mark()))
LINE = "<line/>"


def read(folder: Path, *roads: str, header: str = "") -> HdMap:
    return load_map(write_xodr(folder / "map.xodr", *roads, header=header))


def middle_of(folder: Path, *pieces: str, length: float) -> F64:
    """Return the line of lane 0 of a road of some pieces."""
    (marking,) = read(folder, road(pieces, [MIDDLE], length=length)).markings
    return marking.points_map


def test_a_straight_road_with_lanes_on_both_sides(tmp_path: Path) -> None:
    lanes = [(k, lane(k, mark("broken" if k == -1 else "solid"))) for k in (2, 1, 0, -1, -2)]
    piece = geometry(LINE, x=5.0, y=-2.0, hdg=np.pi / 2, length=20.0)
    street = read(tmp_path, road([piece], lanes, length=20.0))
    assert len(street.markings) == 5
    for marking, (name, x) in zip(
        street.markings,
        [("0", 5.0), ("1", 1.5), ("2", -2.0), ("-1", 8.5), ("-2", 12.0)],
        strict=True,
    ):
        assert marking.name == f"road 1 lane {name}"
        assert marking.type == ("dashed" if name == "-1" else "solid")
        assert (marking.kind, marking.colour, marking.painted) == ("line", "white", True)
        np.testing.assert_allclose(marking.points_map[:, 0], x, atol=1e-12)
        np.testing.assert_allclose(marking.points_map[[0, -1], 1], [-2.0, 18.0], atol=1e-12)
        np.testing.assert_array_equal(street.points_of(marking.element_id), marking.points_map)
    assert not street.dropped


@pytest.mark.parametrize("curvature", [0.02, -0.2, 1e-7])
def test_an_arc(tmp_path: Path, curvature: float) -> None:
    piece = geometry(f'<arc curvature="{curvature}"/>', length=25.0)
    points = middle_of(tmp_path, piece, length=25.0)
    s = np.linspace(0, 25.0, 26)
    np.testing.assert_allclose(points[:, 0], np.sin(curvature * s) / curvature, atol=1e-9)
    expected = 2 * np.sin(curvature * s / 2) ** 2 / curvature
    np.testing.assert_allclose(points[:, 1], expected, atol=1e-9)


def test_a_clothoid_from_a_straight_line_is_fresnel(tmp_path: Path) -> None:
    shape = '<spiral curvStart="0" curvEnd="0.1"/>'
    points = middle_of(tmp_path, geometry(shape, length=60.0), length=60.0)
    s, unit = np.linspace(0, 60.0, 61), np.sqrt(np.pi * 60.0 / 0.1)
    sine, cosine = fresnel(s / unit)
    np.testing.assert_allclose(points[:, :2], unit * np.column_stack([cosine, sine]), atol=1e-9)


def test_a_clothoid_that_turns_round_and_round(tmp_path: Path) -> None:
    shape = '<spiral curvStart="-0.3" curvEnd="0.8"/>'
    points = middle_of(tmp_path, geometry(shape, length=100.0), length=100.0)

    def heading(s: float) -> float:
        return -0.3 * s + 1.1 * s**2 / 200

    x = quad(lambda s: np.cos(heading(s)), 0, 100.0, limit=500, epsabs=1e-9)[0]
    y = quad(lambda s: np.sin(heading(s)), 0, 100.0, limit=500, epsabs=1e-9)[0]
    np.testing.assert_allclose(points[-1, :2], [x, y], atol=1e-7)


@pytest.mark.parametrize("share", [1.0, 1 / 30])
def test_a_parametric_cubic(tmp_path: Path, share: float) -> None:
    u, v = (0.0, 1 / share, 0.0, 0.0), (0.0, 0.0, 0.02 / share**2, -0.0003 / share**3)
    said = " ".join(
        f'{name}{axis}="{value!r}"'
        for axis, values in (("U", u), ("V", v))
        for name, value in zip("abcd", values, strict=True)
    )
    kind = "arcLength" if share == 1 else "normalized"
    shape = f'<paramPoly3 {said} pRange="{kind}"/>'
    points = middle_of(tmp_path, geometry(shape, length=30.0), length=30.0)
    s = np.linspace(0, 30.0, 31)
    np.testing.assert_allclose(points[:, 0], s, atol=1e-9)
    np.testing.assert_allclose(points[:, 1], 0.02 * s**2 - 0.0003 * s**3, atol=1e-9)


def test_a_cubic_is_measured_along_itself(tmp_path: Path) -> None:
    shape = '<poly3 a="0" b="0.5" c="0.02" d="-0.001"/>'
    points = middle_of(tmp_path, geometry(shape, length=20.0), length=20.0)
    np.testing.assert_allclose(
        points[:, 1], np.polynomial.polynomial.polyval(points[:, 0], [0, 0.5, 0.02, -0.001])
    )

    def speed(u: float) -> float:
        return float(np.hypot(1.0, 0.5 + 0.04 * u - 0.003 * u**2))

    assert quad(speed, 0, points[-1, 0])[0] == pytest.approx(20.0, abs=1e-3)
    assert quad(speed, 0, points[10, 0])[0] == pytest.approx(10.0, abs=1e-3)


def test_pieces_follow_each_other(tmp_path: Path) -> None:
    turn = geometry('<arc curvature="0.1"/>', s=10.0, x=10.0, length=10.0)
    points = middle_of(tmp_path, geometry(LINE, length=10.0), turn, length=20.0)
    np.testing.assert_allclose(points[:11, :2], [(x, 0.0) for x in range(11)], atol=1e-12)
    np.testing.assert_allclose(points[-1, :2], [10 + 10 * np.sin(1), 10 - 10 * np.cos(1)])


def test_widths_offsets_heights_and_roll(tmp_path: Path) -> None:
    profiles = (
        '<elevationProfile><elevation s="0" a="7" b="0.1" c="0" d="0"/>'
        '<elevation s="10" a="8" b="0" c="0.01" d="0"/></elevationProfile>'
        '<lateralProfile><superelevation s="0" a="0.05" b="0" c="0" d="0"/></lateralProfile>'
    )
    offset = '<laneOffset s="0" a="1" b="0" c="0" d="0"/>'
    lanes = [(1, lane(1, mark(), width=(3.0, 0.0, 0.01, 0.0)))]
    text = road([geometry(LINE, length=20.0)], lanes, length=20.0, profiles=profiles, offset=offset)
    (marking,) = read(tmp_path, text).markings
    s = marking.points_map[:, 0]
    np.testing.assert_allclose(s, np.arange(21.0), atol=1e-9)
    left = 1 + 3 + 0.01 * s**2
    np.testing.assert_allclose(marking.points_map[:, 1], left * np.cos(0.05), atol=1e-9)
    height = np.where(s < 10, 7 + 0.1 * s, 8 + 0.01 * (s - 10) ** 2)
    np.testing.assert_allclose(marking.points_map[:, 2], height + left * np.sin(0.05), atol=1e-9)


def test_marks_begin_where_they_say_in_their_section(tmp_path: Path) -> None:
    marks = mark(), mark("broken", "yellow", 12.5), mark("none", start=30)
    first = f"<center>{lane(0, *marks)}</center>"
    second = f"<center>{lane(0, mark('solid solid', width=0.12))}</center>"
    sections = [
        f'<laneSection s="40">{second}</laneSection>',
        f'<laneSection s="0">{first}</laneSection>',
    ]
    text = road([geometry(LINE, length=50.0)], length=50.0, sections=sections)
    found = [
        (m.type, m.colour, m.points_map[0, 0], m.points_map[-1, 0])
        for m in read(tmp_path, text).markings
    ]
    assert found == [
        ("solid", "white", 0.0, 12.5),
        ("dashed", "yellow", 12.5, 30.0),
        ("solid_solid", "white", 40.0, 50.0),
    ]


@pytest.mark.parametrize(
    ("lane_id", "kind", "expected"),
    [
        (0, "solid broken", "solid_dashed"),
        (-1, "solid broken", "solid_dashed"),
        (1, "solid broken", "dashed_solid"),
        (1, "broken solid", "solid_dashed"),
        (1, "solid solid", "solid_solid"),
        (0, "broken broken", "unknown"),
        (0, "botts dots", "unknown"),
    ],
)
def test_the_first_word_of_a_pair_is_on_the_left(
    tmp_path: Path, lane_id: int, kind: str, expected: str
) -> None:
    text = road([geometry(LINE, length=9.0)], [(lane_id, lane(lane_id, mark(kind)))], length=9.0)
    street = read(tmp_path, text)
    assert [m.type for m in street.markings] == [expected]
    assert street.dropped.total() == (expected == "unknown")


@pytest.mark.parametrize(
    ("text", "colour", "painted", "width"),
    [
        (mark(colour="standard", width=0.2), "white", True, 0.2),
        (mark(colour="yellow"), "yellow", True, np.nan),
        (mark(colour="blue", width=0), "blue", True, np.nan),
        (mark("curb"), "unknown", False, np.nan),
        (
            mark().replace("/>", '><type name="s"><line width="0.11"/></type></roadMark>'),
            "white",
            True,
            0.11,
        ),
    ],
)
def test_colours_and_widths(
    tmp_path: Path, text: str, colour: str, *, painted: bool, width: float
) -> None:
    (found,) = read(
        tmp_path, road([geometry(LINE, length=9.0)], [(0, lane(0, text))], length=9.0)
    ).markings
    assert (found.colour, found.painted) == (colour, painted)
    np.testing.assert_equal(found.width_m, width)


ROAD = road([geometry(LINE, x=1000.0, y=500.0, length=9.0)], [MIDDLE], length=9.0)


@pytest.mark.parametrize(
    ("proj", "place", "scale"),
    [
        ("+proj=tmerc +lat_0=49 +lon_0=8.4 +k=1 +x_0=0 +y_0=0 +datum=WGS84", (49, 8.4), 1.0),
        ("+proj=tmerc +lat_0=49 +lon_0=8.4 +k_0=1.0 +x_0=1000 +y_0=500 +ellps=GRS80", None, 1.0),
        ("+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs", None, 0.9996),
    ],
)
def test_a_grid_in_the_header(
    tmp_path: Path, proj: str, place: tuple[float, float] | None, scale: float
) -> None:
    shift = '<offset x="600000" y="5400000" z="9" hdg="0"/>' if "utm" in proj else ""
    street = read(tmp_path, ROAD, header=f"<geoReference><![CDATA[{proj}]]></geoReference>{shift}")
    assert street.georeference is not None
    assert street.georeference.scale == pytest.approx(scale, abs=2e-4)
    ends = street.georeference.geodetic(street.points.xyz_map)
    if "utm" in proj:
        np.testing.assert_allclose(street.points.xyz_map[0], [601_000, 5_400_500, 9])
    elif place is None:
        np.testing.assert_allclose(ends[0], [49.0, 8.4, 0.0], atol=1e-9)
    else:
        north_east = LocalFrame(*place, 0.0).local(ends * [1, 1, 0])[0, :2]
        np.testing.assert_allclose(north_east, [1000.0, 500.0], atol=0.02)
    assert not street.dropped


@pytest.mark.parametrize(
    "proj", ["+proj=merc +datum=WGS84", "+proj=utm +zone=99", "EPSG:25832", "+proj=tmerc +lat_0=x"]
)
def test_a_grid_that_is_not_understood_is_told_of(tmp_path: Path, proj: str) -> None:
    street = read(tmp_path, ROAD, header=f"<geoReference>{proj}</geoReference>")
    assert street.georeference is None
    assert [key for key in street.dropped if "no transverse Mercator" in key]


def test_an_origin_places_a_file_that_says_nothing(tmp_path: Path) -> None:
    origin = LocalFrame(49.0, 8.4, 100.0)
    street = load_map(write_xodr(tmp_path / "map.xodr", ROAD), origin)
    assert street.origin == origin
    np.testing.assert_allclose(street.points.xyz_map[0], [1000.0, 500.0, 0.0])


def test_what_is_not_read_is_counted(tmp_path: Path) -> None:
    more = '<signals><signal id="1"/><signal id="2"/></signals><objects><object id="3"/></objects>'
    street = read(tmp_path, ROAD.replace("</road>", f"{more}</road>"))
    assert sorted(street.dropped.values()) == [1, 2]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<OpenDRIVE/>", "holds no markings"),
        ("<osm/>", "is no OpenDRIVE file; its root is <osm>"),
        ("<OpenDRIVE><road", "is no XML"),
        (
            '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><OpenDRIVE>&x;</OpenDRIVE>',
            "document type",
        ),
        (
            f"<OpenDRIVE>{road([], [MIDDLE], length=9.0)}</OpenDRIVE>",
            "road 1: has no reference line",
        ),
        (f"<OpenDRIVE>{ROAD.replace('<line/>', '<bow/>')}</OpenDRIVE>", "without a known shape"),
        (
            f"<OpenDRIVE>{ROAD.replace('1000.0', 'far')}</OpenDRIVE>",
            "geometry x='far' is no number",
        ),
        (f"<OpenDRIVE>{ROAD.replace('9.0', 'nan')}</OpenDRIVE>", "length='nan' is no number"),
        (f"<OpenDRIVE>{ROAD.replace('9.0', '1e300')}</OpenDRIVE>", "is no length of a road"),
        (f"<OpenDRIVE>{ROAD.replace('9.0', '-9.0')}</OpenDRIVE>", "is no length of a road"),
        (
            f"<OpenDRIVE>{ROAD.replace('1000.0', '1e308').replace('500.0', '1e309')}</OpenDRIVE>",
            "no number",
        ),
    ],
)
def test_hostile_files_are_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "map.xodr"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        load_map(path)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
@pytest.mark.parametrize("number", ["1e200", "-1e9"])
def test_a_road_that_leaves_the_earth_is_refused(tmp_path: Path, number: str) -> None:
    with pytest.raises(InputError, match="leaves all bounds"):
        read(tmp_path, ROAD.replace("1000.0", number))


def test_too_many_points_are_refused(tmp_path: Path) -> None:
    lanes = [(-k, lane(-k, mark())) for k in range(1, 9)]
    with pytest.raises(InputError, match="more than 5000000 points"):
        read(tmp_path, road([geometry(LINE, length=9e5)], lanes, length=9e5))
