"""What stands beside the road: barrels, barricades, cones, signs, signals, poles, buildings."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from percept.datasets.synthetic.primitives import (
    Material,
    Primitive,
    box,
    ellipsoid,
    frustum,
    tint,
)
from percept.datasets.synthetic.shapes import Shape, make_scenery, make_shape

__all__ = [
    "LAMPS",
    "make_barrel",
    "make_barricade",
    "make_building",
    "make_cone",
    "make_lamp_post",
    "make_sign",
    "make_signal",
    "make_tree",
    "signal_lamps",
]

LAMPS = ("red", "yellow", "green")
"""Lamps of a signal head, from top to bottom."""

_LAMP_PITCH_M = 0.35
_LIT = {"red": (1.0, 0.04, 0.02), "yellow": (1.0, 0.6, 0.02), "green": (0.04, 1.0, 0.35)}
_UNLIT = {"red": (0.08, 0.01, 0.01), "yellow": (0.08, 0.06, 0.01), "green": (0.01, 0.07, 0.04)}

_ORANGE = Material((0.9, 0.22, 0.02), 0.5)
_ORANGE_SHEET = Material((0.9, 0.22, 0.02), 0.5, retro_gain=15.0)
_WHITE_SHEET = Material((0.85, 0.85, 0.85), 0.7, retro_gain=25.0)
_RUBBER = Material((0.03, 0.03, 0.03), 0.08)
_STEEL = Material((0.35, 0.36, 0.37), 0.35)
_HOUSING = Material((0.02, 0.02, 0.02), 0.08)


def make_barrel(rng: np.random.Generator) -> Shape:
    """Draw a traffic drum of about 1 m with alternating retro-reflective bands."""
    height = rng.uniform(0.9, 1.02)
    levels = np.linspace(0.08, height, 7)
    radii = np.linspace(0.3, 0.24, 7)
    bands = (_ORANGE, _WHITE_SHEET, _ORANGE_SHEET, _WHITE_SHEET, _ORANGE_SHEET, _ORANGE)
    parts = [frustum((0, 0, 0), (0, 0, 0.08), 0.34, _RUBBER)]
    for i, band in enumerate(bands):
        ends = (0, 0, levels[i]), (0, 0, levels[i + 1])
        parts.append(frustum(*ends, (float(radii[i]), float(radii[i + 1])), band))
    return make_shape("barrel", parts)


def make_barricade(rng: np.random.Generator) -> Shape:
    """Draw a barricade with three striped rails across x and two feet."""
    length, height = rng.uniform(1.2, 1.8), rng.uniform(1.2, 1.5)
    parts: list[Primitive] = []
    for i in range(3):
        z = height - 0.12 - 0.42 * i
        count = 6
        for k in range(count):
            x = (k + 0.5) / count * length - length / 2
            sheet = _WHITE_SHEET if (k + i) % 2 else _ORANGE_SHEET
            parts.append(box((x, 0, z), (length / count, 0.03, 0.22), sheet))
    for side in (-1, 1):
        x = side * (length / 2 - 0.15)
        parts.append(box((x, 0.04, height / 2), (0.05, 0.05, height), _STEEL))
        parts.append(box((x, 0, 0.03), (0.06, 0.6, 0.06), _STEEL))
    return make_shape("barricade", parts)


def make_cone(rng: np.random.Generator) -> Shape:
    """Draw a traffic cone with two retro-reflective collars."""
    height = rng.uniform(0.68, 0.78)
    levels = np.array([0.03, 0.4 * height, 0.55 * height, 0.65 * height, 0.8 * height, height])
    radii = np.interp(levels, [0.03, height], [0.14, 0.03])
    bands = (_ORANGE, _WHITE_SHEET, _ORANGE, _WHITE_SHEET, _ORANGE)
    parts = [box((0, 0, 0.015), (0.36, 0.36, 0.03), _RUBBER)]
    for i, band in enumerate(bands):
        ends = (0, 0, levels[i]), (0, 0, levels[i + 1])
        parts.append(frustum(*ends, (float(radii[i]), float(radii[i + 1])), band))
    return make_shape("cone", parts)


def make_sign(rng: np.random.Generator) -> Shape:
    """Draw a retro-reflective plate on a pole, facing +y: round, square or upright."""
    colour = ((0.8, 0.02, 0.02), (0.9, 0.9, 0.9), (0.9, 0.6, 0.02))[int(rng.integers(3))]
    sheet = Material(colour, 0.6, retro_gain=30.0)
    top = rng.uniform(2.3, 2.9)
    parts = [frustum((0, 0, 0), (0, 0, top), 0.035, _STEEL)]
    style = int(rng.integers(3))
    if style == 0:
        radius = rng.uniform(0.3, 0.4)
        z = top - radius
        parts.append(frustum((0, 0.04, z), (0, 0.055, z), radius, sheet))
    else:
        width = rng.uniform(0.6, 0.75)
        height = width if style == 1 else 1.25 * width
        parts.append(box((0, 0.0475, top - height / 2), (width, 0.015, height), sheet))
    return make_shape("sign", parts)


def signal_lamps() -> tuple[float, ...]:
    """Return the heights of the lamps of a signal head over its foot, in the order of `LAMPS`."""
    return tuple(0.53 + (1 - i) * _LAMP_PITCH_M for i in range(len(LAMPS)))


@lru_cache(maxsize=4)
def make_signal(lit: str | None) -> Shape:
    """Return one signal head with three lamps, facing +y; `lit` names the lamp that shines."""
    parts = [box((0, 0, 0.53), (0.36, 0.24, 1.06), _HOUSING)]
    for lamp, z in zip(LAMPS, signal_lamps(), strict=True):
        shines = lamp == lit
        glass = Material((_LIT if shines else _UNLIT)[lamp], 0.2, emission=float(shines))
        parts.append(frustum((0, 0.11, z), (0, 0.13, z), 0.14, glass))
    return make_scenery("traffic_light", parts)


def make_lamp_post(height_m: float, arm_m: float) -> Shape:
    """Return a post at x = 0 with an arm along +x; signals or a lantern hang from such arms."""
    parts = [frustum((0, 0, -0.2), (0, 0, height_m), (0.12, 0.08), _STEEL)]
    if arm_m > 0:
        parts.append(frustum((0, 0, height_m), (arm_m, 0, height_m), (0.07, 0.05), _STEEL))
    return make_scenery("pole", parts)


def make_tree(rng: np.random.Generator) -> Shape:
    """Draw a tree: a trunk and a crown of three ellipsoids."""
    bark = Material((0.16, 0.1, 0.06), 0.3)
    leaves = Material((0.06, rng.uniform(0.16, 0.28), 0.04), 0.5)
    trunk = rng.uniform(2.2, 3.0)
    parts = [frustum((0, 0, -0.2), (0, 0, trunk + 0.6), (0.2, 0.12), bark)]
    for _ in range(3):
        offset = rng.uniform(-0.4, 0.4, 3)
        semi = rng.uniform((0.8, 0.8, 1.0), (1.2, 1.2, 1.6))
        parts.append(ellipsoid(np.array([0, 0, trunk + 1.4]) + offset, semi, leaves))
    return make_scenery("tree", parts)


def make_building(rng: np.random.Generator, length_m: float) -> Shape:
    """Draw a building of a given length that reaches 1.5 m into the ground."""
    depth, height = rng.uniform(8, 12), rng.uniform(6, 16)
    wall = Material(tint(rng, 0.34, 0.52), rng.uniform(0.3, 0.6))
    parts = [
        box((0, 0, height / 2 - 0.75), (length_m, depth, height + 1.5), wall),
        box((0, 0, height + 0.1), (length_m + 0.4, depth + 0.4, 0.3), _STEEL),
    ]
    return make_scenery("building", parts)
