"""Classes by dimensions and reflectance: rules that a team can read and edit.

Each class has one or more shapes, since an object looks different from its end and from its
side. A shape gives a trapezoid for each feature, and the product of the memberships is how well
a cluster fits (fuzzy sets, Zadeh 1965). Retro-reflective classes gain when rho is high.

Confidence is ``s * s / sum(S)``, with `s` the score of the best class and `S` those of all: 1
when everything is typical of one class and nothing else fits, 0.5 when two classes fit equally
well. Below `min_confidence` the label is `unknown`, and its confidence is one minus that of
the best class.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from percept.core.settings import Settings, load_settings

__all__ = [
    "UNKNOWN",
    "ClassRule",
    "Classification",
    "ClusterFeatures",
    "Rules",
    "ShapeRule",
    "classify_clusters",
    "load_rules",
]

UNKNOWN = "unknown"
_FEATURES = ("length_m", "width_m", "height_m", "clearance_m", "fill", "surface", "rho")
_ANYTHING = (-2e9, -1e9, 1e9, 2e9)
_RULES_FILE = Path(__file__).with_name("rules.yaml")


def _rising(corners: tuple[float, ...]) -> tuple[float, ...]:
    if any(left > right for left, right in pairwise(corners)):
        raise ValueError(f"the numbers must rise, not {list(corners)}")
    return corners


_Trapezoid = Annotated[tuple[float, float, float, float], AfterValidator(_rising)]
_Limit = NDArray[np.float64] | float
_Ramp = Annotated[tuple[float, float], AfterValidator(_rising)]


class ShapeRule(Settings):
    """One way in which a class can look; a feature that is left out may be anything.

    A trapezoid `[a, b, c, d]` is 0 up to a, 1 from b to c, and 0 again from d.

    Attributes:
        length_m: Longer side of the box in bird's-eye view.
        width_m: Shorter side.
        height_m: Top of the box over the ground.
        clearance_m: Bottom of the box over the ground.
        fill: Points on the cluster over the points that a solid box of its size would get at
            its range.
        surface: Share of the points that lie within 0.2 m of a side that faces the sensor.
        rho: Mean normalised intensity.
        weight: Score of a perfect fit.
    """

    length_m: _Trapezoid
    width_m: _Trapezoid
    height_m: _Trapezoid
    clearance_m: _Trapezoid | None = None
    fill: _Trapezoid | None = None
    surface: _Trapezoid | None = None
    rho: _Trapezoid | None = None
    weight: float = Field(default=1.0, gt=0, le=1)


class ClassRule(Settings):
    """One class.

    Attributes:
        shapes: The ways in which it can look, by name; the best fit counts.
        retro_gain: What a fit gains when it is retro-reflective, in 0..1.
    """

    shapes: dict[str, ShapeRule] = Field(min_length=1)
    retro_gain: float = Field(default=0.0, ge=0, le=1)


class Rules(Settings):
    """All classes, as `rules.yaml` gives them.

    Attributes:
        retro: Mean rho of a cluster at which the gain begins, and at which it is full.
        min_confidence: Below this a cluster is `unknown`.
        classes: The classes by label.
    """

    retro: _Ramp = (0.45, 0.65)
    min_confidence: float = Field(default=0.3, ge=0, le=1)
    classes: dict[str, ClassRule] = Field(min_length=1)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Labels in the order of the file."""
        return tuple(self.classes)

    @cached_property
    def trapezoids(self) -> NDArray[np.float64]:
        """(S, 7, 4) float64 corners of all shapes, class after class."""
        return np.array(
            [
                [_ANYTHING if (t := getattr(s, name)) is None else t for name in _FEATURES]
                for rule in self.classes.values()
                for s in rule.shapes.values()
            ]
        )


@dataclass(frozen=True, slots=True, eq=False)
class ClusterFeatures:
    """What the rules judge, for K clusters.

    Attributes:
        length_m: (K,) longer side in bird's-eye view, metres.
        width_m: (K,) shorter side, metres.
        height_m: (K,) top over the ground, metres.
        clearance_m: (K,) bottom over the ground, metres.
        fill: (K,) share of the points that a solid box would get, or NaN where the sensor's
            density is not known.
        surface: (K,) share of the points near a side that faces the sensor, in 0..1.
        rho: (K,) mean normalised intensity in 0..1, or NaN where the sensor has none.
    """

    length_m: NDArray[np.float64]
    width_m: NDArray[np.float64]
    height_m: NDArray[np.float64]
    clearance_m: NDArray[np.float64]
    fill: NDArray[np.float64]
    surface: NDArray[np.float64]
    rho: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Classification:
    """Classes of K clusters.

    Attributes:
        labels: K labels of the rules, or `unknown`.
        confidences: (K,) float64 in 0..1; its meaning is told at the head of this module.
        scores: (K, C) float64 how well each class fits, in 0..1, in the order of the rules.
    """

    labels: tuple[str, ...]
    confidences: NDArray[np.float64]
    scores: NDArray[np.float64]


def load_rules(path: Path | None = None) -> Rules:
    """Read rules from a YAML file, or the ones that ship with percept.

    Raises:
        ConfigError: If the file cannot be read, or a key or value in it is not valid.
    """
    return load_settings(Rules, path or _RULES_FILE)


def classify_clusters(features: ClusterFeatures, rules: Rules) -> Classification:
    """Judge all clusters of a scan by the rules."""
    scores = _score(features, rules)
    count = len(scores)
    best = scores.argmax(axis=1)
    top = scores[np.arange(count), best]
    total = scores.sum(axis=1)
    confidence = np.divide(top * top, total, out=np.zeros(count), where=total > 0)
    known = confidence >= max(rules.min_confidence, np.finfo(np.float64).tiny)
    labels = tuple(
        rules.labels[index] if is_known else UNKNOWN
        for index, is_known in zip(best, known, strict=True)
    )
    return Classification(labels, np.where(known, confidence, 1 - confidence), scores)


def _score(features: ClusterFeatures, rules: Rules) -> NDArray[np.float64]:
    """Return (K, C) how well each class fits each cluster."""
    values = np.stack([getattr(features, name) for name in _FEATURES], axis=1)
    fits = _membership(values[:, None, :], rules.trapezoids[None]).prod(axis=2)
    start, ramp_end = rules.retro
    retro = _ramp(np.nan_to_num(features.rho, nan=-np.inf), start, ramp_end)
    scores = np.empty((len(values), len(rules.classes)))
    shape = 0
    for column, rule in enumerate(rules.classes.values()):
        weights = np.array([s.weight for s in rule.shapes.values()])
        fit = fits[:, shape : shape + len(weights)]
        gained = np.minimum(weights + rule.retro_gain * retro[:, None], 1.0)
        scores[:, column] = (fit * gained).max(axis=1)
        shape += len(weights)
    return scores


def _membership(values: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the trapezoids' values in 0..1; what is not known (NaN) speaks against nothing."""
    rise = _ramp(values, corners[..., 0], corners[..., 1])
    fall = _ramp(-values, -corners[..., 3], -corners[..., 2])
    return np.where(np.isnan(values), 1.0, rise * fall)


def _ramp(values: NDArray[np.float64], start: _Limit, end: _Limit) -> NDArray[np.float64]:
    """Return 0 up to `start`, rising to 1 at `end`, which is 1 itself where both are the same."""
    width = np.maximum(np.subtract(end, start), np.finfo(np.float64).tiny)
    with np.errstate(over="ignore"):
        rise = np.clip((values - start) / width, 0.0, 1.0)
    return np.where(values >= end, 1.0, rise)
