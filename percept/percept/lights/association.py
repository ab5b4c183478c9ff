"""Which box of an image is which light of the map.

A camera that looks a little to the side of where pose and calibration say shifts all lights
of the image alike, and by more than the lights lie apart. So that shift is found first, by the
vote of all pairs, and only then boxes and lights are assigned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.errors import GeometryError
from percept.core.settings import Settings
from percept.lights.projection import ProjectedLights

__all__ = ["AssociationConfig", "LightMatches", "match_lights"]

_F64 = NDArray[np.float64]
_LEAST_SIDE_PX = 1.0
_REFINEMENTS = 2
_MOST_SHIFTS = 400


class AssociationConfig(Settings):
    """Costs of pairs; all are squared deviations in units of their spread, as of chi-square.

    Attributes:
        box_sd_px: Standard deviation of a box's centre about the lamp housing.
        box_sd_share: The same as a share of the box's size, which adds to it.
        size_sd: Standard deviation of the logarithm of a box's width and height.
        other_colour_cost: Cost of a colour that the light has no lamp of.
        miss_cost: Cost of a light without a box; a pair that costs more is not made.
    """

    box_sd_px: float = Field(default=1.5, gt=0)
    box_sd_share: float = Field(default=0.15, ge=0)
    size_sd: float = Field(default=0.35, gt=0)
    other_colour_cost: float = Field(default=6.0, ge=0)
    miss_cost: float = Field(default=13.0, gt=0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LightMatches:
    """Lights of the map and boxes of one image.

    Attributes:
        offset_px: (2,) float64 shift of the boxes against the projected lights, u and v.
        pairs: (K, 2) intp row of the projected light and row of the box.
        costs: (K,) float64 cost of each pair.
        missed: (M,) intp rows of projected lights without a box.
        spare: (S,) intp rows of boxes without a light.
    """

    offset_px: _F64
    pairs: NDArray[np.intp]
    costs: _F64
    missed: NDArray[np.intp]
    spare: NDArray[np.intp]


def match_lights(
    projected: ProjectedLights,
    boxes_px: _F64,
    colours: Sequence[str | None] | None = None,
    config: AssociationConfig | None = None,
) -> LightMatches:
    """Assign boxes to projected lights.

    The cost of a pair is the squared Mahalanobis distance of the centres after the shared
    shift, that of the logarithms of width and height, and a cost where the colour is one that
    the light has no lamp of. The pairs of least cost in sum are made, with an explicit cost for
    a light that has none (Hungarian method); of all shifts that lay one box on one light, that
    one is taken with which the sum, and the cost of so large a shift, is least.

    Args:
        projected: Lights that the camera should see.
        boxes_px: (D, 4) float64 boxes of lights in the image.
        colours: For each box `red`, `yellow`, `green` or another word that is no colour, or
            None; None says nothing of any box.
        config: Settings; None takes the defaults.

    Raises:
        GeometryError: If boxes are not (D, 4) or there is not one colour for each.
    """
    config = config or AssociationConfig()
    boxes = np.asarray(boxes_px, dtype=np.float64)
    colours = [None] * len(boxes) if colours is None else colours
    if boxes.shape != (len(colours), 4):
        raise GeometryError(f"{len(colours)} colours need ({len(colours)}, 4), not {boxes.shape}")
    costs = _PairCosts(projected, boxes, colours, config)
    offset, pairs = _best_shift(costs)
    for _ in range(_REFINEMENTS):
        if not len(pairs):
            break
        offset = offset + np.median(costs.residuals(offset)[pairs[:, 0], pairs[:, 1]], axis=0)
        pairs = costs.assign(offset)[1]
    matrix = costs.at(offset)
    return LightMatches(
        offset_px=offset,
        pairs=pairs,
        costs=matrix[pairs[:, 0], pairs[:, 1]],
        missed=np.setdiff1d(np.arange(len(projected)), pairs[:, 0]),
        spare=np.setdiff1d(np.arange(len(boxes)), pairs[:, 1]),
    )


def _best_shift(costs: _PairCosts) -> tuple[_F64, NDArray[np.intp]]:
    """Return the shift (2,) with which everything costs least, and its pairs (K, 2)."""
    best = np.zeros(2), np.zeros((0, 2), np.intp)
    least = np.inf
    for shift in costs.shifts():
        total, pairs = costs.assign(shift)
        total += float(shift @ shift) / costs.projected.shared_sd_px**2
        if total < least:
            least, best = total, (shift, pairs)
    return best


class _PairCosts:
    """Costs of all pairs of projected lights and boxes as a function of the shift."""

    def __init__(
        self,
        projected: ProjectedLights,
        boxes: _F64,
        colours: Sequence[str | None],
        config: AssociationConfig,
    ) -> None:
        self.projected = projected
        self._boxes = boxes
        self._config = config
        self._centres, self._sizes = _centres_and_sizes(boxes)
        self._mismatch = np.array(
            [[_is_other(colour, bulbs) for colour in colours] for bulbs in projected.bulbs]
        ).reshape(len(projected), len(boxes))
        heights = np.maximum(projected.boxes_px[:, 3] - projected.boxes_px[:, 1], _LEAST_SIDE_PX)
        self._variance = (
            config.box_sd_px**2 + (config.box_sd_share * heights) ** 2 + projected.own_sd_px**2
        )

    def shifts(self) -> _F64:
        """Return shifts (S, 2) worth trying: none, and those that lay one box on one light."""
        pairs = self.residuals(np.zeros(2)).reshape(-1, 2)
        length = np.linalg.norm(pairs, axis=1)
        limit = self.projected.shared_sd_px * np.sqrt(self._config.miss_cost * len(self.projected))
        order = np.argsort(length, kind="stable")
        near = pairs[order[length[order] <= limit][:_MOST_SHIFTS]]
        return np.vstack([np.zeros((1, 2)), near])

    def residuals(self, shift: _F64) -> _F64:
        """Return by how much boxes lie off the shifted lights, (N, D, 2) pixels."""
        centres, _ = _centres_and_sizes(self._shifted(shift))
        residuals: _F64 = self._centres[None] - centres[:, None]
        return residuals

    def at(self, shift: _F64) -> _F64:
        """Return the cost of each pair (N, D)."""
        _, sizes = _centres_and_sizes(self._shifted(shift))
        apart = (self.residuals(shift) ** 2).sum(axis=2) / self._variance[:, None]
        ratios = np.log(self._sizes[None] / sizes[:, None]) / self._config.size_sd
        costs: _F64 = apart + (ratios**2).sum(axis=2)
        return costs + self._config.other_colour_cost * self._mismatch

    def assign(self, shift: _F64) -> tuple[float, NDArray[np.intp]]:
        """Return the least sum of costs and the pairs (K, 2) that make it.

        Every light may also take a column of its own, which is its miss.
        """
        from scipy.optimize import linear_sum_assignment

        costs, miss = self.at(shift), self._config.miss_cost
        lights, boxes = costs.shape
        misses = np.full((lights, lights), np.inf)
        np.fill_diagonal(misses, miss)
        padded = np.hstack([np.where(costs < miss, costs, 1e6), misses])
        rows, columns = linear_sum_assignment(padded)
        paired = columns < boxes
        return float(padded[rows, columns].sum()), np.column_stack([rows, columns])[paired]

    def _shifted(self, shift: _F64) -> _F64:
        """Return the shifted lights (N, 4) as the image shows them: cut at its border."""
        edges = np.tile(np.array(self.projected.image_size, dtype=np.float64), 2)
        return np.clip(self.projected.boxes_px + np.tile(shift, 2), 0.0, edges)


def _centres_and_sizes(boxes: _F64) -> tuple[_F64, _F64]:
    sizes = np.maximum(boxes[:, 2:] - boxes[:, :2], _LEAST_SIDE_PX)
    return (boxes[:, 2:] + boxes[:, :2]) / 2, sizes


def _is_other(colour: str | None, bulbs: tuple[str, ...]) -> bool:
    return colour in ("red", "yellow", "green") and bool(bulbs) and colour not in bulbs
