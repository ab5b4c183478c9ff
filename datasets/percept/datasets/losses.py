"""Counting what decoding leaves out, once, however often a recording is read."""

from __future__ import annotations

import itertools
import threading
from collections import Counter
from collections.abc import Mapping

__all__ = ["DecodingLosses", "PassLosses"]


class DecodingLosses:
    """What decoding leaves out of a recording, over all passes; threads may count at once.

    The same messages fail in every pass, and commands read a log several times. The total
    grows only by what a pass finds beyond all passes before it.

    Args:
        total: The recording's losses; grows with every pass.
    """

    def __init__(self, total: Counter[str]) -> None:
        self._total = total
        self._found: Counter[str] = Counter()
        self._examples: dict[str, tuple[int, str]] = {}
        self._places = itertools.count()
        self._lock = threading.Lock()

    def new_pass(self) -> PassLosses:
        """Return the counters of one more pass."""
        return PassLosses(self)

    def next_place(self) -> int:
        """Return the place of the next message that is read, in the order of reading."""
        return next(self._places)

    def add_notes(self, seen: Counter[str], notes: Mapping[str, int]) -> None:
        """Count what was left out of samples, by reason, on top of what a pass has seen."""
        with self._lock:
            for reason, count in notes.items():
                self._add(seen, reason, reason, count)

    def add_failure(self, seen: Counter[str], kind: str, place: int, why: str) -> None:
        """Count a message that cannot be decoded, on top of what a pass has seen.

        Of all of a kind the one that was read first says why, whichever thread is the fastest.
        """
        with self._lock:
            first = self._examples.get(kind)
            if first is None or place < first[0]:
                self._examples[kind] = (place, why)
                if first is not None:
                    count = self._total.pop(_reason(kind, first[1]), 0)
                    self._total[_reason(kind, why)] += count
            self._add(seen, kind, _reason(kind, self._examples[kind][1]), 1)

    def _add(self, seen: Counter[str], key: str, reason: str, count: int) -> None:
        seen[key] += count
        beyond = seen[key] - self._found[key]
        if beyond > 0:
            self._found[key] = seen[key]
            self._total[reason] += beyond


class PassLosses:
    """What one pass over a recording leaves out; `DecodingLosses.new_pass` makes it."""

    def __init__(self, all_passes: DecodingLosses) -> None:
        self._all_passes = all_passes
        self._seen: Counter[str] = Counter()
        self.next_place = all_passes.next_place

    def add_notes(self, notes: Mapping[str, int]) -> None:
        """Count what was left out of samples, by reason."""
        self._all_passes.add_notes(self._seen, notes)

    def add_failure(self, kind: str, place: int, why: str) -> None:
        """Count a message that cannot be decoded.

        Args:
            kind: Which ones it is counted with, such as `messages on /points`.
            place: Its place among the messages, of `next_place`.
            why: What is wrong with it, for the example that is named.
        """
        self._all_passes.add_failure(self._seen, kind, place, why)


def _reason(kind: str, why: str) -> str:
    return f"{kind} that cannot be decoded ({why})"
