"""One colour a class, the same in pictures, charts and the 3D view.

The hues are those of Okabe and Ito (2008, "Color Universal Design") and of Tol's muted scheme
(2021, SRON/EPS/TN/09-002), both made to be told apart with the common colour deficiencies and
bright enough for a dark background.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Sequence
from itertools import cycle

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = [
    "class_colour",
    "class_colours",
    "cluster_colours",
    "depth_colours",
    "hex_colour",
    "model_colours",
    "sensor_colour",
    "sensor_colour_name",
    "sequential_colours",
]

_UNKNOWN = (187, 187, 187)
_CLASSES = {
    "car": (86, 180, 233),
    "truck": (0, 114, 178),
    "cyclist": (204, 121, 167),
    "pedestrian": (213, 94, 0),
    "deer": (0, 158, 115),
    "barrel": (230, 159, 0),
    "barricade": (240, 228, 66),
    "sign": (170, 68, 153),
    "cone": (204, 102, 119),
    "unknown": _UNKNOWN,
}
_HUES = np.array([rgb for rgb in _CLASSES.values() if rgb != _UNKNOWN], dtype=np.uint8)
# Orange, blue, green, magenta and on, of Okabe and Ito: neighbours differ in brightness too.
_SENSORS = (
    (230, 159, 0), (86, 180, 233), (0, 158, 115), (226, 110, 190),
    (240, 228, 66), (213, 94, 0), (0, 114, 178), (187, 187, 187),
)  # fmt: skip
_SENSOR_NAMES = ("orange", "light blue", "green", "pink", "yellow", "red", "blue", "grey")
_FAR_M = 60.0
# The dark end of the scheme would be lost on a dark ground.
_SEQUENTIAL = cv2.applyColorMap(np.arange(52, 256, dtype=np.uint8)[:, None], cv2.COLORMAP_PLASMA)
_NO_CLUSTER = np.array((110, 110, 110), dtype=np.uint8)


def class_colour(label: str) -> tuple[int, int, int]:
    """Return the red, green and blue (0..255) of a class.

    A label outside the built-in classes gets one of the same hues, always the same one, which
    several labels share; `class_colours` keeps those of one chart apart.
    """
    if label in _CLASSES:
        return _CLASSES[label]
    red, green, blue = _HUES[zlib.crc32(label.encode()) % len(_HUES)]
    return int(red), int(green), int(blue)


def class_colours(labels: Collection[str]) -> dict[str, tuple[int, int, int]]:
    """Return the colours of the classes of one chart: as far as 27 go, each another one.

    The built-in classes have their own; others take what is left, as it is, then pale, then dark.
    """
    tints = np.concatenate([_HUES, _HUES // 2 + 127, _HUES // 5 * 3])
    own = {label: _CLASSES[label] for label in labels if label in _CLASSES}
    left = [rgb for rgb in map(tuple, tints.tolist()) if rgb not in own.values()]
    others = zip((label for label in labels if label not in own), cycle(left), strict=False)
    return own | dict(others)


def cluster_colours(cluster_ids: NDArray[np.integer]) -> NDArray[np.uint8]:
    """Return the colours (N, 3) uint8 RGB of clusters (N,); -1, which is none, is grey."""
    ids = np.asarray(cluster_ids)
    # Neighbouring clusters often have neighbouring numbers: a stride keeps their hues apart.
    hues: NDArray[np.uint8] = _HUES[(ids * 4) % len(_HUES)]
    return np.where((ids < 0)[:, None], _NO_CLUSTER, hues)


def sensor_colour(index: int) -> tuple[int, int, int]:
    """Return the red, green and blue (0..255) of the sensor that comes at a place in a list."""
    return _SENSORS[index % len(_SENSORS)]


def sensor_colour_name(index: int) -> str:
    """Return what a person calls a `sensor_colour`."""
    return _SENSOR_NAMES[index % len(_SENSOR_NAMES)]


def model_colours(models: Sequence[str]) -> dict[str, tuple[int, int, int]]:
    """Return the red, green and blue (0..255) of each network's boxes, by its name."""
    return {model: sensor_colour(index) for index, model in enumerate(models)}


def depth_colours(depths_m: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Return colours (N, 3) uint8 RGB of depths (N,): yellow near by, violet from 60 m on."""
    return sequential_colours(1 - np.asarray(depths_m, dtype=np.float64) / _FAR_M)


def sequential_colours(fractions: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Return colours (N, 3) uint8 RGB of values (N,) from 0, violet, to 1, yellow.

    Brightness grows with the value, so that the order is seen with any colour vision (the
    `plasma` scheme of matplotlib). Values beyond are clipped; NaN is grey.
    """
    values = np.asarray(fractions, dtype=np.float64)
    known = np.isfinite(values)
    last = len(_SEQUENTIAL) - 1
    index = np.rint(np.clip(np.where(known, values, 0), 0, 1) * last).astype(np.intp)
    colours: NDArray[np.uint8] = np.array(_SEQUENTIAL[index, 0, ::-1])
    colours[~known] = _NO_CLUSTER
    return colours


def hex_colour(rgb: tuple[int, int, int]) -> str:
    """Return a colour as CSS and SVG write it, such as `#56b4e9`."""
    return "#{:02x}{:02x}{:02x}".format(*rgb)
