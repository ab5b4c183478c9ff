"""Lanes in real images and on a drawn road: the figures that the benchmark prints."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from real_lanes import (
    CARND_CAMERA,
    both_found,
    carnd_camera,
    ego_lines_of_mask,
    lane_pixels,
    rows_within,
    video_frames,
)

from percept.core.errors import GeometryError
from percept.core.lane_markings import LaneDetections
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.lanes import LaneConfig, detect_lanes, lane_radius

_METHODS = ("windows", "hough")
_HEIGHT_M, _PITCH_RAD = 1.5, np.radians(3.0)
_SIZE, _FOCAL = (960, 600), 700.0
_SAMPLES = 2  # a pixel, each way
_WHITE, _YELLOW = (235, 235, 235), (60, 190, 235)


def _config(method: str, **values: object) -> LaneConfig:
    return LaneConfig.model_validate({"method": method, **values})


def _image(path: Path) -> NDArray[np.uint8]:
    return np.asarray(cv2.imread(str(path)), dtype=np.uint8)


@pytest.mark.slow
def test_the_numbers_of_the_calibration_are_those_of_its_images(shared_data: Path) -> None:
    camera = carnd_camera(shared_data)
    assert pytest.approx(CARND_CAMERA.K, rel=1e-3) == camera.K
    assert camera.distortion == pytest.approx(CARND_CAMERA.distortion, abs=5e-3)


def _tusimple_shares(shared_data: Path, method: str, *, across: bool) -> list[float]:
    """Return the share of rows within 20 px of the labels, frame by frame."""
    folder = shared_data / "lane" / "tusimple_lanenet" / "training_data_example"
    shares = []
    for file in sorted((folder / "image").glob("*.png")):
        truth = ego_lines_of_mask(_image(folder / "gt_instance_image" / file.name)[..., 0])
        found = lane_pixels(detect_lanes(_image(file), None, _config(method)))
        shares.append(rows_within(found, truth, 20.0, across=across))
    assert len(shares) == 3
    return shares


@pytest.mark.parametrize("method", _METHODS)
def test_tusimple_rows_are_within_20_px(shared_data: Path, method: str) -> None:
    shares = _tusimple_shares(shared_data, method, across=False)
    assert sum(share >= 0.95 for share in shares) == 2
    assert np.mean(shares) >= 0.85


@pytest.mark.parametrize(
    "method",
    [
        pytest.param(
            "windows",
            marks=pytest.mark.xfail(
                reason="0.74 in the third frame: a car ahead bends the far end of the left line",
                raises=AssertionError,
            ),
        ),
        "hough",
    ],
)
def test_every_tusimple_frame_is_within_20_px_across_its_lines(
    shared_data: Path, method: str
) -> None:
    assert min(_tusimple_shares(shared_data, method, across=True)) >= 0.85


@pytest.mark.parametrize("method", _METHODS)
def test_lanes_without_labels_are_found(shared_data: Path, method: str) -> None:
    tusimple = sorted((shared_data / "lane/tusimple_lanenet/tusimple_test_image").glob("*.jpg"))
    stills = sorted((shared_data / "lane/carnd_p1").glob("*.jpg"))
    assert len(tusimple) == 4
    assert len(stills) == 6
    for file in (*tusimple, *stills):
        assert both_found(detect_lanes(_image(file), None, _config(method))), file.name


def test_straight_lines_are_straight_and_as_wide_as_a_lane(shared_data: Path) -> None:
    image = _image(shared_data / "lane/carnd_advanced/straight_lines1.jpg")
    for method in _METHODS:
        found = detect_lanes(image, CARND_CAMERA, _config(method, camera_height_m=1.22))
        radius = lane_radius(found)
        assert found.lane_width_m == pytest.approx(3.7, rel=0.1)
        assert radius is not None
        assert radius > 2000
        left, right = found.line("left"), found.line("right")
        assert left is not None
        assert right is not None
        assert (left.type, left.colour) == ("solid", "yellow")
        assert (right.type, right.colour) == ("dashed", "white")
        assert np.all(np.diff(left.sd_m) > 0)


@pytest.mark.parametrize("name", ["test1", "test2", "test3"])
def test_other_frames_have_both_lines_or_say_what_is_missing(shared_data: Path, name: str) -> None:
    image = _image(shared_data / f"lane/carnd_advanced/{name}.jpg")
    for method in _METHODS:
        found = detect_lanes(image, CARND_CAMERA, _config(method, camera_height_m=1.22))
        if both_found(found):
            assert found.lane_width_m == pytest.approx(3.7, rel=0.1)
        else:
            assert any("not found" in note for note in found.notes)


def test_a_clip_has_both_lines_in_nearly_all_frames(shared_data: Path) -> None:
    frames = video_frames(shared_data / "lane/carnd_p1/solidWhiteRight.mp4")[::20]
    assert len(frames) > 10
    share = np.mean([both_found(detect_lanes(frame)) for frame in frames])
    assert share >= 0.95


def _sensor() -> CameraSensor:
    """A camera that looks ahead and 3 deg down, 1.5 m over the road."""
    c, s = np.cos(_PITCH_RAD), np.sin(_PITCH_RAD)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[0, -s, c], [-1, 0, 0], [0, -c, -s]])
    matrix[:3, 3] = [1.2, 0.0, _HEIGHT_M]
    return CameraSensor(
        name="front",
        topic=None,
        frame="front",
        image_size=_SIZE,
        model="pinhole",
        K=(_FOCAL, _FOCAL, (_SIZE[0] - 1) / 2, (_SIZE[1] - 1) / 2),
        distortion=(-0.1, 0.02, 0.0, 0.0, 0.0),
        T_base_sensor=Transform("base_link", "front", matrix),
    )


@cache
def _places() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return x and y on the road of what each sample of the image shows."""
    sensor = _sensor()
    assert sensor.T_base_sensor is not None
    u, v = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in _SIZE))
    middles = sensor.camera().unproject(np.column_stack([u.ravel(), v.ravel()]))
    between = cv2.resize(middles.reshape(*u.shape, 3), None, fx=_SAMPLES, fy=_SAMPLES)
    rays = between.reshape(-1, 3) @ sensor.T_base_sensor.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(rays[:, 2] < -1e-3, _HEIGHT_M / -rays[:, 2], np.nan)
        return 1.2 + rays[:, 0] * far, rays[:, 1] * far


