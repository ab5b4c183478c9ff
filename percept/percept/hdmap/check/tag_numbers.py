"""Numbers in tags."""

from __future__ import annotations

import math
import re

__all__ = ["number_in"]

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def number_in(word: str) -> float | None:
    """Return the number that a tag's word is; None of one with a unit, or of no finite number."""
    number = float(word) if _NUMBER.fullmatch(word.strip()) else math.inf
    return number if math.isfinite(number) else None
