"""What traffic lights show that a network finds without telling their state."""

from __future__ import annotations

from dataclasses import replace

from percept.core.light_words import Reading, light_label
from percept.core.results import Detections2D
from percept.core.samples import CameraImage
from percept.detection.result import ImageResult
from percept.lights.colours import UNKNOWN, classify_light_crops, light_crops

__all__ = ["with_light_states"]

_COLOUR_AXES = 3


def with_light_states(result: ImageResult) -> ImageResult:
    """Read the state of each light whose class name does not tell it from its picture."""
    image = result.image
    if image is None or image.pixels.ndim != _COLOUR_AXES or image.pixels.dtype.name != "uint8":
        return result  # grey and raw images have no colours to tell
    states = {
        model: _states(image, found)
        for model, found in result.boxes.items()
        if Reading.UNREADABLE in map(light_label, found.labels)
    }
    return replace(result, light_states=states) if states else result


def _states(image: CameraImage, found: Detections2D) -> tuple[str, ...]:
    rows = [n for n, label in enumerate(found.labels) if light_label(label) is Reading.UNREADABLE]
    crops = light_crops(image.pixels, found.boxes_px[rows])
    states = [""] * len(found)
    for row, (state, _) in zip(rows, classify_light_crops(crops), strict=True):
        states[row] = "" if state == UNKNOWN else state
    return tuple(states)
