"""What detection yields: the corners of a board in one image, or why there are none."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["BoardView", "NoBoard"]


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """A board as one image shows it.

    Attributes:
        name: Of the image.
        image_size: (width, height) in pixels.
        ids: (N,) int64 indices into the board's `corners_board()`.
        corners_px: (N, 2) float64 u, v; (0, 0) is the centre of the top-left pixel.
        blur_px: Over how many pixels the edges of the pattern rise, or NaN where unknown.
        jumps_px: (M,) float64 by how much a wide and a narrow sub-pixel window disagree, of the
            corners where they do: something beside the corner, such as the board's margin, is in
            the wide one.
    """

    name: str
    image_size: tuple[int, int]
    ids: NDArray[np.int64]
    corners_px: NDArray[np.float64]
    blur_px: float = float("nan")
    jumps_px: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, slots=True)
class NoBoard:
    """An image that cannot be used.

    Attributes:
        name: Of the image.
        reason: Why, in words.
    """

    name: str
    reason: str
