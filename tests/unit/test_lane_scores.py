"""Lanes against truth, in metres and in pixels: numbers that can be worked out by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from percept.core.errors import InputError
from percept.core.results import Verdict
from percept.core.trajectory import Trajectory
from percept.evaluation.lane_files import (
    is_tusimple,
    lanes_of_documents,
    named_alike,
    read_documents,
    read_mask_lanes,
    seen_frames,
    tusimple_lanes,
)
from percept.evaluation.lane_pixels import ImageLanes, lanes_of_mask, score_pixel_lanes
from percept.evaluation.lane_scores import RoadLaneScores
from percept.evaluation.lanes import SeenFrame, SeenLine, score_road_lanes
from percept.evaluation.road_truth import RoadMarking, read_road_markings

# The vehicle stands at 100, 50 in the map and looks along its y axis: base x is map y.
POSE = np.array([[0.0, -1, 0, 100], [1, 0, 0, 50], [0, 0, 1, 0], [0, 0, 0, 1]])
POSES = Trajectory("map", "base_link", np.array([0, 10**9]), np.array([POSE, POSE]))


def marking(kind: str, points_base: list[list[float]], **words: str) -> RoadMarking:
    points = np.array([[x, y, 0.0, 1.0] for x, y in points_base]) @ POSE.T
    return RoadMarking(
        kind=kind,
        type=words.get("type", "solid"),
        colour=words.get("colour", "white"),
        points_map=points[:, :3],
    )


ROAD = [
    marking("line", [[-20, 1.75], [20, 1.75]], colour="yellow"),
    marking("line", [[20, 1.75], [60, 1.75]], type="dashed", colour="yellow"),
    marking("line", [[60, -1.75], [-20, -1.75]]),
    marking("stop_line", [[10, -1.7], [10, 1.7]]),
]


def line(side: str, y: float, span: tuple[float, float], **words: str) -> SeenLine:
    x = np.arange(span[0], span[1] + 0.5, 1.0)
    return SeenLine(
        side=side,
        points_m=np.column_stack([x, np.full(len(x), y)]),
        type=words.get("type", "solid"),
        colour=words.get("colour", "white"),
    )


def scored(*lines: SeenLine, stops: tuple[float, ...] = (), stamp_ns: int = 5) -> RoadLaneScores:
    frame = SeenFrame(stamp_ns=stamp_ns, lines=lines, stop_lines_m=stops)
    return score_road_lanes([frame], ROAD, POSES)


def test_errors_are_signed_and_banded_by_range() -> None:
    scores = scored(line("left", 1.85, (6, 9), colour="yellow"), line("right", -1.8, (16, 19)))
    bands = scores.lateral_bands()
    assert bands["5-10"].errors_m == pytest.approx([0.1] * 4)
    assert bands["15-20"].errors_m == pytest.approx([-0.05] * 4)
    assert not len(bands["10-15"].errors_m)
    assert bands["5-10"].document()["mean_abs_m"] == pytest.approx(0.1)
    assert scores.document()["both_sides_share"] == 1.0


def test_points_far_from_any_line_are_strays() -> None:
    scores = scored(line("other", 0.2, (5, 9)))
    assert scores.stray_points == 5
    assert not len(scores.lateral)
    assert scores.document()["both_sides_share"] == 0.0
    assert scores.verdict is Verdict.BAD


def test_type_and_colour_count_by_length() -> None:
    """15 m to 25 m of a line that is solid up to 20 m, said to be solid and yellow."""
    scores = scored(line("left", 1.75, (15, 25), colour="yellow"))
    assert scores.length_m == pytest.approx(10.0)
    assert scores.document()["type_share"] == pytest.approx(0.5, abs=0.06)
    assert scores.document()["colour_share"] == 1.0
    unsure = scored(line("left", 1.75, (5, 10), type="unknown", colour="white")).document()
    assert (unsure["unknown_type_share"], unsure["type_share"]) == (1.0, 0.0)
    assert (unsure["unknown_colour_share"], unsure["colour_share"]) == (0.0, 0.0)


def test_a_side_is_right_only_on_its_own_line() -> None:
    swapped = scored(line("left", -1.75, (5, 9)), line("right", 1.75, (5, 9)))
    assert swapped.both_sides == 0


def test_stop_lines_are_found_false_or_missed() -> None:
    seen = scored(line("left", 1.75, (5, 9)), stops=(10.2, 25.0))
    assert seen.stop_line_bands()["6-12"].errors_m == pytest.approx([0.2])
    assert seen.false_stops == 1
    assert seen.document()["stop_lines_found_share"]["6-12"] == 1.0
    missed = scored(line("left", 1.75, (5, 9))).document()
    assert missed["stop_lines_found_share"]["6-12"] == 0.0
    assert missed["stop_lines_found_share"]["0-6"] is None


def test_images_without_a_pose_are_counted() -> None:
    scores = scored(line("left", 1.75, (5, 9)), stamp_ns=2 * 10**9)
    assert scores.frames == 0
    assert scores.verdict is Verdict.BAD
    assert list(scores.dropped.values()) == [1]


ROWS = np.arange(200.0, 700.0, 10.0)


def lanes(*columns: float, slope: float = 0.0, image: str = "a.png") -> ImageLanes:
    u = [c + slope * (ROWS - 700) for c in columns]
    return ImageLanes(image=image, rows_px=ROWS, lanes_px=np.array(u).reshape(-1, len(ROWS)))


@pytest.mark.parametrize(
    ("shift", "slope", "accuracy", "fn"),
    [
        (19.0, 0.0, 1.0, 0.0),
        (21.0, 0.0, 0.0, 1.0),
        (27.0, 1.0, 1.0, 0.0),  # 20 px / cos(45 deg) is 28.3 px
        (29.0, 1.0, 0.0, 1.0),
    ],
)
def test_a_point_is_right_within_20_px_across_the_lane(
    shift: float, slope: float, accuracy: float, fn: float
) -> None:
    truth, ours = lanes(600, 1100, slope=slope), lanes(600 + shift, 1100 + shift, slope=slope)
    figures = score_pixel_lanes([ours], [truth]).document()
    assert (figures["accuracy"], figures["fn"], figures["fp"]) == (accuracy, fn, fn)


def test_a_lane_is_found_from_85_percent_of_its_rows_on() -> None:
    truth = lanes(600)
    for wrong, fn in ((7, 0.0), (8, 1.0)):  # of 50 rows: 0.86 and 0.84 are right
        u = truth.lanes_px.copy()
        u[0, :wrong] += 100
        ours = ImageLanes(image="a.png", rows_px=ROWS, lanes_px=u)
        figures = score_pixel_lanes([ours], [truth]).document()
        assert figures["accuracy"] == pytest.approx(1 - wrong / 50)
        assert figures["fn"] == fn


def test_the_fifth_lane_is_forgiven_and_spare_lanes_are_not() -> None:
    five = lanes(100, 300, 500, 700, 900)
    figures = score_pixel_lanes([lanes(100, 300, 500, 700)], [five]).document()
    assert (figures["accuracy"], figures["fp"], figures["fn"]) == (1.0, 0.0, 0.0)
    figures = score_pixel_lanes([lanes(100, 300, 500)], [five]).document()
    assert (figures["accuracy"], figures["fn"]) == (0.75, 0.25)
    figures = score_pixel_lanes([lanes(100, 300, 500)], [lanes(100, 300)]).document()
    assert figures["fp"] == pytest.approx(1 / 3)
    figures = score_pixel_lanes([lanes(100, 300, 500, 700)], [lanes(100)]).document()
    assert (figures["accuracy"], figures["fp"], figures["fn"]) == (0.0, 0.0, 1.0)
    figures = score_pixel_lanes([lanes()], [lanes(100)]).document()
    assert (figures["accuracy"], figures["fp"], figures["fn"]) == (0.0, 0.0, 1.0)


def test_images_meet_by_name() -> None:
    scores = score_pixel_lanes([lanes(5, image="b.png")], [lanes(5)])
    assert scores.verdict is Verdict.BAD
    assert sum(scores.dropped.values()) == 2
    one, two = lanes(5, image="x/a.jpg"), lanes(5, image="x/b.jpg")
    labels = [lanes(5, image="b.png"), lanes(5, image="a.png")]
    assert [r.image for r in named_alike([one, two], labels)] == ["a.png", "b.png"]
    assert named_alike([one], labels[:1])[0].image == "b.png"


def test_masks_give_the_middles_of_their_lanes(tmp_path: Path) -> None:
    mask = np.zeros((100, 200), np.uint8)
    mask[35:, 48:53] = 20
    mask[45:, 150:157] = 70
    mask[99, 190] = 120  # a speck
    found = lanes_of_mask(mask, "m")
    assert found.rows_px.tolist() == [40, 50, 60, 70, 80, 90]
    assert found.lanes_px.tolist() == [[50] * 6, [-2] + [153] * 5]
    cv2.imwrite(str(tmp_path / "m.png"), mask)
    read, widths = read_mask_lanes([tmp_path / "m.png"])
    assert np.array_equal(read[0].lanes_px, found.lanes_px)
    assert widths == {"m.png": 200}
    scores = score_pixel_lanes(read, read, widths)
    assert (scores.ego_rows, scores.ego_right) == (11, 11)
    (tmp_path / "no.png").write_text("no image")
    with pytest.raises(InputError, match=r"no\.png: cannot be read as an image"):
        read_mask_lanes([tmp_path / "no.png"])


def test_results_are_sampled_at_the_rows_of_the_labels(tmp_path: Path) -> None:
    ours = {"image": "a.png", "lines": [{"points_px": [[600, 695], [350, 195]]}]}
    path = tmp_path / "lanes.json"
    path.write_text(json.dumps(ours))
    found = lanes_of_documents(read_documents(path), path)
    truth = ImageLanes(image="a.png", rows_px=ROWS, lanes_px=np.array([600 + 0.5 * (ROWS - 695)]))
    assert score_pixel_lanes(found, [truth]).document()["accuracy"] == 1.0


def test_files_in_every_form(tmp_path: Path) -> None:
    one = {"stamp_ns": 5, "lines": [{"side": "left", "points_m": [[5, 1], [6, 1]]}],
           "stop_lines": [{"distance_m": 9.5}]}  # fmt: skip
    forms = [json.dumps(one), json.dumps([one]), json.dumps({"frames": [one]}),
             json.dumps(one) + "\n" + json.dumps(one)]  # fmt: skip
    for text, count in zip(forms, (1, 1, 1, 2), strict=True):
        path = tmp_path / "lanes.json"
        path.write_text(text)
        frames = seen_frames(read_documents(path), path)
        assert len(frames) == count
        assert frames[0].stop_lines_m == (9.5,)
        assert frames[0].lines[0].points_m.tolist() == [[5, 1], [6, 1]]
    label: list[dict[str, Any]] = [{"lanes": [[5, -2]], "h_samples": [240, 250], "raw_file": "a"}]
    assert is_tusimple(label)
    assert tusimple_lanes(label, tmp_path)[0].lanes_px.tolist() == [[5, -2]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "holds no image"),
        ("[1]", "is no list of objects"),
        ("{}\n{", "line 2 is no JSON"),
        ('{"stamp_ns": 1}', "entry 0 has no lines"),
        ('{"lines": []}', "entry 0 has no stamp_ns"),
        ('{"stamp_ns": 1, "lines": [{"points_m": [[1, 2], [3]]}]}', "points_m are no points"),
        ('{"stamp_ns": 1, "lines": [{"points_px": [[1, 2]]}]}', "in pixels only"),
    ],
)
def test_files_that_do_not_fit_are_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "lanes.json"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        seen_frames(read_documents(path), path)
    assert said in str(refused.value)


def test_the_paint_of_a_road_is_read_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "markings.geojson"
    properties = {"kind": "line", "type": "solid", "colour": "white",
                  "points_m": [[0, 0, 0], [1, 0, 0]]}  # fmt: skip
    path.write_text(json.dumps({"features": [{"properties": properties}]}))
    assert read_road_markings(path)[0].points_map.shape == (2, 3)
    path.write_text(json.dumps({"features": [{"properties": {**properties, "points_m": [[0]]}}]}))
    with pytest.raises(InputError, match="are no line"):
        read_road_markings(path)
