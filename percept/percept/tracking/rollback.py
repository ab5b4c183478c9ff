"""Measurements in the order of their time, whatever the order of their arrival.

Each measurement is kept with the state that followed it. A late one is put at its place, and
from there on the states are made anew when they are next asked for. What is older than the
window can no longer change: of that the measurements stay, and one state in `_STRIDE`, from which
the others can be made again exactly. That is a fifth of the memory of all states.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator

from percept.tracking.measurement import Measurement, order_of
from percept.tracking.step import Stepper
from percept.tracking.track_table import TrackerState

__all__ = ["Timeline"]

_LONG_AGO_NS = -(2**63)
_STRIDE = 32


class Timeline:
    """All measurements in order of time, and the states within a window of it.

    Args:
        stepper: Makes a state from the one before and a measurement.
        window_ns: How much older than the newest one a measurement may be.
    """

    def __init__(self, stepper: Stepper, window_ns: int) -> None:
        self._stepper = stepper
        self._window_ns = window_ns
        self._newest_ns = _LONG_AGO_NS
        # Within the window, where measurements may still come in between.
        self._keys: list[tuple[int, int, str, bytes]] = []
        self._waiting: list[Measurement] = []
        self._states: list[TrackerState] = []
        # Before it: all measurements, and the states before each first one of a stretch.
        self._settled: list[Measurement] = []
        self._marks: list[TrackerState] = [stepper.start()]
        self._last = self._marks[0]
        self._stretch: tuple[int, list[TrackerState]] = (-1, [])

    def insert(self, measurement: Measurement) -> bool:
        """Put a measurement at its place in time; False where it is older than the window."""
        if measurement.stamp_ns < self._newest_ns - self._window_ns:
            return False
        key = order_of(measurement)
        place = bisect_right(self._keys, key)
        self._keys.insert(place, key)
        self._waiting.insert(place, measurement)
        del self._states[place:]
        if measurement.stamp_ns > self._newest_ns:
            self._newest_ns = measurement.stamp_ns
            self._settle()
        return True

    def before(self, stamp_ns: int) -> TrackerState | None:
        """Return the state after the last measurement up to a time, or None where there is none."""
        place = bisect_right(self._keys, stamp_ns, key=lambda key: key[0])
        if place:
            self._replay(place)
            return self._states[place - 1]
        settled = bisect_right(self._settled, stamp_ns, key=lambda one: one.stamp_ns)
        if settled == len(self._settled):
            return self._last if settled else None
        return self._remade(settled - 1) if settled else None

    def states(self) -> Iterator[TrackerState]:
        """Yield the state after each measurement, in order of time."""
        self._replay(len(self._waiting))
        yield from map(self._remade, range(len(self._settled)))
        yield from self._states

    def _replay(self, end: int) -> None:
        """Make the states that are missing before a place within the window."""
        for measurement in self._waiting[len(self._states) : end]:
            last = self._states[-1] if self._states else self._last
            self._states.append(self._stepper.step(last, measurement))

    def _settle(self) -> None:
        """Let go the states that nothing can come before any more."""
        end = bisect_right(self._keys, self._newest_ns - self._window_ns - 1, key=lambda k: k[0])
        self._replay(end)
        for measurement, state in zip(self._waiting[:end], self._states[:end], strict=True):
            self._settled.append(measurement)
            self._last = state
            if len(self._settled) % _STRIDE == 0:
                self._marks.append(state)
        del self._keys[:end], self._waiting[:end], self._states[:end]

    def _remade(self, place: int) -> TrackerState:
        """Return the state after a settled measurement; those around it are kept for the next."""
        number = place // _STRIDE
        if number != self._stretch[0]:
            self._stretch = (number, [self._marks[number]])
        _, states = self._stretch
        first = number * _STRIDE
        for measurement in self._settled[first + len(states) - 1 : place + 1]:
            states.append(self._stepper.step(states[-1], measurement))
        return states[place - first + 1]
