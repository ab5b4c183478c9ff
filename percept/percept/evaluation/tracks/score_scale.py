"""The unit of a detector's scores: probabilities, or the logits that a network ends with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

__all__ = ["ScoreScale"]

_F64 = NDArray[np.float64]

_WEAK_PERCENTILE = 5.0


@dataclass(frozen=True, slots=True)
class ScoreScale:
    """What the scores of all files of a detector together say about their unit.

    Attributes:
        lowest: The lowest score.
        highest: The highest one.
        weak: A score as that of the weakest boxes: 5 % are lower.
    """

    lowest: float
    highest: float
    weak: float

    @classmethod
    def of(cls, scores: Iterable[_F64]) -> Self:
        """Return the scale of scores, an array of any length for each file.

        Those that are not finite say nothing.
        """
        every = np.concatenate([np.zeros(0), *scores])
        every = every[np.isfinite(every)]
        if not len(every):
            return cls(0.0, 0.0, 0.0)
        weak = float(np.percentile(every, _WEAK_PERCENTILE))
        return cls(float(every.min()), float(every.max()), weak)

    @property
    def logits(self) -> bool:
        """Whether scores are no probabilities: some are below 0 or above 1."""
        return self.lowest < 0.0 or self.highest > 1.0

    def probabilities(self, scores: _F64) -> _F64:
        """Return scores (R,) in 0..1: the logistic function of logits, else as they are."""
        from scipy.special import expit

        return np.asarray(expit(scores)) if self.logits else scores
