"""Images into the input of a network and boxes back: exact, for every size and kind of fit."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.detection.images.letterbox import Fit, Letterbox
from percept.detection.images.pixels import PIXEL_FORMATS, as_bgr8, name_of_pixels
from percept.detection.networks.layout import PixelFormat

_sides = st.integers(1, 5000)
_fits = st.sampled_from(["centre", "corner", "stretch"])


def test_sizes_by_hand() -> None:
    full_hd = Letterbox.plan((1920, 1080), (640, 640))
    assert (full_hd.resized, full_hd.offset) == ((640, 360), (0, 140))
    # 375 * 416 / 1242 = 125.6: rounded by ultralytics, cut off by YOLOX.
    centre = Letterbox.plan((1242, 375), (416, 416))
    assert (centre.resized, centre.offset) == ((416, 126), (0, 145))
    assert centre.gain == (416 / 1242, 126 / 375)
    corner = Letterbox.plan((1242, 375), (416, 416), "corner")
    assert (corner.resized, corner.offset) == ((416, 125), (0, 0))
    assert corner.gain == (416 / 1242, 416 / 1242)
    stretch = Letterbox.plan((1242, 375), (416, 416), "stretch")
    assert (stretch.resized, stretch.offset) == ((416, 416), (0, 0))
    odd = Letterbox.plan((640, 481), (640, 640))  # 79 rows above and 80 below
    assert (odd.resized, odd.offset) == ((640, 481), (0, 79))
    assert Letterbox.plan((481, 640), (640, 640)).offset == (79, 0)
    tall = Letterbox.plan((335, 777), (640, 640))  # 275.9 px wide
    assert (tall.resized, tall.offset) == ((276, 640), (182, 0))


@given(_sides, _sides, _sides, _sides, _fits)
def test_boxes_come_back(width: int, height: int, across: int, down: int, fit: Fit) -> None:
    plan = Letterbox.plan((width, height), (across, down), fit)
    boxes = np.array([[0, 0, width, height], [-1.5, 0.25, width / 3, height + 7.75]])
    np.testing.assert_allclose(plan.to_image(plan.to_input(boxes)), boxes, atol=1e-9 * 5000)
    left, top, right, bottom = plan.to_input(boxes[:1])[0]
    assert left >= 0
    assert top >= 0
    assert right <= across + 1e-9
    assert bottom <= down + 1e-9


@given(_sides, _sides, _sides, _sides)
def test_the_image_fills_what_was_planned(width: int, height: int, across: int, down: int) -> None:
    for fit in ("centre", "stretch"):
        plan = Letterbox.plan((width, height), (across, down), fit)
        whole = plan.to_input(np.array([[0.0, 0.0, width, height]]))[0]
        (left, top), (right, bottom) = plan.offset, plan.resized
        np.testing.assert_allclose(whole, [left, top, left + right, top + bottom], atol=1e-6)
        assert left + right <= across
        assert top + bottom <= down


def _blob(size: tuple[int, int], at: tuple[float, float], sigma: float) -> NDArray[np.uint8]:
    """Return a bright spot in a dark image, its middle counted from the image's outer edge."""
    x, y = (np.arange(n) + 0.5 for n in size)
    row, column = (np.exp(-((v - m) ** 2) / 2 / sigma**2) for v, m in zip((x, y), at, strict=True))
    return np.repeat(np.rint(255 * np.outer(column, row)).astype(np.uint8)[..., None], 3, axis=2)


def _middle(plane: NDArray[np.float32]) -> tuple[float, float]:
    mass = plane.astype(float)
    x, y = (np.arange(n) + 0.5 for n in mass.shape[::-1])
    return float(mass.sum(0) @ x / mass.sum()), float(mass.sum(1) @ y / mass.sum())


@pytest.mark.parametrize("fit", ["centre", "corner", "stretch"])
@pytest.mark.parametrize(
    "size", [(1919, 1079), (1242, 375), (333, 777), (641, 639), (101, 67), (640, 400)]
)
def test_pixels_lie_where_the_boxes_say(size: tuple[int, int], fit: Fit) -> None:
    plan = Letterbox.plan(size, (640, 640), fit, pad=0)
    sigma = 0.04 * min(size)
    for share in ((0.12, 0.15), (0.88, 0.83)):
        spot = (share[0] * size[0], share[1] * size[1])
        tensor = plan.tensor(_blob(size, spot, sigma), PixelFormat())
        found = plan.to_image(np.array([[*_middle(tensor[0, 0]), 0, 0]]))[0, :2]
        # YOLOX cuts sizes off and keeps one ratio: up to an input pixel, which it has learnt.
        within = 0.5 if fit != "corner" else 1 / plan.gain[0]
        assert np.abs(found - spot).max() < within


