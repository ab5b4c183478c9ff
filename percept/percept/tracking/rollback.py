"""Measurements in the order of their time, whatever the order of their arrival.

Each measurement is kept with the state that followed it. A late one is put at its place, and
from there on the states are made anew when they are next asked for. What is older than the
window can no longer change, so its measurements are forgotten and only its states stay.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator

from percept.tracking.measurement import Measurement, order_of
from percept.tracking.step import Stepper
from percept.tracking.track_table import TrackerState

__all__ = ["Timeline"]

_LONG_AGO_NS = -(2**63)


class Timeline:
    """The measurements within a window of time, and all states.

    Args:
        stepper: Makes a state from the one before and a measurement.
        window_ns: How much older than the newest one a measurement may be.
    """

    def __init__(self, stepper: Stepper, window_ns: int) -> None:
        self._stepper = stepper
        self._window_ns = window_ns
        self._settled = [stepper.start()]
        self._settled_stamps: list[int] = []
        self._keys: list[tuple[int, int, str, bytes]] = []
        self._waiting: list[Measurement] = []
        self._states: list[TrackerState] = []
        self._newest_ns = _LONG_AGO_NS

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
        settled = bisect_right(self._settled_stamps, stamp_ns)
        return self._settled[settled] if settled else None

    def states(self) -> Iterator[TrackerState]:
        """Yield the state after each measurement, in order of time."""
        self._replay(len(self._waiting))
        yield from self._settled[1:]
        yield from self._states

    def _replay(self, end: int) -> None:
        """Make the states that are missing before a place."""
        for measurement in self._waiting[len(self._states) : end]:
            last = self._states[-1] if self._states else self._settled[-1]
            self._states.append(self._stepper.step(last, measurement))

    def _settle(self) -> None:
        """Forget the measurements that nothing can come before any more."""
        end = bisect_right(self._keys, self._newest_ns - self._window_ns - 1, key=lambda k: k[0])
        self._replay(end)
        self._settled += self._states[:end]
        self._settled_stamps += [state.stamp_ns for state in self._states[:end]]
        del self._keys[:end], self._waiting[:end], self._states[:end]
