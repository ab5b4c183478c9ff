"""Small logs of drives along one long street that looks different everywhere, with GNSS fixes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.geodesy import LocalFrame
from percept.core.samples import CameraImage, GnssFix, Sample
from percept.datasets.write import LogWriter

__all__ = ["ORIGIN", "START_NS", "street_picture", "write_street_log"]

ORIGIN = LocalFrame(48.2, 16.37, 180.0)
START_NS = 1_750_000_000_000_000_000
_SIZE = (160, 96)
_PX_PER_M = 4
_LENGTH_M = 2400


def write_street_log(
    path: Path,
    *,
    from_m: float = 0.0,
    metres: float = 200.0,
    speed_mps: float = 10.0,
    rate_hz: float = 5.0,
    start_s: float = 0.0,
    topics: Sequence[str] = ("/front/image",),
    stands_s: float = 0.0,
    fixes: bool = True,
    blurred: Sequence[int] = (),
    dark: Sequence[int] = (),
) -> Path:
    """Write a drive along the street from one place on.

    Args:
        path: The log, `*.mcap`.
        from_m: Where it begins.
        metres: How long it is.
        speed_mps: How fast.
        rate_hz: Images and fixes a second.
        start_s: When it begins, after `START_NS`.
        topics: Topics of images; each camera sees another side.
        stands_s: How long it stands at its end.
        fixes: Whether there is GNSS.
        blurred: Numbers of images out of focus.
        dark: Numbers of images that are nearly black.
    """
    moving = round(metres / speed_mps * rate_hz)
    with LogWriter(path, "mcap", images="jpeg") as log:
        for number in range(moving + round(stands_s * rate_hz)):
            stamp_ns = START_NS + round((start_s + number / rate_hz) * 1e9)
            at_m = from_m + min(number, moving) * speed_mps / rate_hz
            for sample in _samples(number, stamp_ns, at_m, topics, blurred, dark, fixes=fixes):
                log.write(sample)
    return path


def street_picture(at_m: float, side: int = 0) -> NDArray[np.uint8]:
    """Return what a camera sees at a place of the street: (96, 160, 3) BGR."""
    street = _street(side)
    left = round(at_m * _PX_PER_M)
    return np.ascontiguousarray(street[:, left : left + _SIZE[0]])


def _samples(
    number: int,
    stamp_ns: int,
    at_m: float,
    topics: Sequence[str],
    blurred: Sequence[int],
    dark: Sequence[int],
    *,
    fixes: bool,
) -> list[Sample]:
    samples: list[Sample] = []
    if fixes:
        latitude, longitude, altitude = ORIGIN.geodetic(np.array([at_m, 0.0, 0.0]))
        samples.append(
            GnssFix(
                topic="/gnss",
                stamp_ns=stamp_ns,
                log_time_ns=stamp_ns,
                frame="gnss",
                latitude_deg=latitude,
                longitude_deg=longitude,
                altitude_m=altitude,
            )
        )
    for side, topic in enumerate(topics):
        pixels = street_picture(at_m, side)
        if number in blurred:
            pixels = cv2.GaussianBlur(pixels, (0, 0), 6).astype(np.uint8)
        if number in dark:
            pixels = (pixels // 40).astype(np.uint8)
        samples.append(
            CameraImage(
                topic=topic,
                stamp_ns=stamp_ns + 1_000_000,
                log_time_ns=stamp_ns + 1_000_000,
                frame="camera",
                pixels=pixels,
                encoding="jpeg",
            )
        )
    return samples


@lru_cache(maxsize=4)
def _street(side: int) -> NDArray[np.uint8]:
    """Return the whole street as one long picture of blocks and fine grain."""
    random = np.random.default_rng(100 + side)
    width = _LENGTH_M * _PX_PER_M
    blocks = random.integers(30, 226, (6, width // 20, 3), dtype=np.uint8)
    large = cv2.resize(blocks, (width, _SIZE[1]), interpolation=cv2.INTER_NEAREST).astype(float)
    grain = random.normal(0, 12, (_SIZE[1], width, 1))
    return np.clip(large + grain, 0, 255).astype(np.uint8)
