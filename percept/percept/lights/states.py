"""The states of a light that the hidden Markov model tells apart, and how they begin.

Steady red, yellow, green, and dark (an outage) are held once for each way in which the detector
may see them at the moment: as one of the four, or at random, as in glare. So an error that lasts
over several images is in the model instead of being counted as many independent ones. Flashing
red and yellow are rings of cells, some lit and some dark, which are passed in turn (Erlang's
method of stages, 1917): the time in each part then has a mean, and a spread of 0.2 of it, and
with it the duty cycle of the MUTCD is in the chain.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from percept.lights.config import LightConfig

__all__ = ["CLASSES", "LightStateSpace"]

CLASSES = ("red", "yellow", "green", "dark", "flashing red", "flashing yellow")
"""What the states are summed to: six answers that exclude each other."""

_RED, _YELLOW, _GREEN, _DARK = range(4)
_LIT_CELLS, _DARK_CELLS = 24, 18
_RING = _LIT_CELLS + _DARK_CELLS + 1
_WAYS = 5
_GLARE = 4


@dataclass(frozen=True)
class LightStateSpace:
    """States in their order: five seen ways of each steady state, then two rings.

    Steady states are red, yellow, green, dark and, where signals have it, red with yellow, which
    counts as red. The ways are red, yellow, green, dark, and at random. A ring has lit cells, dark
    cells, and one in which it is seen at random.
    """

    config: LightConfig

    @property
    def steady(self) -> int:
        """Number of steady states."""
        return 5 if self.config.signals.red_yellow else 4

    @property
    def size(self) -> int:
        """S, number of all states."""
        return _WAYS * self.steady + 2 * _RING

    def seen_as(self, steady: int, seen: int) -> int:
        """Return the index of a steady state that the detector sees in one of the ways."""
        return _WAYS * steady + seen

    def seen_right(self, steady: int) -> int:
        """Return the index of a steady state that is seen as what it is."""
        return self.seen_as(steady, _RED if steady > _DARK else steady)

    def in_glare(self, steady: int) -> int:
        """Return the index of a steady state that is seen at random."""
        return self.seen_as(steady, _GLARE)

    def ring_in_glare(self, colour: int) -> int:
        """Return the index of flashing red (0) or yellow (1) that is seen at random."""
        return int(self.dark_cells(colour)[-1]) + 1

    def lit_cells(self, colour: int) -> NDArray[np.int64]:
        """Return the indices of the lit cells of flashing red (0) or yellow (1), in turn."""
        first = _WAYS * self.steady + colour * _RING
        return np.arange(first, first + _LIT_CELLS)

    def dark_cells(self, colour: int) -> NDArray[np.int64]:
        """Return the indices of the dark cells, which follow the lit ones."""
        first = _WAYS * self.steady + colour * _RING + _LIT_CELLS
        return np.arange(first, first + _DARK_CELLS)

    @cached_property
    def to_classes(self) -> NDArray[np.float64]:
        """Return the (S, 6) matrix that sums states to `CLASSES`."""
        sums = np.zeros((self.size, len(CLASSES)))
        for steady in range(self.steady):
            answer = _RED if steady > _DARK else steady
            sums[_WAYS * steady : _WAYS * (steady + 1), answer] = 1
        for colour in (_RED, _YELLOW):
            sums[self.lit_cells(colour)[0] : self.ring_in_glare(colour) + 1, 4 + colour] = 1
        return sums

    @cached_property
    def prior(self) -> NDArray[np.float64]:
        """Return the (S,) probabilities of a light that comes into view.

        Colours have the shares of time that their mean times give; the phase of a flash is any.
        """
        signals = self.config.signals
        times = np.array([signals.red_s, signals.yellow_s, signals.green_s])
        flashing = (signals.flashing_red_share, signals.flashing_yellow_share)
        left = 1 - sum(flashing) - signals.dark_share
        prior = np.zeros(self.size)
        for steady, share in enumerate([*(left * times / times.sum()), signals.dark_share]):
            prior[_WAYS * steady : _WAYS * steady + 4] = share * self.lasting_errors[steady]
        lit, dark = signals.flash_lit_s, signals.flash_dark_s
        for colour in (_RED, _YELLOW):
            share = flashing[colour] / (lit + dark)
            prior[self.lit_cells(colour)] = share * lit / _LIT_CELLS
            prior[self.dark_cells(colour)] = share * dark / _DARK_CELLS
        return prior

    @cached_property
    def lasting_errors(self) -> NDArray[np.float64]:
        """Return (4, 4): the share of time that each colour is seen as each, by lasting errors."""
        detector = self.config.detector
        shares = np.array(detector.confusion) * detector.lasting_share
        np.fill_diagonal(shares, 0)
        np.fill_diagonal(shares, 1 - shares.sum(axis=1))
        return shares

    @cached_property
    def emissions(self) -> NDArray[np.float64]:
        """Return (S, 4): the probability of each reading, of a box of full confidence."""
        detector = self.config.detector
        whole = np.array(detector.confusion)
        single = whole * (1 - detector.lasting_share)
        np.fill_diagonal(single, 0)
        np.fill_diagonal(single, 1 - single.sum(axis=1))
        rows = np.full((self.size, 4), 0.25)
        for steady in range(self.steady):
            rows[_WAYS * steady : _WAYS * steady + 4] = single
        if self.steady > _DARK + 1:
            both = self.seen_right(_DARK + 1)
            rows[both] = (single[_RED] + single[_YELLOW]) / 2
        for colour in (_RED, _YELLOW):
            rows[self.lit_cells(colour)] = whole[colour]
            rows[self.dark_cells(colour)] = whole[_DARK]
        return rows
