"""Pictures of traffic lights to learn from: read, made to vary, and with the lamp put out."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["STATES", "read_crops", "similar_groups", "varied", "with_lamp_out", "with_unlit_lenses"]

STATES = ("red", "yellow", "green", "off")
"""Classes of the classifier; there are crops of the first three, and `off` is made of them."""

Crop = NDArray[np.uint8]
_LENS_TINTS = ((0.2, 0.2, 1.0), (0.2, 0.8, 1.0), (0.7, 1.0, 0.2))


def read_crops(folder: Path) -> tuple[list[Crop], NDArray[np.int64]]:
    """Read the crops of `red`, `yellow` and `green` below a folder, and their classes (N,)."""
    crops: list[Crop] = []
    classes: list[int] = []
    for number, state in enumerate(STATES[:3]):
        for path in sorted((folder / state).iterdir()):
            crop = cv2.imread(str(path))
            if crop is None:
                raise SystemExit(f"{path} is no image")
            crops.append(crop)
            classes.append(number)
    return crops, np.array(classes)


def similar_groups(crops: list[Crop], least: float) -> NDArray[np.int64]:
    """Return a group (N,) for each crop: those that chains of similar ones join are one group.

    Images of a drive follow one another, so that a crop has near copies, which must not be
    learnt from and tested on. Two crops are similar from a correlation of `least` on.
    """
    from scipy.sparse.csgraph import connected_components

    tiny = [cv2.resize(crop, (8, 16), interpolation=cv2.INTER_AREA).ravel() for crop in crops]
    flat = np.array(tiny, dtype=np.float64)
    flat -= flat.mean(axis=1, keepdims=True)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    groups: NDArray[np.int64] = connected_components(flat @ flat.T >= least)[1]
    return groups


def with_lamp_out(crop: Crop, state: int) -> Crop | None:
    """Return the crop with the part that shines replaced by a mirror image of the rest.

    None of a head that does not stand upright, of which the place of the lamp is not known.
    """
    height, width = crop.shape[:2]
    if height < 1.6 * width:
        return None
    if STATES[state] == "red":
        dark = crop[height // 2 :]
        return np.vstack([dark[::-1], dark])
    if STATES[state] == "green":
        dark = crop[: height // 2]
        return np.vstack([dark, dark[::-1]])
    third = height // 3
    return np.vstack([crop[:third], crop[:third][::-1], crop[-third:]])


def with_unlit_lenses(crop: Crop, rng: np.random.Generator) -> Crop:
    """Return the crop of a dark head with three faintly coloured lenses drawn into its thirds."""
    height, width = crop.shape[:2]
    picture = crop.astype(np.float64)
    rows, columns = np.mgrid[:height, :width]
    radius = rng.uniform(0.25, 0.45) * min(width, height / 3)
    strength, cover = rng.uniform(15, 90), rng.uniform(0.4, 1.0)
    for third, tint in enumerate(_LENS_TINTS):
        middle = ((third + 0.5) * height / 3, width / 2)
        off = np.hypot(rows - middle[0], columns - middle[1]) / radius
        share = cover * np.clip(2.5 - 2.5 * off, 0, 1)[..., None]
        picture = picture * (1 - share) + np.array(tint) * strength * share
    return np.clip(picture, 0, 255).astype(np.uint8)


def varied(crop: Crop, rng: np.random.Generator) -> Crop:
    """Return the crop as another camera, box, weather or distance might have given it."""
    crop = _cut(crop, rng)
    if rng.random() < 0.5:
        crop = crop[:, ::-1]
    if rng.random() < 0.1:  # heads that lie: the first lamp is on the left
        crop = np.swapaxes(crop, 0, 1)
    return _compressed(_shrunk(_coloured(crop, rng), rng), rng)


def _cut(crop: Crop, rng: np.random.Generator) -> Crop:
    """Move each side of the box by up to an eighth, outwards by repeating the border."""
    height, width = crop.shape[:2]
    moves = rng.uniform(-0.12, 0.12, 4) * [height, height, width, width]
    top, bottom, left, right = np.round(moves).astype(int).tolist()
    cut = crop[max(-top, 0) : height - max(-bottom, 0), max(-left, 0) : width - max(-right, 0)]
    return cv2.copyMakeBorder(
        cut, max(top, 0), max(bottom, 0), max(left, 0), max(right, 0), cv2.BORDER_REPLICATE
    )


def _coloured(crop: Crop, rng: np.random.Generator) -> Crop:
    """Change hue, saturation, exposure, contrast and white balance."""
    hsv = cv2.cvtColor(crop, cv2.COLOR_BGR2HSV).astype(np.float64)
    hsv[..., 0] = (hsv[..., 0] + rng.uniform(-3, 3)) % 180
    hsv[..., 1] = np.clip(hsv[..., 1] * rng.uniform(0.6, 1.4), 0, 255)
    picture = cv2.cvtColor(hsv.astype(np.uint8), cv2.COLOR_HSV2BGR) / 255.0
    picture = picture ** rng.uniform(0.7, 1.5) * rng.uniform(0.5, 1.3)
    picture *= rng.uniform(0.94, 1.06, 3)
    picture += rng.normal(0, rng.uniform(0, 0.03), picture.shape)
    return (np.clip(picture, 0, 1) * 255).astype(np.uint8)


def _shrunk(crop: Crop, rng: np.random.Generator) -> Crop:
    """Blur, and often shrink to a light that is far away."""
    if rng.random() < 0.5:
        crop = cv2.GaussianBlur(crop, (0, 0), rng.uniform(0.3, 0.05 * crop.shape[0] + 0.4))
    if rng.random() < 0.6:
        share = rng.uniform(6, 40) / max(crop.shape[:2])
        size = [max(round(side * share), 2) for side in crop.shape[1::-1]]
        crop = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
    return crop


def _compressed(crop: Crop, rng: np.random.Generator) -> Crop:
    if rng.random() < 0.5:
        return crop
    quality = int(rng.integers(40, 95))
    packed = cv2.imencode(".jpg", crop, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return cv2.imdecode(packed, cv2.IMREAD_COLOR)
