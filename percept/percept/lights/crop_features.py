"""What a picture of a traffic light is described by: where it shines, and in which colour.

Opponent colours (red against green, yellow against blue) change little with exposure, and keep
the colour of the halo around a lamp that is overexposed to white.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["CONTRASTS", "FEATURES", "crop_features"]

_F64 = NDArray[np.float64]
_ROWS, _COLUMNS = 36, 12
_BANDS = 9
_HUES = 12
_CHANNELS = 4
_GRID_COLUMNS = 3

FEATURES = _BANDS * _CHANNELS * (_GRID_COLUMNS + 1) + _HUES + 4 * 2
"""Length of the description of one crop."""

CONTRASTS = slice(-8, None, 2)
"""Where it says by how much brightness, saturation, red and green stand out somewhere."""


def crop_features(crop: NDArray[np.uint8]) -> _F64:
    """Describe a crop by numbers of about the size of one.

    Args:
        crop: (H, W, 3) uint8 BGR, the box of one light; at least one pixel.

    Returns:
        (FEATURES,) float64: the mean brightness and opponent colours of a grid over the crop, the
        strongest of each band of rows, the hues weighted by how bright and saturated they are,
        and by how much the brightest, the most saturated, the reddest and the greenest part
        stand out, each with its height in the crop.
    """
    import cv2

    height, width = crop.shape[:2]
    shrinks = height > _ROWS or width > _COLUMNS
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    resized = cv2.resize(crop, (_COLUMNS, _ROWS), interpolation=method)
    small = np.asarray(resized, dtype=np.uint8)
    blue, green, red = np.moveaxis(small.astype(np.float64) / 255.0, 2, 0)
    bright = small.max(axis=2) / 255.0
    saturated = (small.max(axis=2) - small.min(axis=2).astype(np.float64)) / 255.0
    channels = np.stack([bright, red - green, (red + green) / 2 - blue, green - (red + blue) / 2])
    bands = channels.reshape(_CHANNELS, _BANDS, -1, _COLUMNS)
    grid = bands.reshape(_CHANNELS, _BANDS, -1, _GRID_COLUMNS, _COLUMNS // _GRID_COLUMNS)
    return np.concatenate(
        [
            grid.mean(axis=(2, 4)).ravel(),
            _strongest(bands).ravel(),
            _hues(small, bright * saturated),
            *(_standing_out(part) for part in (bright, saturated, red - green, green - red)),
        ]
    )


def _strongest(bands: _F64) -> _F64:
    """Return the value furthest from zero of each channel and band (channels, bands)."""
    flat = bands.reshape(*bands.shape[:2], -1)
    rows = np.abs(flat).argmax(axis=2)[..., None]
    strongest: _F64 = np.take_along_axis(flat, rows, axis=2)[..., 0]
    return strongest


def _standing_out(channel: _F64) -> tuple[float, float]:
    """Return by how much the strongest part exceeds the median, and its height, 0 to 1."""
    by_row = np.sort(channel, axis=1)[:, -3:].mean(axis=1)
    top = int(by_row.argmax())
    return float(by_row[top] - np.median(channel)), (top + 0.5) / _ROWS


def _hues(small: NDArray[np.uint8], weight: _F64) -> _F64:
    """Return the shares (hues,) that each hue has in what is bright and saturated."""
    import cv2

    hue = cv2.cvtColor(small, cv2.COLOR_BGR2HSV)[..., 0].astype(np.int64) * _HUES // 180
    amounts = np.bincount(hue.ravel(), (weight**2).ravel(), minlength=_HUES)
    shares: _F64 = amounts / (amounts.sum() + 0.5)
    return shares
