"""From the boxes of one image to sightings of lights: by the map, or by following boxes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.light_words import Reading, light_label
from percept.core.results import Detections2D
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.hdmap.light import MapLight
from percept.lights.association import match_lights
from percept.lights.config import DetectorConfig, LightConfig
from percept.lights.projection import project_lights

__all__ = ["LightBoxes", "light_boxes", "match_to_map"]

_COLOURS = {Reading.RED: "red", Reading.YELLOW: "yellow", Reading.GREEN: "green"}


@dataclass(frozen=True, slots=True, eq=False)
class LightBoxes:
    """The boxes of an image that are lights.

    Attributes:
        stamp_ns: Time of the image.
        camera: Name of the camera.
        boxes_px: (N, 4) float64 x1, y1, x2, y2.
        readings: (N,) int64 values of `Reading`.
        weights: (N,) float64 in 0..1 how far each reading is to be believed.
    """

    stamp_ns: int
    camera: str
    boxes_px: NDArray[np.float64]
    readings: NDArray[np.int64]
    weights: NDArray[np.float64]


def light_boxes(
    detections: Detections2D, config: DetectorConfig
) -> tuple[LightBoxes, Counter[str]]:
    """Return the lights among the boxes of an image, and what was left out and why.

    Boxes of other things are no loss and are not counted; broken boxes are.
    """
    found = [light_label(label) for label in detections.labels]
    is_light = np.array([reading is not None for reading in found], dtype=bool)
    columns = np.column_stack([detections.boxes_px, detections.confidences])
    sound = np.isfinite(columns).all(axis=1)
    sound &= (detections.boxes_px[:, 2:] > detections.boxes_px[:, :2]).all(axis=1)
    rows = np.flatnonzero(is_light & sound)
    dropped: Counter[str] = Counter()
    if broken := int((is_light & ~sound).sum()):
        dropped["light box without a size or not finite"] = broken
    boxes = LightBoxes(
        detections.stamp_ns,
        detections.camera,
        detections.boxes_px[rows],
        np.array([found[row] for row in rows], dtype=np.int64),
        np.clip(detections.confidences[rows] / config.full_confidence, 0, 1),
    )
    return boxes, dropped


def match_to_map(
    boxes: LightBoxes,
    lights: Sequence[MapLight],
    T_map_base: Transform,
    camera: CameraSensor,
    config: LightConfig,
) -> NDArray[np.int64]:
    """Return the (N,) id of the map's light that each box is, -1 for none."""
    projected = project_lights(lights, T_map_base, camera, config.projection)
    colours = [_COLOURS.get(Reading(reading)) for reading in boxes.readings]
    matches = match_lights(projected, boxes.boxes_px, colours, config.association)
    ids = np.full(len(boxes.boxes_px), -1, np.int64)
    ids[matches.pairs[:, 1]] = projected.ids[matches.pairs[:, 0]]
    return ids
