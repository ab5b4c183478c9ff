"""Which images are too poor to be labelled: blurred, or exposed wrongly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from percept.core.settings import Settings
from percept.datasets.labelling.choice.image_look import ImageLook

__all__ = ["PoorReason", "QualityConfig", "poor_images"]

PoorReason = Literal["empty", "under-exposed", "over-exposed", "blurred"]
"""What is wrong with an image. `empty`: it shows nothing, such as one grey."""


class QualityConfig(Settings):
    """From where on an image is poor.

    Attributes:
        least_contrast: Standard deviation of the grey of the small picture, 0..255, below which
            an image is empty.
        most_dark: Share of pixels as good as black above which an image is under-exposed.
        most_bright: Share of pixels as good as white above which an image is over-exposed.
        least_sharpness: An image is blurred where its sharpness is below this,
        least_relative_sharpness: and below this share of the median of its camera in the drive:
            a lens that is always soft, or fog, is no reason to drop all images.
    """

    least_contrast: float = Field(default=2.0, ge=0)
    most_dark: float = Field(default=0.85, gt=0, le=1)
    most_bright: float = Field(default=0.5, gt=0, le=1)
    least_sharpness: float = Field(default=0.6, ge=0, le=1)
    least_relative_sharpness: float = Field(default=0.85, ge=0, le=1)


def poor_images(looks: Sequence[ImageLook], config: QualityConfig) -> tuple[PoorReason | None, ...]:
    """Judge the images of one camera in one drive.

    Args:
        looks: How its images look; of one camera and drive only, as blur is judged by what the
            camera usually shows.
        config: Limits.

    Returns:
        What is wrong with each image; None where nothing is.
    """
    wrong = [_exposure(look, config) for look in looks]
    usual = [look.sharpness for look, reason in zip(looks, wrong, strict=True) if reason is None]
    limit = config.least_sharpness
    if usual:
        limit = min(limit, config.least_relative_sharpness * float(np.median(usual)))
    return tuple(
        reason if reason is not None or look.sharpness >= limit else "blurred"
        for look, reason in zip(looks, wrong, strict=True)
    )


def _exposure(look: ImageLook, config: QualityConfig) -> PoorReason | None:
    if look.dark_share > config.most_dark:
        return "under-exposed"
    if look.bright_share > config.most_bright:
        return "over-exposed"
    if float(look.thumbnail.std()) < config.least_contrast:
        return "empty"
    return None
