"""What is written around the numbers: frames in words, names of files, numbers as text.

Names come from strangers' rigs: nothing here lets one leave a comment, a line or a folder.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from percept.core.rig import Rig
from percept.core.transform import Transform

__all__ = [
    "commented",
    "file_names",
    "numbers",
    "one_line",
    "rounded",
    "transforms_in_words",
    "xml_comment",
]

_DECIMALS = 9  # of metres, radians and quaternions: a nanometre
_LONGEST_NAME = 80


def one_line(text: str) -> str:
    """Return a text without line breaks and other letters that cannot be seen."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def commented(lines: Iterable[str], mark: str = "# ") -> str:
    """Return lines as comments, each behind a mark and with an end."""
    return "".join(f"{mark}{one_line(line)}".rstrip() + "\n" for line in lines)


def xml_comment(lines: Iterable[str]) -> str:
    """Return lines as one XML comment, in which no two hyphens may follow each other."""
    safe = (re.sub(r"-(?=-)", "- ", one_line(line)) for line in lines)
    inner = "\n".join(f"  {line}" for line in safe)
    return f"<!--\n{inner}\n-->\n"


def file_names(names: Iterable[str]) -> dict[str, str]:
    """Return a safe file name, without ending, for each name; no two are alike.

    Letters other than those of plain file names become underscores, so that no name can lead
    out of the folder.
    """
    safe: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name)[:_LONGEST_NAME].strip("_-") or "sensor"
        candidate, number = plain, 2
        while candidate.lower() in taken:
            candidate, number = f"{plain}_{number}", number + 1
        taken.add(candidate.lower())
        safe[name] = candidate
    return safe


def rounded(values: Sequence[float] | NDArray[np.float64]) -> list[float]:
    """Return plain numbers with nine decimals, and no negative zero."""
    return [round(float(value), _DECIMALS) + 0.0 for value in values]


def numbers(values: Sequence[float] | NDArray[np.float64], *, decimals: int = _DECIMALS) -> str:
    """Return numbers as text with blanks between them."""
    return " ".join(f"{float(value) + 0.0:.{decimals}f}" for value in values)


def transforms_in_words(rig: Rig) -> list[str]:
    """Return both directions of every known transform, with the frames in words, as lines."""
    lines: list[str] = []
    for sensor in rig.sensors.values():
        if sensor.T_base_sensor is None:
            continue
        for transform in (sensor.T_base_sensor, sensor.T_base_sensor.inverse()):
            lines += _in_words(transform)
    return lines


def _in_words(transform: Transform) -> list[str]:
    target, source = transform.target, transform.source
    first = f"T_{target}_{source}: point_{target} = T * point_{source}, metres"
    rows = [f"  [{', '.join(f'{value: .9f}' for value in row)}]" for row in transform.matrix]
    return [first, *rows]
