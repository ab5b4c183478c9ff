"""Pictures and charts for reports: what is drawn where, and that names cannot break out."""

from __future__ import annotations

import base64
import re
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest

from percept.core.errors import GeometryError
from percept.export.charts import histogram, timeline
from percept.export.palette import class_colour, class_colours, cluster_colours, hex_colour
from percept.export.pictures import birds_eye, png_data_uri

_CLASSES = (
    "barrel", "barricade", "sign", "pedestrian", "deer", "car", "truck", "cyclist", "cone",
    "unknown",
)  # fmt: skip
_NONE = np.zeros(0, np.int32)
_SVG = "{http://www.w3.org/2000/svg}"


def _scene(points: list[list[float]], ids: list[int], ground: list[bool]) -> np.ndarray:
    return birds_eye(
        np.array(points), np.array(ground), np.array(ids), np.zeros((0, 7)), (), extent_m=30,
        size_px=601,
    )  # fmt: skip


def _box(label: str, x: float = 10, y: float = -10, yaw: float = 0.0) -> np.ndarray:
    box = np.array([[x, y, 0, 8.0, 4.0, 2, yaw]])
    return birds_eye(
        np.zeros((0, 3)), _NONE.astype(bool), _NONE, box, (label,), extent_m=30, size_px=601
    )


def _has(image: np.ndarray, column: int, row: int, rgb: tuple[int, int, int]) -> bool:
    patch = image[row - 1 : row + 2, column - 1 : column + 2].reshape(-1, 3)
    return bool((patch == rgb[::-1]).all(axis=1).any())


def test_each_class_has_a_colour_of_its_own() -> None:
    assert len({class_colour(label) for label in _CLASSES}) == len(_CLASSES)
    assert hex_colour(class_colour("car")) == "#56b4e9"


def test_a_foreign_class_keeps_its_colour_and_none_of_the_clusters_is_grey() -> None:
    assert class_colour("zebra") == class_colour("zebra") != class_colour("unknown")
    colours = cluster_colours(np.array([-1, 0, 1, 2]))
    assert len({tuple(c) for c in colours.tolist()}) == 4
    assert np.ptp(colours[0]) == 0


def test_forward_is_up_and_left_is_left() -> None:
    image = _scene([[20.0, 10.0, 0]], [3], [False])
    rgb = tuple(int(c) for c in cluster_colours(np.array([3]))[0])
    assert _has(image, 200, 100, (rgb[0], rgb[1], rgb[2]))


def test_what_stands_is_drawn_over_ground_and_far_points_are_left_out() -> None:
    points = [[20.0, 10.0, 1], [20.0, 10.0, 0], [300.0, 0, 0]]
    only = _scene(points[:1], [0], [False])
    np.testing.assert_array_equal(_scene(points, [0, -1, 1], [False, True, False]), only)


def test_a_box_lies_where_it_is_and_its_tick_points_ahead() -> None:
    image, car = _box("car"), class_colour("car")
    for column, row in ((380, 200), (420, 200), (400, 160), (400, 240), (400, 145)):
        assert _has(image, column, row, car)
    assert not _has(image, 400, 255, car)
    turned = _box("car", yaw=np.pi / 2)  # to the left
    assert _has(turned, 345, 200, car)
    assert not _has(turned, 455, 200, car)


def test_names_stand_beside_boxes_of_a_known_class_only() -> None:
    def text_pixels(label: str) -> int:
        beside = _box(label)[190:212, 424:500].astype(int)
        return int((np.abs(beside - class_colour(label)[::-1]).sum(axis=2) < 60).sum())

    assert text_pixels("car") > 10
    assert text_pixels("unknown") == 0


def test_names_do_not_cover_each_other() -> None:
    box = np.array([[10.0, -10, 0, 2, 2, 2, 0]])
    one, sixty = (
        birds_eye(
            np.zeros((0, 3)), _NONE.astype(bool), _NONE, np.repeat(box, n, 0), ("car",) * n,
            extent_m=30,
        )
        for n in (1, 60)
    )  # fmt: skip
    # Right of the box (column 615) the name of one stands, and no other is written over it.
    assert (one[:, 620:] == class_colour("car")[::-1]).all(axis=2).any()
    np.testing.assert_array_equal(one[:, 620:], sixty[:, 620:])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_sensor_that_sees_one_side_does_not_leave_the_picture_half_empty(side: float) -> None:
    points = np.random.default_rng(3).uniform([0, -20, 0], [70, 20, 2], (20_000, 3))
    points[:, 0] *= side
    ids = np.zeros(len(points), np.int32)
    image = birds_eye(points, ids.astype(bool), ids, np.zeros((0, 7)), ())
    drawn = (image == cluster_colours(ids[:1])[0][::-1]).all(axis=2)
    rows = np.flatnonzero(drawn.any(axis=1))
    assert rows.max() - rows.min() > 0.75 * len(image)
    ego = (image == np.array((236, 232, 228))).all(axis=2).any(axis=1)
    assert ego[450:].any() if side > 0 else ego[:450].any()