@pytest.mark.parametrize(("name", "pixels"), PIXEL_FORMATS.items())
def test_numbers_of_the_tensor(name: str, pixels: PixelFormat) -> None:
    image = np.random.default_rng(3).integers(0, 256, (61, 97, 3), dtype=np.uint8)
    plan = Letterbox.plan((97, 61), (64, 64))
    tensor = plan.tensor(image, pixels)
    small = cv2.resize(image, (64, 40), interpolation=cv2.INTER_LINEAR)
    grey = (114, 114, 114)
    padded = cv2.copyMakeBorder(small, 12, 12, 0, 0, cv2.BORDER_CONSTANT, value=grey)
    ordered = padded[..., ::-1] if name.startswith("rgb") else padded
    expected = ordered.transpose(2, 0, 1)[None] / (1 if name.endswith("255") else 255)
    assert tensor.shape == (1, 3, 64, 64)
    assert tensor.dtype == np.float32
    np.testing.assert_allclose(tensor, expected, atol=1e-7)
    last = plan.tensor(image, pixels, channels_last=True, dtype="float16")
    assert last.dtype == np.float16
    np.testing.assert_allclose(last, expected.transpose(0, 2, 3, 1), rtol=1e-3)
    assert name_of_pixels(pixels) == name


def test_bytes_stay_bytes() -> None:
    image = np.random.default_rng(3).integers(0, 256, (32, 32, 3), dtype=np.uint8)
    image.setflags(write=False)
    plan = Letterbox.plan((32, 32), (32, 32), "stretch")
    tensor = plan.tensor(image, PIXEL_FORMATS["bgr255"], dtype="uint8", channels_last=True)
    assert tensor.dtype == np.uint8
    np.testing.assert_array_equal(tensor[0], image)


def test_a_part_of_an_image_is_an_image() -> None:
    image = np.random.default_rng(3).integers(0, 256, (80, 120, 3), dtype=np.uint8)
    plan = Letterbox.plan((50, 40), (32, 32))
    part = plan.tensor(image[20:60, 30:80], PixelFormat())
    np.testing.assert_array_equal(part, plan.tensor(image[20:60, 30:80].copy(), PixelFormat()))


def test_another_image_than_planned_is_refused() -> None:
    plan = Letterbox.plan((640, 480), (640, 640))
    with pytest.raises(GeometryError, match="640 x 479 pixels, not 640 x 480"):
        plan.tensor(np.zeros((479, 640, 3), np.uint8), PixelFormat())
    with pytest.raises(GeometryError, match="0 x 480 pixels is empty"):
        Letterbox.plan((0, 480), (640, 640))


def test_what_is_no_bgr_image_becomes_one_or_is_refused() -> None:
    grey = np.arange(12, dtype=np.uint8).reshape(3, 4)
    for image in (grey, grey[..., None]):
        np.testing.assert_array_equal(as_bgr8(image), np.dstack([grey] * 3))
    deep = np.array([[0, 2048, 4095, 65535]], np.uint16)
    np.testing.assert_array_equal(as_bgr8(deep, white_level=4095)[0, :, 0], [0, 128, 255, 255])
    light = np.array([[-1.0, 0.5, 1.0, np.inf, np.nan]], np.float32)
    np.testing.assert_array_equal(as_bgr8(light, white_level=1)[0, :, 2], [0, 128, 255, 255, 0])
    with pytest.raises(GeometryError, match="uint16 pixels do not say which value is white"):
        as_bgr8(deep)
    with pytest.raises(GeometryError, match=r"not \(3, 4, 4\)"):
        as_bgr8(np.zeros((3, 4, 4), np.uint8))
    with pytest.raises(GeometryError, match=r"not \(3,\)"):
        as_bgr8(np.zeros(3, np.uint8))
    for shape in ((0, 0, 3), (0, 4), (4, 0, 3)):
        with pytest.raises(GeometryError, match="is empty"):
            as_bgr8(np.zeros(shape, np.uint8))
