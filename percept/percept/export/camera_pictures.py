"""Images with the boxes of every network, drawn for reports."""

from __future__ import annotations

import base64
from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.results import Detections2D
from percept.detection.result import ImageResult, Positions
from percept.export.box_text import box_text
from percept.export.canvas import (
    BACKGROUND,
    FIXED_SHIFT,
    TEXT,
    Image,
    Rgb,
    as_bgr,
    fixed_point,
    resized,
    text_width,
    with_header,
    write_text,
)

__all__ = ["boxes_on_image", "jpeg_data_uri"]

_LABELS = 40
_TEXT_HEIGHT_PX = 9
_PAD_PX = 3
_JPEG_QUALITY = 85


def boxes_on_image(
    result: ImageResult, colours: Mapping[str, Rgb], *, width_px: int = 960
) -> Image:
    """Draw an image with the boxes of each network, and a legend that counts them.

    Class, confidence and, where it is known, the range stand at the boxes, the most confident
    first, as far as there is room. A thin box is an object that another network found with more
    confidence; nothing is written at it.

    Args:
        result: The image, with its pixels.
        colours: By network, the colour of its boxes (red, green, blue).
        width_px: Width of the picture at most; a narrower image keeps its size.

    Returns:
        (H, W, 3) uint8 BGR.

    Raises:
        GeometryError: If there are no pixels.
    """
    if result.image is None:
        raise GeometryError("an image that cannot be decoded cannot be drawn", where=result.camera)
    image = as_bgr(result.image.pixels)
    scale = min(1.0, width_px / image.shape[1])
    picture = image.copy() if scale == 1 else resized(image, scale)
    taken: list[NDArray[np.float64]] = []
    primary = {
        model: result.primary.get(model, np.ones(len(found), dtype=bool))
        for model, found in result.boxes.items()
    }
    for is_bold in (False, True):  # what counts lies over its duplicates
        for model, found in result.boxes.items():
            boxes_px = found.boxes_px[primary[model] == is_bold] * scale
            _draw_boxes(picture, boxes_px, colours[model], is_bold=is_bold)
    for model, found in result.boxes.items():
        texts = _texts(found, primary[model], result.positions.get(model))
        _draw_texts(picture, found.boxes_px * scale, texts, colours[model], taken)
    legend = [(f"{model}: {len(found)}", colours[model]) for model, found in result.boxes.items()]
    return with_header(picture, "", legend)


def jpeg_data_uri(image: Image) -> str:
    """Return a picture (H, W, 3) uint8 BGR as a JPEG data URI for HTML."""
    _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return "data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode("ascii")


def _draw_boxes(
    picture: Image, boxes_px: NDArray[np.float64], colour: Rgb, *, is_bold: bool
) -> None:
    # Boxes are given from the edge of the first pixel, and OpenCV draws from its centre.
    corners = fixed_point(boxes_px - 0.5).reshape(-1, 2, 2).tolist()
    for thickness, rgb in ((3, BACKGROUND), (2, colour)) if is_bold else ((1, colour),):
        for top_left, bottom_right in corners:
            cv2.rectangle(
                picture, top_left, bottom_right, rgb[::-1], thickness, cv2.LINE_AA, FIXED_SHIFT
            )


def _texts(
    found: Detections2D, primary: NDArray[np.bool_], positions: Positions | None
) -> dict[int, str]:
    """Return the texts of the most confident primary boxes, by row, the most confident first."""
    order = np.argsort(-found.confidences, kind="stable").tolist()
    rows = [row for row in order if primary[row]][:_LABELS]
    return {row: box_text(found, row, positions) for row in rows}


def _draw_texts(
    picture: Image,
    boxes_px: NDArray[np.float64],
    texts: Mapping[int, str],
    colour: Rgb,
    taken: list[NDArray[np.float64]],
) -> None:
    """Write texts above, in or below their boxes; one that has no room is left out."""
    height, width = picture.shape[:2]
    for row, text in texts.items():
        x1, y1, _, y2 = boxes_px[row]
        wide, tall = text_width(text) + 2 * _PAD_PX, _TEXT_HEIGHT_PX + 2 * _PAD_PX + 2
        left = float(np.clip(x1, 0, max(width - wide, 0)))
        for top in (y1 - tall - 2, y1 + 2, y2 + 2, y2 - tall - 2):  # beside the lines
            place = np.array([left, top, left + wide, top + tall])
            if top >= 0 and top + tall <= height and not _overlaps(place, taken):
                taken.append(place)
                _write_on(picture, text, place, colour)
                break


def _write_on(picture: Image, text: str, place: NDArray[np.float64], colour: Rgb) -> None:
    left, top, right, bottom = np.rint(place).astype(int).tolist()
    cv2.rectangle(picture, (left, top), (right, bottom), BACKGROUND[::-1], -1)
    cv2.rectangle(picture, (left, top), (left + 2, bottom), colour[::-1], -1)
    write_text(picture, text, (left + _PAD_PX + 2, bottom - _PAD_PX - 2), TEXT)


def _overlaps(place: NDArray[np.float64], taken: list[NDArray[np.float64]]) -> bool:
    return any((place[:2] < t[2:]).all() and (t[:2] < place[2:]).all() for t in taken)
