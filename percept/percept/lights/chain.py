"""How a light goes on: rates between its states, and the matrix of a step of any length."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.lights.states import LightStateSpace

__all__ = ["LightChain"]

_RED, _YELLOW, _GREEN, _DARK, _RED_YELLOW = range(5)
_LONGEST_MS = 600_000


class LightChain:
    """A Markov chain in continuous time.

    Its generator Q holds rates per second, and a step of dt seconds has the matrix `expm(Q dt)`
    (Norris 1997, theorem 2.1.1). So any rate of images, uneven steps and long gaps need no cases
    of their own: after a gap the phase of a flash is open, and a red may have become green.

    Args:
        space: The states.
    """

    def __init__(self, space: LightStateSpace) -> None:
        self.space = space
        self.rates_per_s = _generator(space)
        self._steps: dict[int, NDArray[np.float32]] = {0: np.eye(space.size, dtype=np.float32)}

    def step(self, dt_ns: int) -> NDArray[np.float32]:
        """Return the (S, S) matrix of a step: row i holds where state i goes.

        Steps are rounded to 1 ms below 1 s and to 1 % above, and kept, since a drive has few
        different ones.
        """
        step_ms = min(_rounded_ms(dt_ns), _LONGEST_MS)
        found = self._steps.get(step_ms)
        if found is None:
            from scipy.linalg import expm

            exact = np.clip(expm(self.rates_per_s * (step_ms / 1e3)), 0, None)
            found = (exact / exact.sum(axis=1, keepdims=True)).astype(np.float32)
            self._steps[step_ms] = found
        return found


def _rounded_ms(dt_ns: int) -> int:
    step_ms = round(dt_ns / 1e6)
    return step_ms if step_ms < 1000 else round(float(f"{step_ms:.3g}"))


def _generator(space: LightStateSpace) -> NDArray[np.float64]:
    """Return Q (S, S): rates off the diagonal, and rows that sum to 0."""
    rates = np.zeros((space.size, space.size))
    _add_colour_changes(rates, space)
    _add_lasting_errors(rates, space)
    _add_glare(rates, space)
    _add_flashes(rates, space)
    np.fill_diagonal(rates, -rates.sum(axis=1))
    return rates


def _add_colour_changes(rates: NDArray[np.float64], space: LightStateSpace) -> None:
    for start in range(space.steady):
        row = _colour_rates(space)[start]
        for seen in range(5):
            for end in np.flatnonzero(row):
                rates[space.seen_as(start, seen), space.seen_right(int(end))] += row[end]


def _colour_rates(space: LightStateSpace) -> NDArray[np.float64]:
    """Return the rates between steady states that signal regulations and outages give."""
    signals = space.config.signals
    rates = np.zeros((5, 5))
    rates[:3, :3] = signals.illegal_per_s
    rates[:3, _DARK] = 1 / signals.outage_s
    rates[_DARK, :3] = 1 / signals.repair_s / 3
    rates[_GREEN, _YELLOW] = 1 / signals.green_s
    rates[_YELLOW, _RED] = 1 / signals.yellow_s
    if signals.red_yellow:
        rates[_RED, _RED_YELLOW] = 1 / signals.red_s
        rates[_RED_YELLOW, _GREEN] = 1 / signals.red_yellow_s
    else:
        rates[_RED, _GREEN] = 1 / signals.red_s
    np.fill_diagonal(rates, 0)
    return rates[: space.steady, : space.steady]


def _add_lasting_errors(rates: NDArray[np.float64], space: LightStateSpace) -> None:
    """Let lasting errors begin and end so that they take the share of time that they have."""
    detector = space.config.detector
    end_per_s = 1 / detector.lasting_s
    for steady in range(4):
        right = space.seen_right(steady)
        shares = space.lasting_errors[steady]
        for seen in set(range(4)) - {steady}:
            wrong = space.seen_as(steady, seen)
            rates[right, wrong] += end_per_s * shares[seen] / shares[steady]
            rates[wrong, right] += end_per_s


def _add_glare(rates: NDArray[np.float64], space: LightStateSpace) -> None:
    """Let glare begin and end; after it a flash is in whatever phase."""
    begin_per_s = 1 / space.config.detector.glare_every_s
    end_per_s = 1 / space.config.detector.glare_s
    for steady in range(space.steady):
        right, glare = space.seen_right(steady), space.in_glare(steady)
        rates[right, glare] += begin_per_s
        rates[glare, right] += end_per_s
    for colour in (_RED, _YELLOW):
        ring = np.concatenate([space.lit_cells(colour), space.dark_cells(colour)])
        rates[ring, space.ring_in_glare(colour)] += begin_per_s
        rates[space.ring_in_glare(colour), ring] += end_per_s / len(ring)


def _add_flashes(rates: NDArray[np.float64], space: LightStateSpace) -> None:
    """Add the rings, and the ways into them and out of them."""
    signals = space.config.signals
    for colour in (_RED, _YELLOW):
        lit, dark = space.lit_cells(colour), space.dark_cells(colour)
        ring = np.concatenate([lit, dark])
        per_s = np.repeat(
            [len(lit) / signals.flash_lit_s, len(dark) / signals.flash_dark_s],
            [len(lit), len(dark)],
        )
        rates[ring, np.roll(ring, -1)] += per_s
        rates[ring, space.seen_right(_RED)] += 1 / signals.flashing_s
        rates[: space.lit_cells(_RED)[0], lit[0]] += 0.5 / signals.steady_s