def _drawn(
    lines: list[tuple[float, str, tuple[int, int, int]]],
    *,
    stop_m: float | None = None,
    radius_m: float = np.inf,
    shadow: bool = False,
) -> NDArray[np.uint8]:
    """Render a flat road: for each pixel the paint at the place that it shows."""
    x, y = _places()
    with np.errstate(divide="ignore", invalid="ignore"):
        y = y - np.where(np.isfinite(radius_m), x**2 / (2 * radius_m), 0)
    noise = np.random.default_rng(3).normal(0, 4, x.shape)
    colours = np.full((len(x), 3), 200.0)
    on_road = np.isfinite(x) & (x < 90)
    colours[on_road] = 95
    for offset, kind, colour in lines:
        painted = on_road & _on_line(x, y - offset, kind)
        colours[painted] = colour
    if stop_m is not None:
        colours[on_road & (x > stop_m) & (x < stop_m + 0.4) & (np.abs(y) < 1.7)] = _WHITE
    if shadow:
        colours[on_road & (x > 9) & (x < 14)] *= 0.4
    colours[on_road] += noise[on_road, None]
    image = np.clip(colours, 0, 255).reshape(_SIZE[1] * _SAMPLES, _SIZE[0] * _SAMPLES, 3)
    small = cv2.resize(image, _SIZE, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def _on_line(x: NDArray[np.float64], off: NDArray[np.float64], kind: str) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        if kind == "solid_solid":
            return np.asarray(np.abs(np.abs(off) - 0.12) < 0.06)
        near = np.abs(off) < 0.065
        return np.asarray(near if kind == "solid" else near & (np.mod(x, 9.0) < 3.0))


def _offset(found: LaneDetections, side: str, true_m: float) -> float:
    line = found.line(side)
    assert line is not None
    near = line.points_m[:, 0] < 15
    return float(np.abs(line.points_m[near, 1] - true_m).mean())


@pytest.mark.parametrize("method", _METHODS)
def test_a_drawn_road_is_measured_in_metres(method: str) -> None:
    image = _drawn([(1.6, "dashed", _WHITE), (-1.9, "solid", _YELLOW)], stop_m=10.0)
    found = detect_lanes(image, _sensor(), _config(method))
    left, right = found.line("left"), found.line("right")
    assert left is not None
    assert right is not None
    assert _offset(found, "left", 1.6) < 0.05
    assert _offset(found, "right", -1.9) < 0.05
    assert (left.type, left.colour) == ("dashed", "white")
    assert (right.type, right.colour) == ("solid", "yellow")
    assert found.lane_width_m == pytest.approx(3.5, abs=0.1)
    assert [stop.distance_m for stop in found.stop_lines] == pytest.approx([10.0], abs=0.3)
    assert right.width_m == pytest.approx(0.13, abs=0.06)


def test_a_pair_of_lines_is_told_from_one() -> None:
    image = _drawn([(1.6, "solid_solid", _YELLOW), (-1.9, "dashed", _WHITE)])
    left = detect_lanes(image, _sensor()).line("left")
    assert left is not None
    assert (left.type, left.colour) == ("solid_solid", "yellow")
    near = left.points_m[:, 0] < 15
    assert np.abs(left.points_m[near, 1] - 1.6).mean() < 0.06


def test_a_bend_and_a_shadow_do_no_harm() -> None:
    lines = [(1.7, "solid", _WHITE), (-1.7, "dashed", _WHITE)]
    found = detect_lanes(_drawn(lines, radius_m=300.0, shadow=True), _sensor())
    radius = lane_radius(found)
    assert both_found(found)
    assert radius is not None
    assert 220 < radius < 420


def test_a_missing_line_is_said_to_be_missing() -> None:
    found = detect_lanes(_drawn([(1.7, "solid", _WHITE)]), _sensor())
    right = found.line("right")
    assert right is not None
    assert right.confidence <= 0.1
    assert right.type == right.colour == "unknown"
    assert any("right line was not found" in note for note in found.notes)
    assert found.lane_width_m is None
    assert not both_found(found)


def test_an_empty_road_and_no_road_have_no_lines() -> None:
    found = detect_lanes(_drawn([]), _sensor())
    assert found.lines == ()
    assert "left and right line were not found" in found.notes
    nothing = detect_lanes(np.full((200, 300, 3), 127, np.uint8))
    assert nothing.lines == ()
    assert "no lines were found" in nothing.notes[0]


def test_a_mask_takes_the_place_of_the_thresholds() -> None:
    lines = [(1.6, "solid", _WHITE), (-1.9, "solid", _WHITE)]
    paint = _drawn(lines)
    blank = _drawn([])
    asked = []

    def mask(image: NDArray[np.uint8]) -> NDArray[np.float32]:
        asked.append(image.shape)
        return (paint[..., 0] > 180).astype(np.float32) * (np.arange(_SIZE[1])[:, None] > 320)

    assert not detect_lanes(blank, _sensor()).lines
    for method in _METHODS:
        found = detect_lanes(blank, _sensor(), _config(method), paint_mask=mask)
        assert _offset(found, "left", 1.6) < 0.06
        assert _offset(found, "right", -1.9) < 0.06
    assert asked == [blank.shape] * 2


def test_what_is_no_image_of_the_camera_is_refused() -> None:
    with pytest.raises(GeometryError, match="uint8"):
        detect_lanes(np.zeros((10, 10), np.uint8))
    with pytest.raises(GeometryError, match="300x200"):
        detect_lanes(np.zeros((200, 300, 3), np.uint8), _sensor())
    with pytest.raises(GeometryError, match="mask"):
        detect_lanes(
            _drawn([(1.6, "solid", _WHITE)]),
            _sensor(),
            paint_mask=lambda _image: np.zeros((3, 3), np.float32),
        )
