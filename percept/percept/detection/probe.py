"""Does a network find anything at all, and if not: does it want its pixels as other numbers?

A network that was trained on 0..255 in BGR and is fed 0..1 in RGB finds nothing, with no error.
Nothing in the file says what it wants; pictures do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.detection.images.pixels import PIXEL_FORMATS, name_of_pixels
from percept.detection.yolo import YoloDetector

__all__ = ["ProbeReport", "probe_pixels"]

_CLEAR = 0.5  # confidence that speaks for pixels which were not resolved


@dataclass(frozen=True, slots=True, eq=False)
class ProbeReport:
    """What a network makes of a few images of a log.

    Attributes:
        detector: The one to go on with; not the one that was given where the pixels changed.
        best_scores: Confidence of the surest box by pixel format that was tried; the format that
            had been resolved is the first.
        note: A sentence for the user where there is something to say, or None.
        found_nothing: Whether the detector to go on with finds nothing in any of the images.
    """

    detector: YoloDetector
    best_scores: dict[str, float]
    note: str | None
    found_nothing: bool


def probe_pixels(detector: YoloDetector, images: Sequence[NDArray[Any]]) -> ProbeReport:
    """Look at a few images, and where nothing is found in any, at the same as other numbers.

    Other numbers are taken where they have the other range (0..1 or 0..255), clear boxes come of
    them, and none come in pictures of nothing: far out of its range a network may fire on
    anything. The order of the channels alone is never changed: with the wrong one a network finds
    less, but not nothing, so that empty images would decide. Nor is what the settings say. The
    note then names what else finds boxes.

    Args:
        detector: The detector.
        images: Each (H, W, 3) or (H, W) uint8 BGR, such as the first ones of each camera.

    Raises:
        GeometryError: If one is no image.
        InputError: If the network puts out what is no number.
    """
    resolved = name_of_pixels(detector.layout.pixels)
    scores = {resolved: _best(detector, images)}
    if not images or scores[resolved] >= detector.config.score:
        return ProbeReport(detector, scores, None, found_nothing=False)
    others = {name: _fed_with(detector, name) for name in _others(detector)}
    scores |= {name: _best_or_none(other, images) for name, other in others.items()}
    clear = [name for name in others if scores[name] >= _CLEAR]
    taken = next((name for name in clear if _may_take(detector, others[name])), None)
    number = f"{len(images)} image{'s' if len(images) > 1 else ''}"
    seen = f"nothing is found in {number} with the pixels as {resolved}"
    if taken is not None:
        why = f"pixels: {taken} after all, since {seen}, and clear boxes as {taken}"
        layout = others[taken].layout
        switched = detector.with_layout(replace(layout, why=(*layout.why, why)))
        return ProbeReport(switched, scores, why, found_nothing=False)
    return ProbeReport(
        detector, scores, f"{seen}{_advice(clear, list(others))}", found_nothing=True
    )


def _others(detector: YoloDetector) -> list[str]:
    """Name the other formats that the input can hold; the usual ones come first."""
    fits = {n: p for n, p in PIXEL_FORMATS.items() if p != detector.layout.pixels}
    if detector.network.image.dtype == "uint8":
        return [name for name, pixels in fits.items() if pixels.scale == 1.0]
    return list(fits)


def _fed_with(detector: YoloDetector, pixels: str) -> YoloDetector:
    return detector.with_layout(replace(detector.layout, pixels=PIXEL_FORMATS[pixels]))


def _may_take(detector: YoloDetector, other: YoloDetector) -> bool:
    if detector.config.pixels is not None:
        return False
    if other.layout.pixels.scale == detector.layout.pixels.scale:
        return False
    return _best(other, _pictures_of_nothing(detector.layout.input_size)) < detector.config.score


def _pictures_of_nothing(size: tuple[int, int]) -> list[NDArray[np.uint8]]:
    """Return grey, and noise as strong as it can be."""
    shape = (size[1], size[0], 3)
    noise = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    return [np.full(shape, 128, np.uint8), noise]


def _best(detector: YoloDetector, images: Sequence[NDArray[Any]]) -> float:
    return max((detector.best_score(image) for image in images), default=0.0)


def _best_or_none(detector: YoloDetector, images: Sequence[NDArray[Any]]) -> float:
    """Return the best score on numbers that may not be meant for the network, which may break."""
    try:
        return _best(detector, images)
    except InputError:
        return 0.0


def _advice(clear: Sequence[str], tried: Sequence[str]) -> str:
    if clear:
        return f", but boxes as {' and '.join(clear)}: set the pixels if the network wants those"
    return f", nor as {', '.join(tried)}: these images may be empty, or the network is not for them"
