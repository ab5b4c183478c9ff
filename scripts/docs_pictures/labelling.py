"""The tutorial of labelling: what it prints, and images of its data set with their boxes."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from docs_pictures.pages import ROOT, fill_in, follow_all
from docs_pictures.shots import Picture, save
from percept.datasets.labelling.labelled_set import ImageBoxes
from percept.datasets.labelling.set_tables import read_set
from percept.export.palette import class_colours
from percept.export.picture_grid import Tile, picture_grid

__all__ = ["look_at_labelling"]

PRINTED = {"prepare": "dataset prepare", "check": "dataset check", "diff": "dataset diff"}
SHOWN = 4
WIDTH_PX = 460


def look_at_labelling(folder: Path) -> None:
    """Follow the tutorial of labelling in a new folder."""
    page = ROOT / "docs" / "tutorial-labelling.md"
    printed = follow_all(page, folder)
    for name, begins in PRINTED.items():
        fill_in(page, name, next(lines for c, lines in printed.items() if begins in c))
    save("dataset.png", some_images(folder / "set"), Image.Quantize.MEDIANCUT)


def some_images(folder: Path) -> Picture:
    """Draw images of a data set, spread evenly, with the boxes that labelling begins from."""
    labelled = read_set(folder)
    frames = list(labelled.frames())
    tiles = []
    for number in np.linspace(0, len(frames) - 1, SHOWN).astype(int):
        keyframe, frame = frames[number]
        picture = cv2.imread(str(labelled.folder / frame.file))
        if picture is None:
            raise SystemExit(f"{frame.file} cannot be read")
        drawn = with_boxes(picture.astype(np.uint8), frame.boxes, labelled.categories)
        tiles.append(Tile(drawn, frame.file, f"{len(frame.boxes)} boxes, for {keyframe.split}"))
    return picture_grid(tiles, columns=2, width_px=WIDTH_PX)


def with_boxes(picture: Picture, boxes: ImageBoxes, categories: tuple[str, ...]) -> Picture:
    """Draw boxes in the colours of their classes."""
    colours = class_colours(categories)
    corners = np.rint(boxes.boxes_px - 0.5).astype(int).reshape(-1, 2, 2).tolist()
    for (begin, end), label in zip(corners, boxes.labels, strict=True):
        cv2.rectangle(picture, begin, end, colours[label][::-1], 2, cv2.LINE_AA)
    return picture