def test_an_empty_scan_is_a_picture_too() -> None:
    image = birds_eye(np.zeros((0, 3)), _NONE.astype(bool), _NONE, np.zeros((0, 7)), ())
    assert image.shape == (900, 900, 3)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 3


@pytest.mark.parametrize(
    ("ids", "labels", "extent_m"), [([0, 1], (), 30.0), ([0], ("car",), 30.0), ([0], (), -1.0)]
)
def test_columns_that_do_not_fit_are_refused(
    ids: list[int], labels: tuple[str, ...], extent_m: float
) -> None:
    with pytest.raises(GeometryError):
        birds_eye(
            np.zeros((1, 3)), np.zeros(1, bool), np.array(ids), np.zeros((0, 7)), labels,
            extent_m=extent_m,
        )  # fmt: skip


def test_a_png_comes_back_as_it_was() -> None:
    image = np.random.default_rng(1).integers(0, 256, (7, 9, 3), np.uint8)
    head, data = png_data_uri(image).split(",")
    assert head == "data:image/png;base64"
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(decoded, image)


@pytest.mark.parametrize("shape", [(0, 4, 3), (4, 4, 2), (4,)])
def test_what_is_no_picture_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(GeometryError):
        png_data_uri(np.zeros(shape, np.uint8))


def test_bars_stack_in_proportion_to_their_counts() -> None:
    root = ET.fromstring(histogram("t", "m", ["0-10", "10-20"], {"car": [3, 0], "deer": [1, 8]}))  # noqa: S314
    heights = {
        title.text: float(rect.get("height", "nan"))
        for rect in root.iter(f"{_SVG}rect")
        if (title := rect.find(f"{_SVG}title")) is not None and ":" in (title.text or "")
    }
    assert set(heights) == {"car, 0-10: 3", "deer, 0-10: 1", "deer, 10-20: 8"}
    assert heights["deer, 10-20: 8"] == pytest.approx(8 * heights["deer, 0-10: 1"], abs=0.5)
    assert heights["car, 0-10: 3"] == pytest.approx(3 * heights["deer, 0-10: 1"], abs=0.5)


def test_a_timeline_breaks_where_a_value_is_missing() -> None:
    root = ET.fromstring(timeline("t", [5.0, 6, 7, 8, 9], {"ms": [1, 2, float("nan"), 4, 4]}))  # noqa: S314
    lines = [p.get("d", "") for p in root.iter(f"{_SVG}path") if p.get("stroke")]
    assert [line.count("L") for line in lines] == [1, 1]


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", "a & b", 'x" onload="y'])
def test_names_cannot_break_out_of_a_chart(name: str) -> None:
    for svg in (
        histogram(name, name, [name], {name: [1]}),
        timeline(name, [0.0, 1.0], {name: [1.0, 2.0]}),
    ):
        root = ET.fromstring(svg)  # noqa: S314
        assert not list(root.iter(f"{_SVG}script"))
        assert all("onload" not in element.attrib for element in root.iter())
        assert name in [element.text for element in root.iter(f"{_SVG}text")]


def test_empty_charts_are_valid() -> None:
    for svg in (histogram("t", "m", [], {}), timeline("t", [], {"ms": []}), timeline("t", [], {})):
        assert ET.fromstring(svg).tag == f"{_SVG}svg"  # noqa: S314


def test_charts_refuse_columns_of_another_length() -> None:
    with pytest.raises(GeometryError):
        histogram("t", "m", ["a"], {"car": [1, 2]})
    with pytest.raises(GeometryError):
        timeline("t", [0.0], {"ms": [1.0, 2.0]})


def test_the_classes_of_a_chart_have_colours_of_their_own() -> None:
    foreign = [f"class {k}" for k in range(20)]
    colours = class_colours(["car", *foreign, "unknown"])
    assert list(colours) == ["car", "unknown", *foreign]
    assert len(set(colours.values())) == 22
    assert (colours["car"], colours["unknown"]) == (class_colour("car"), class_colour("unknown"))
    assert all(max(rgb) > 80 for rgb in colours.values())  # seen on a dark ground
    assert len(class_colours([f"{k}" for k in range(100)])) == 100
    svg = histogram("t", "x", ["a"], {label: [1] for label in foreign})
    bars = set(re.findall(r'fill="(#[0-9a-f]{6})"><title>class', svg))
    assert len(bars) == 20
