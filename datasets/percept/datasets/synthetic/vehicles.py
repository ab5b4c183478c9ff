"""Cars, trucks and cyclists as groups of primitives."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from percept.datasets.synthetic.primitives import Material, Primitive, box, ellipsoid, frustum, tint
from percept.datasets.synthetic.shapes import Shape, make_shape

__all__ = ["make_car", "make_cyclist", "make_truck"]

_GLASS = Material((0.03, 0.04, 0.05), 0.08)
_TYRE = Material((0.02, 0.02, 0.02), 0.06)
_METAL = Material((0.35, 0.35, 0.36), 0.35)
_PLATE = Material((0.8, 0.8, 0.75), 0.6, retro_gain=25.0)
_TAIL_LAMP = Material((0.5, 0.02, 0.02), 0.4, retro_gain=8.0)
_HEAD_LAMP = Material((0.8, 0.8, 0.75), 0.5, retro_gain=3.0)
_SKIN = Material((0.5, 0.3, 0.2), 0.45)

_PAINTS = (
    (0.75, 0.75, 0.75),
    (0.03, 0.03, 0.035),
    (0.35, 0.02, 0.02),
    (0.02, 0.06, 0.3),
    (0.25, 0.26, 0.28),
    (0.05, 0.2, 0.08),
)


def make_car(rng: np.random.Generator) -> Shape:
    """Draw a car of 4.1 to 4.9 m: body, cabin, bonnet, wheels, lamps and plates."""
    length, width = rng.uniform(4.1, 4.9), rng.uniform(1.72, 1.92)
    height, waist = rng.uniform(1.42, 1.7), rng.uniform(0.82, 0.95)
    paint = _paint(rng)
    bonnet = 0.2 * length
    parts = [
        box((-bonnet / 2, 0, (0.28 + waist) / 2), (length - bonnet, width, waist - 0.28), paint),
        box((length / 2 - bonnet / 2, 0, 0.53), (bonnet, 0.96 * width, 0.5), paint),
        box(
            (-0.04 * length, 0, (waist + height) / 2),
            (0.52 * length, 0.86 * width, height - waist),
            _GLASS,
        ),
        box((-0.05 * length, 0, height - 0.02), (0.44 * length, 0.84 * width, 0.06), paint),
    ]
    parts += _wheels((-0.3 * length, 0.31 * length), 0.33, width)
    parts += _lamps(length, width, 0.7)
    return make_shape("car", parts)


def make_truck(rng: np.random.Generator) -> Shape:
    """Draw a box truck of 6.6 to 8.6 m: cab, cargo box, chassis, wheels and lamps."""
    length, width = rng.uniform(6.6, 8.6), rng.uniform(2.25, 2.5)
    height = rng.uniform(2.9, 3.5)
    cab, paint = 1.9, _paint(rng)
    cargo = Material((0.75, 0.75, 0.73), rng.uniform(0.4, 0.7))
    front = length / 2
    parts = [
        box(
            (-cab / 2 - 0.05, 0, (1.0 + height) / 2),
            (length - cab - 0.1, width, height - 1.0),
            cargo,
        ),
        box((front - cab / 2, 0, 1.45), (cab, 0.94 * width, 1.9), paint),
        box((front - 0.12, 0, 1.95), (0.28, 0.86 * width, 0.7), _GLASS),
        box((-0.1, 0, 0.75), (length - 0.4, 0.5 * width, 0.5), _METAL),
    ]
    parts += _wheels((-0.32 * length, front - 1.1), 0.48, width)
    parts += _lamps(length - 0.05, width, 0.85)
    return make_shape("truck", parts)


def make_cyclist(rng: np.random.Generator) -> Shape:
    """Draw a cyclist: two wheels, a frame, and a rider who leans forward."""
    clothes = Material(tint(rng, 0.05, 0.7), rng.uniform(0.25, 0.6))
    frame = Material(tint(rng, 0.05, 0.6), 0.3)
    rider = rng.uniform(0.95, 1.05)
    shoulder, hip = np.array([0.22, 0, 1.4 * rider]), np.array([-0.18, 0, 0.98 * rider])
    head, across = np.array([0.1, 0, 0.24]), np.array([0, 1.0, 0])
    parts = [frustum((x, -0.02, 0.34), (x, 0.02, 0.34), 0.34, _TYRE) for x in (-0.52, 0.52)]
    parts += [
        box((0.0, 0, 0.58), (0.95, 0.04, 0.06), frame, (0.0, -0.25, 0.0)),
        box((-0.2, 0, 0.66), (0.05, 0.04, 0.55), frame, (0.0, -0.25, 0.0)),
        box((0.46, 0, 0.72), (0.05, 0.04, 0.62), frame, (0.0, -0.25, 0.0)),
        box((0.42, 0, 1.02), (0.05, 0.52, 0.05), frame),
        box((-0.72, 0, 0.62), (0.03, 0.1, 0.08), _TAIL_LAMP),
        frustum(hip, shoulder, (0.16, 0.19), clothes),
        ellipsoid(shoulder + head, (0.12, 0.1, 0.14), _SKIN),
    ]
    for side in (-1, 1):
        parts.append(frustum(hip + 0.1 * side * across, (0.12, 0.11 * side, 0.55), 0.08, clothes))
        parts.append(frustum((0.12, 0.11 * side, 0.55), (0.0, 0.11 * side, 0.16), 0.06, clothes))
        parts.append(
            frustum(shoulder + 0.17 * side * across, (0.42, 0.22 * side, 1.05), 0.05, clothes)
        )
    return make_shape("cyclist", parts)


def _paint(rng: np.random.Generator) -> Material:
    return Material(_PAINTS[int(rng.integers(len(_PAINTS)))], float(rng.uniform(0.12, 0.5)))


def _wheels(axles: tuple[float, float], radius: float, width: float) -> Iterator[Primitive]:
    """Yield four wheels that stand on z = 0 inside the body's width."""
    for x in axles:
        for side in (-1, 1):
            outer, inner = side * (width / 2 - 0.01), side * (width / 2 - 0.24)
            yield frustum((x, outer, radius), (x, inner, radius), radius, _TYRE)
            rim = side * (width / 2 - 0.005)
            yield frustum((x, inner, radius), (x, rim, radius), 0.55 * radius, _METAL)


def _lamps(length: float, width: float, z: float) -> Iterator[Primitive]:
    """Yield lamps and licence plates, a few millimetres proud of the body."""
    for side in (-1, 1):
        y = side * (width / 2 - 0.25)
        yield box((length / 2, y, z - 0.05), (0.02, 0.3, 0.14), _HEAD_LAMP)
        yield box((-length / 2, y, z), (0.02, 0.28, 0.16), _TAIL_LAMP)
    yield box((length / 2, 0, z - 0.25), (0.02, 0.5, 0.12), _PLATE)
    yield box((-length / 2, 0, z - 0.1), (0.02, 0.5, 0.12), _PLATE)
