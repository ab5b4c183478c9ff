"""From probabilities to an answer: which state, whether it flashes, or that it is not known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.lights.config import DecisionConfig

__all__ = ["Answers", "decide"]

_RED, _GREEN = 0, 2
_STEADY = 4
_NAMES = ("red", "yellow", "green", "dark", "unknown")
_UNKNOWN = 4


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What is said of L lights.

    Attributes:
        states: L state names of `LightStates`.
        flashing: (L,) bool.
        probabilities: (L,) float64 of that state and whether it flashes; of `unknown` the
            probability of the likeliest answer, which was too low to be given.
    """

    states: tuple[str, ...]
    flashing: NDArray[np.bool_]
    probabilities: NDArray[np.float64]


def decide(
    classes: NDArray[np.float64],
    config: DecisionConfig,
    *,
    may_flash: NDArray[np.bool_],
    flashed: NDArray[np.bool_],
) -> Answers:
    """Give each light the answer that is probable enough.

    Whether it flashes is settled first. The colour of a flash is named only when it is itself
    probable enough among flashes; as the dark part of a flash says nothing of the colour, it is
    withheld until a lit lamp was seen. While it is open whether a red light flashes, it is red.

    Args:
        classes: (L, 6) probabilities of `CLASSES`.
        config: The limits.
        may_flash: (L,) whether it was seen long and often enough to call it flashing.
        flashed: (L,) whether it was called flashing before.
    """
    flash_share = classes[:, _STEADY:].sum(axis=1)
    limits = np.where(flashed, config.flashing_ends, config.flashing)
    flashing = (may_flash | flashed) & (flash_share >= limits)
    colours = classes[:, :_STEADY].copy()
    colours[:, :2] += classes[:, _STEADY:]
    colours[flashing] = 0
    colours[flashing, :2] = classes[flashing, _STEADY:] / flash_share[flashing, None]
    best = colours.argmax(axis=1)
    rows = np.arange(len(classes))
    needed = np.array([config.red, config.yellow, config.green, config.dark])
    known = colours[rows, best] >= needed[best]
    known &= (best != _GREEN) | (colours[:, _RED] <= config.red_beside_green)
    codes = np.where(known, best, _UNKNOWN)
    exact = classes[rows, np.where(flashing, np.minimum(best, 1) + _STEADY, best)]
    withheld = np.where(flashing, flash_share, classes.max(axis=1, initial=0))
    return Answers(
        tuple(_NAMES[code] for code in codes), flashing, np.where(known, exact, withheld)
    )
