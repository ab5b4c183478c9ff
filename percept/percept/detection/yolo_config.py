"""The settings of one network."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from percept.core.settings import Settings

__all__ = ["YoloConfig"]

_Share = Annotated[float, Field(ge=0, le=1)]
_Count = Annotated[int, Field(ge=1)]


class YoloConfig(Settings):
    """How one network is used.

    Attributes:
        score: Least confidence of a box.
        iou: Intersection over union above which two boxes of a class are one object.
        class_scores: Least confidence by class name, where it differs.
        classes: Names of the classes that are kept; all where it is None.
        min_size_px: Least width and height of a box, image pixels.
        max_boxes: Most boxes of an image, the most confident.
        layout: Name of the decoding; found from the network where it is None.
        pixels: What the network takes pixels as; found where it is None.
        input_size: (width, height) of the input of a network with dynamic shapes. Where it is
            None such a network sees every image in the smallest rectangle that it fits into.
        tiles: (columns, rows) that an image is cut into for small far objects.
        tile_overlap: Share of a tile that it has in common with its neighbour.
        white_level: Pixel value that is white in images that are not 8 bits deep.
    """

    score: _Share = 0.25
    iou: _Share = 0.45
    class_scores: dict[str, _Share] = Field(default_factory=dict)
    classes: tuple[str, ...] | None = None
    min_size_px: float = Field(default=0.0, ge=0)
    max_boxes: _Count = 300
    layout: str | None = None
    pixels: Literal["rgb1", "bgr255", "rgb255", "bgr1"] | None = None
    input_size: tuple[_Count, _Count] | None = None
    tiles: tuple[_Count, _Count] = (1, 1)
    tile_overlap: float = Field(default=0.2, ge=0, le=0.8)
    white_level: float | None = Field(default=None, gt=0)
