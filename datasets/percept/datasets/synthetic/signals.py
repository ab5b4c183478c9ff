"""When the lamps of a traffic light shine.

Times follow the MUTCD (11th edition, 4F.17 and 4G.01): a yellow change of 3 to 6 s, and
flashing at 50 to 60 a minute with the lamp lit for half to two thirds of the time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["FLASH_LIT_S", "FLASH_PERIOD_S", "SignalPlan", "SignalState", "draw_plan"]

FLASH_PERIOD_S = 1.1
FLASH_LIT_S = 0.6


@dataclass(frozen=True, slots=True)
class SignalState:
    """What a signal shows at one moment.

    Attributes:
        colour: `red`, `yellow` or `green`: what it means, also while a flash is dark.
        flashing: Whether it flashes.
        lit: Whether the lamp shines at this moment.
    """

    colour: str
    flashing: bool
    lit: bool


@dataclass(frozen=True, slots=True)
class SignalPlan:
    """A fixed-time cycle, or a flash.

    Attributes:
        offset_s: How far into its cycle the signal is at time 0.
        green_s: Time of green; 0 together with a flash.
        yellow_s: Yellow change.
        red_s: Time of red.
        flash: `red` or `yellow` where the signal only flashes, else None.
    """

    offset_s: float
    green_s: float
    yellow_s: float
    red_s: float
    flash: str | None = None

    def at(self, time_s: float) -> SignalState:
        """Return the state at a time since the start of the drive."""
        if self.flash is not None:
            lit = (time_s + self.offset_s) % FLASH_PERIOD_S < FLASH_LIT_S
            return SignalState(self.flash, flashing=True, lit=lit)
        phase = (time_s + self.offset_s) % (self.green_s + self.yellow_s + self.red_s)
        if phase < self.green_s:
            return SignalState("green", flashing=False, lit=True)
        colour = "yellow" if phase < self.green_s + self.yellow_s else "red"
        return SignalState(colour, flashing=False, lit=True)


def draw_plan(rng: np.random.Generator, block: int) -> SignalPlan:
    """Draw the plan of a block's signal: every other one flashes, yellow and red in turn.

    The first one turns yellow about a second into the drive, so that a short drive sees it.
    """
    if block % 2:
        colour = "yellow" if block % 4 == 1 else "red"
        return SignalPlan(float(rng.uniform(0, FLASH_PERIOD_S)), 0.0, 0.0, 0.0, colour)
    green, yellow, red = rng.uniform(8, 14), rng.uniform(3.2, 4.5), rng.uniform(8, 14)
    start = green - rng.uniform(0.8, 1.6) if block == 0 else rng.uniform(0, green + yellow + red)
    return SignalPlan(float(start), float(green), float(yellow), float(red))
