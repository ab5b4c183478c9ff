"""Intensity to a reflectance-like number that means the same for all sensors and ranges.

Sensors write intensity as 0..1, 0..255, 0..65535 or floats that go to 2, and some correct it
for range while others do not. The model here is

    rho = min(1, raw * (range / 10 m)^p / (2 * white))

where `white` is the level of the brightest diffuse surfaces, taken as the 95th percentile over
the first clouds, and `p` the exponent that the sensor left uncorrected (0..2, after the LiDAR
equation). So 0.5 is about white paint, and 1 is twice as bright as that or more, which only
retro-reflective material and mirrors are. For one range, rho never falls when raw rises.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.errors import GeometryError
from percept.core.settings import Settings

__all__ = ["IntensityConfig", "IntensityScale", "estimate_intensity_scale", "normalise_intensity"]

_REFERENCE_RANGE_M = 10.0
_WHITE_PERCENTILE = 95.0
_FEWEST_POINTS = 200
_RANGE_EDGES_M = np.geomspace(5.0, 60.0, 9)
# Clouds of sensors that do correct for range show exponents up to about 0.6, by what stands near
# and far in the scene; an uncorrected one shows about 2.
_CORRECTED_BELOW = 1.0


class IntensityConfig(Settings):
    """What is known of a sensor's intensity; what is None is estimated from the first clouds.

    Attributes:
        white: Raw value of the brightest diffuse surface (white paint) at 10 m.
        range_exponent: Exponent of range that the raw value still falls with; 0 where the
            sensor corrects for range, 2 where it does not.
    """

    white: float | None = Field(default=None, gt=0)
    range_exponent: float | None = Field(default=None, ge=0, le=4)


@dataclass(frozen=True, slots=True)
class IntensityScale:
    """How one sensor's intensity becomes rho.

    Attributes:
        white: Raw value of the brightest diffuse surface at 10 m; rho 0.5.
        range_exponent: Exponent of range that is made up for.
    """

    white: float
    range_exponent: float


def normalise_intensity(
    intensity: NDArray[np.floating], range_m: NDArray[np.floating], scale: IntensityScale
) -> NDArray[np.float32]:
    """Return rho, a reflectance-like number in 0..1, for each point.

    Args:
        intensity: (N,) in the sensor's own units.
        range_m: (N,) distance from the sensor, metres.
        scale: Of this sensor.

    Returns:
        (N,) float32 in 0..1; 0.5 is white paint, retro-reflectors are near 1. A value that is
        NaN stays NaN, a negative one is 0.
    """
    values = np.asarray(intensity, dtype=np.float32)
    if scale.range_exponent:
        ratio = np.asarray(range_m, dtype=np.float32) / np.float32(_REFERENCE_RANGE_M)
        values = values * ratio ** np.float32(scale.range_exponent)
    rho: NDArray[np.float32] = np.clip(values * np.float32(0.5 / scale.white), 0, 1)
    return rho


def estimate_intensity_scale(
    intensity: NDArray[np.floating],
    range_m: NDArray[np.floating],
    config: IntensityConfig | None = None,
) -> IntensityScale | None:
    """Estimate a sensor's scale from points of its first clouds.

    Args:
        intensity: (N,) raw values of points off the ground: a road's return falls with range
            by the angle that it is seen at, which is no property of the sensor.
        range_m: (N,) distance from the sensor, metres.
        config: What is known already.

    Returns:
        The scale, or None where intensity says nothing: fewer than 200 finite values, all
        zero, or all the same.

    Raises:
        GeometryError: If the arrays do not match.
    """
    config = config or IntensityConfig()
    raw, distance = np.asarray(intensity, np.float64), np.asarray(range_m, np.float64)
    if raw.shape != distance.shape or raw.ndim != 1:
        raise GeometryError(f"intensity and range are (N,), not {raw.shape} and {distance.shape}")
    usable = np.isfinite(raw) & (distance > 0)
    raw, distance = raw[usable], distance[usable]
    exponent = config.range_exponent
    if exponent is None:
        exponent = _estimate_range_exponent(raw, distance)
    if config.white is not None:
        return IntensityScale(config.white, exponent)
    if len(raw) < _FEWEST_POINTS or raw.min() == raw.max():
        return None
    compensated = raw * (distance / _REFERENCE_RANGE_M) ** exponent
    white = float(np.percentile(compensated, _WHITE_PERCENTILE))
    return IntensityScale(white, exponent) if white > 0 else None


def _estimate_range_exponent(raw: NDArray[np.float64], distance: NDArray[np.float64]) -> float:
    """Return the exponent by the median slope between range bins (Theil 1950, Sen 1968)."""
    lit = raw > 0
    log_range, log_level = [], []
    for near, far in pairwise(_RANGE_EDGES_M.tolist()):
        values = raw[lit & (distance >= near) & (distance < far)]
        if len(values) >= _FEWEST_POINTS:
            log_range.append(np.log(near * far) / 2)
            log_level.append(np.log(np.median(values)))
    if len(log_range) < 3:
        return 0.0
    rise = np.subtract.outer(log_level, log_level)
    run = np.subtract.outer(log_range, log_range)
    slope = float(np.median(rise[run > 0] / run[run > 0]))
    return min(2.0, -slope) if -slope >= _CORRECTED_BELOW else 0.0
