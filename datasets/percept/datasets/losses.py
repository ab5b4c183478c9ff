"""Counting what decoding leaves out, once, however often a recording is read."""

from __future__ import annotations

from collections import Counter

__all__ = ["PassLosses"]


class PassLosses(Counter[str]):
    """What one pass over a recording left out, by reason.

    The same messages fail in every pass, and commands read a log several times. The total
    grows only by what a pass finds beyond all passes before it.

    Args:
        total: The recording's losses; grows with this pass.
        found: What earlier passes found, by reason; shared by all passes of a recording.
    """

    def __init__(self, total: Counter[str], found: Counter[str]) -> None:
        super().__init__()
        self._total = total
        self._found = found

    def __setitem__(self, reason: str, count: int) -> None:
        super().__setitem__(reason, count)
        beyond = count - self._found[reason]
        if beyond > 0:
            self._found[reason] = count
            self._total[reason] += beyond
