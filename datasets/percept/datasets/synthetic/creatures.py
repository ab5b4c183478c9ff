"""Pedestrians and deer as groups of primitives."""

from __future__ import annotations

import numpy as np

from percept.datasets.synthetic.primitives import Material, ellipsoid, frustum, tint
from percept.datasets.synthetic.shapes import Shape, make_shape

__all__ = ["make_deer", "make_pedestrian"]

_SKIN = Material((0.5, 0.3, 0.2), 0.45)
_FUR = Material((0.28, 0.16, 0.08), 0.42)


def make_pedestrian(rng: np.random.Generator) -> Shape:
    """Draw a pedestrian of 1.5 to 1.9 m in mid-stride, facing +x."""
    s = rng.uniform(1.5, 1.9) / 1.75
    coat = Material(tint(rng, 0.04, 0.6), rng.uniform(0.2, 0.6))
    trousers = Material(tint(rng, 0.02, 0.25), rng.uniform(0.15, 0.5))
    stride = rng.uniform(0.1, 0.2)
    parts = [
        frustum((0, 0, 0.82 * s), (0, 0, 1.45 * s), (0.15 * s, 0.2 * s), coat),
        frustum((0, 0, 1.45 * s), (0, 0, 1.55 * s), 0.06 * s, _SKIN),
        ellipsoid((0.01, 0, 1.62 * s), (0.1 * s, 0.085 * s, 0.13 * s), _SKIN),
    ]
    for side in (-1, 1):
        foot = (side * stride, 0.09 * side * s, 0.04)
        hand = (-side * stride, 0.26 * side * s, 0.8 * s)
        parts.append(frustum(foot, (0, 0.09 * side * s, 0.86 * s), (0.06 * s, 0.085 * s), trousers))
        parts.append(frustum(hand, (0, 0.2 * side * s, 1.4 * s), (0.04 * s, 0.055 * s), coat))
        toe = (side * stride + 0.04, 0.09 * side * s, 0.04)
        parts.append(ellipsoid(toe, (0.13 * s, 0.045 * s, 0.04), trousers))
    return make_shape("pedestrian", parts)


def make_deer(rng: np.random.Generator) -> Shape:
    """Draw a deer with its head up, 1.3 to 1.6 m high, facing +x."""
    s = rng.uniform(0.92, 1.12)
    parts = [
        ellipsoid((0, 0, 0.85 * s), (0.62 * s, 0.19 * s, 0.24 * s), _FUR),
        frustum((0.48 * s, 0, 0.95 * s), (0.72 * s, 0, 1.3 * s), (0.13 * s, 0.08 * s), _FUR),
        ellipsoid((0.82 * s, 0, 1.34 * s), (0.19 * s, 0.08 * s, 0.1 * s), _FUR, (0.0, 0.35, 0.0)),
        ellipsoid((-0.64 * s, 0, 0.92 * s), (0.08 * s, 0.04 * s, 0.1 * s), _FUR),
    ]
    for side in (-1, 1):
        for x in (-0.42, 0.4):
            bottom = (x * s, 0.11 * side * s, 0.0)
            top = (x * s, 0.11 * side * s, 0.78 * s)
            parts.append(frustum(bottom, top, (0.03 * s, 0.065 * s), _FUR))
        ear = (0.7 * s, 0.1 * side * s, 1.46 * s)
        parts.append(ellipsoid(ear, (0.03 * s, 0.07 * s, 0.05 * s), _FUR))
    return make_shape("deer", parts)
