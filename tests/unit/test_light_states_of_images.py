"""What `percept detect` reads from the pictures of lights that a network only finds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.cli.detect.light_states import with_light_states
from percept.core.results import Detections2D
from percept.core.samples import CameraImage
from percept.detection.result import ImageResult

_LAMPS = {"red": (60, 40, 250), "yellow": (40, 190, 250), "green": (170, 230, 60)}  # BGR
_HEAD_WH = (26, 60)
_BLANK = (300.0, 100.0, 326.0, 160.0)


def _draw_head(picture: NDArray[np.uint8], corner: tuple[int, int], lit: str | None) -> None:
    x, y = corner
    cv2.rectangle(picture, (x + 3, y + 2), (x + 22, y + 57), (45, 45, 45), -1)
    for number, (name, colour) in enumerate(_LAMPS.items()):
        shown = colour if name == lit else tuple(c // 6 for c in colour)
        cv2.circle(picture, (x + 13, y + 12 + 18 * number), 7, shown, -1)


def _picture() -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """A picture with heads that show red, yellow, green and nothing, and their boxes."""
    picture = np.full((200, 400, 3), 190, np.uint8)
    boxes = []
    for number, lit in enumerate((*_LAMPS, None)):
        x, y = 20 + 50 * number, 40
        _draw_head(picture, (x, y), lit)
        boxes.append((x, y, x + _HEAD_WH[0], y + _HEAD_WH[1]))
    return picture, np.array(boxes, dtype=np.float64)


def _found(
    labels: tuple[str, ...], boxes_px: NDArray[np.float64], pixels: NDArray[Any] | None
) -> ImageResult:
    image = None
    if pixels is not None:
        image = CameraImage(topic="/cam", stamp_ns=5, log_time_ns=5, pixels=pixels)
    found = Detections2D(
        stamp_ns=5,
        camera="cam",
        boxes_px=boxes_px,
        labels=labels,
        confidences=np.full(len(labels), 0.9),
    )
    return ImageResult(
        frame=0,
        camera="cam",
        stamp_ns=5,
        log_time_ns=5,
        image=image,
        boxes={"net": found},
    )


def test_the_states_of_lights_are_read_and_of_nothing_else() -> None:
    picture, heads = _picture()
    boxes = np.vstack([heads, heads[:1], [_BLANK]])
    labels = ("traffic light",) * 4 + ("car", "traffic_light")
    states = with_light_states(_found(labels, boxes, picture)).light_states["net"]
    assert states == ("red", "yellow", "green", "off", "", "")


def test_a_class_name_that_tells_the_state_is_believed() -> None:
    picture, heads = _picture()
    result = _found(("light_green", "red", "off", "person"), heads, picture)
    assert with_light_states(result) is result


def test_of_several_networks_only_those_without_states_get_them() -> None:
    picture, heads = _picture()
    result = _found(("traffic light",) * 4, heads, picture)
    result = replace(
        result, boxes={**result.boxes, "telling": replace(result.boxes["net"], labels=("red",) * 4)}
    )
    assert set(with_light_states(result).light_states) == {"net"}


@pytest.mark.parametrize("kind", ["grey", "sixteen bits", "unusable"])
def test_without_colours_there_are_no_states(kind: str) -> None:
    picture, heads = _picture()
    kinds: dict[str, NDArray[Any]] = {
        "grey": picture[:, :, 0],
        "sixteen bits": picture.astype(np.uint16),
    }
    pixels = kinds.get(kind)
    result = _found(("traffic light",) * 4, heads, pixels)
    assert with_light_states(result) is result


def test_boxes_beyond_the_image_and_without_a_size_have_no_state() -> None:
    picture, heads = _picture()
    boxes = np.array([[-90.0, -90, -50, -50], [500, 10, 540, 90], [50, 50, 50, 50], heads[0]])
    states = with_light_states(_found(("traffic light",) * 4, boxes, picture)).light_states["net"]
    assert states == ("", "", "", "red")
