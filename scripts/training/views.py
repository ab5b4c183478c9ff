"""The training set: pictures of streets, rendered once, cut and varied anew in every epoch."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from percept.datasets.synthetic.views import random_view

__all__ = ["CLASSES", "Example", "drawing_weights", "load_views", "render_views", "varied"]

CLASSES = (
    "car", "truck", "cyclist", "pedestrian", "deer", "barrel", "barricade", "cone", "sign",
    "light_red", "light_yellow", "light_green", "light_off",
)  # fmt: skip
_VIEWS_PER_WORLD = 4
_LEAST_VISIBLE = 0.3
_LEAST_HEIGHT_PX = 8.0
_SCALES = (0.8, 1.45)

Example = tuple[NDArray[np.uint8], dict[str, NDArray[np.float64]]]


def render_views(folder: Path, count: int, first_seed: int, workers: int) -> None:
    """Render views into a folder, those that are not there yet.

    Args:
        folder: Where pictures (`.jpg`) and truth (`.npz`) go.
        count: Number of views.
        first_seed: Seed of the first street; every fourth view has a new one.
        workers: Processes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    missing = [n for n in range(count) if not (folder / f"{n:05d}.npz").exists()]
    with ProcessPoolExecutor(workers) as pool:
        for _ in pool.map(partial(_render, folder, first_seed), missing, chunksize=8):
            pass


def _render(folder: Path, first_seed: int, number: int) -> None:
    view = random_view(first_seed + number // _VIEWS_PER_WORLD, number)
    quality = 70 + number * 7 % 26
    cv2.imwrite(str(folder / f"{number:05d}.jpg"), view.pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    boxes = view.boxes
    np.savez(
        folder / f"{number:05d}.npz",
        boxes=boxes.boxes_px,
        labels=np.array(boxes.labels),
        visible=boxes.visible,
        range_m=boxes.range_m,
    )


def load_views(folder: Path, count: int) -> list[Example]:
    """Return pictures and truth of the first views of a folder."""
    examples: list[Example] = []
    for number in range(count):
        pixels = cv2.imread(str(folder / f"{number:05d}.jpg"))
        if pixels is None:
            raise FileNotFoundError(folder / f"{number:05d}.jpg")
        with np.load(folder / f"{number:05d}.npz") as truth:
            classes = [CLASSES.index(label) for label in truth["labels"].tolist()]
            columns = {name: truth[name] for name in ("boxes", "visible")}
        columns["classes"] = np.array(classes, np.float64)
        examples.append((np.asarray(pixels, np.uint8), columns))
    return examples


def drawing_weights(examples: list[Example]) -> NDArray[np.float64]:
    """Return how often each view is to be drawn, in sum 1: more often with rare classes.

    A view counts as often as its rarest class would have to for all classes to be seen alike,
    with the square root against drawing the same few views all the time (Gupta et al. 2019,
    "LVIS", 4.2).
    """
    shown = np.zeros((len(examples), len(CLASSES)))
    for row, (_, truth) in zip(shown, examples, strict=True):
        tall = truth["boxes"][:, 3] - truth["boxes"][:, 1] >= _LEAST_HEIGHT_PX
        row[truth["classes"][tall & (truth["visible"] >= _LEAST_VISIBLE)].astype(int)] = 1
    rarity = 1 / np.sqrt(np.maximum(shown.mean(axis=0), 1 / len(examples)))
    weights = np.maximum((shown * rarity).max(axis=1), rarity.min())
    return weights / weights.sum()


def varied(
    example: Example, size: tuple[int, int], rng: np.random.Generator
) -> tuple[Tensor, dict[str, Tensor]]:
    """Cut a part out of a view, scale and tint it.

    Nothing is mirrored: a dark light and the back of one differ by the side of the road only.

    Args:
        example: Picture and truth.
        size: (width, height) of the part.
        rng: Where the variation comes from.

    Returns:
        (3, H, W) RGB 0..1, and the objects: `boxes`, `classes`, and what does not count in
        `ignored`, because it is small, hidden or cut.
    """
    pixels, truth = example
    height, width = pixels.shape[:2]
    scale = rng.uniform(*_SCALES)
    cut = np.array(size) / scale
    room = np.array([width, height]) - cut
    low = np.where(room > 0, rng.uniform(0, 1, 2) * np.maximum(room, 0), room / 2)
    matrix = np.array([[scale, 0, -scale * low[0]], [0, scale, -scale * low[1]]])
    # Pixel centres lie half a pixel inside the coordinates that boxes are given in.
    matrix[:, 2] += 0.5 * (scale - 1)
    part = cv2.warpAffine(pixels, matrix, size, borderValue=(114, 114, 114))
    boxes = (truth["boxes"].reshape(-1, 2, 2) - low) * scale
    whole = np.maximum(boxes[:, 1] - boxes[:, 0], 1e-6)
    boxes = np.clip(boxes, 0, size)
    shown = (boxes[:, 1] - boxes[:, 0]) / whole
    seen = truth["visible"] * shown.prod(1)
    tall = boxes[:, 1, 1] - boxes[:, 0, 1]
    present = shown.prod(1) > 0.02
    counts = present & (seen >= _LEAST_VISIBLE) & (tall >= _LEAST_HEIGHT_PX)
    flat = torch.from_numpy(boxes.reshape(-1, 4).astype(np.float32))
    target = {
        "boxes": flat[counts],
        "classes": torch.from_numpy(truth["classes"][counts].astype(np.int64)),
        "ignored": flat[present & ~counts],
    }
    return _tinted(part, rng), target


def _tinted(part: NDArray[np.uint8], rng: np.random.Generator) -> Tensor:
    """Return (3, H, W) RGB 0..1 with another white balance, brightness and contrast."""
    colours = np.ascontiguousarray(part[:, :, ::-1]).astype(np.float32) / 255
    gain = rng.uniform(0.8, 1.2) * rng.uniform(0.93, 1.07, 3)
    colours = np.clip((colours - 0.5) * rng.uniform(0.85, 1.15) + 0.5, 0, 1) * gain
    return torch.from_numpy(np.clip(colours, 0, 1).astype(np.float32).transpose(2, 0, 1))
