"""Intensity: one scale for all sensors, monotone, with retro-reflectors well above the rest."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.lidar.intensity import (
    IntensityConfig,
    IntensityScale,
    estimate_intensity_scale,
    normalise_intensity,
)

_RETRO = 0.03


def _scene(seed: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Reflectance of diffuse surfaces (up to 0.8) and retro-reflectors (3), with ranges."""
    rng = np.random.default_rng(seed)
    reflectance = rng.beta(2, 5, 20_000) * 0.8
    retro = rng.random(20_000) < _RETRO
    reflectance[retro] = 3.0
    return reflectance, rng.uniform(4, 60, 20_000), retro


@pytest.mark.parametrize("full_scale", [1.0, 255.0, 65535.0, 0.02])
@pytest.mark.parametrize("exponent", [0.0, 2.0])
def test_all_sensors_come_to_one_scale(full_scale: float, exponent: float) -> None:
    reflectance, range_m, retro = _scene()
    raw = full_scale * reflectance * (10 / range_m) ** exponent
    scale = estimate_intensity_scale(raw, range_m)
    assert scale is not None
    assert scale.range_exponent == pytest.approx(exponent, abs=0.15)
    rho = normalise_intensity(raw, range_m, scale)
    assert rho.dtype == np.float32
    assert rho.min() >= 0
    assert rho.max() <= 1
    assert np.median(rho[~retro]) == pytest.approx(0.24, abs=0.06)
    assert rho[retro].min() > 0.9
    assert np.percentile(rho[~retro], 99) < 0.65


def test_rho_never_falls_when_raw_rises() -> None:
    raw = np.linspace(-1, 300, 1000)
    for scale in (IntensityScale(60.0, 0.0), IntensityScale(5.0, 2.0)):
        for range_m in (1.0, 10.0, 80.0):
            rho = normalise_intensity(raw, np.full(1000, range_m), scale)
            assert (np.diff(rho) >= 0).all()
            assert rho[0] == 0


def test_white_paint_is_one_half() -> None:
    rho = normalise_intensity(np.array([60.0]), np.array([25.0]), IntensityScale(60.0, 0.0))
    assert rho[0] == pytest.approx(0.5)


@pytest.mark.parametrize(
    "raw",
    [np.zeros(5000), np.full(5000, 7.0), np.linspace(0, 1, 50), np.full(5000, np.nan)],
    ids=["zero", "constant", "few", "nan"],
)
def test_intensity_that_says_nothing_has_no_scale(raw: NDArray[np.float64]) -> None:
    assert estimate_intensity_scale(raw, np.full(len(raw), 10.0)) is None


def test_what_the_settings_say_wins() -> None:
    reflectance, range_m, _ = _scene()
    known = IntensityConfig(white=3.0, range_exponent=1.5)
    scale = estimate_intensity_scale(reflectance, range_m, known)
    assert scale == IntensityScale(3.0, 1.5)


def test_arrays_that_do_not_match_are_refused() -> None:
    with pytest.raises(GeometryError, match="intensity and range"):
        estimate_intensity_scale(np.zeros(3), np.zeros(4))
