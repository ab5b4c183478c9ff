"""When was a file of a folder recorded? From its name, a list of times beside it, or its place.

In this order, for each sub-folder:

1. `timestamps.txt` (raw KITTI: a date and time a line, UTC) or `times.txt` (KITTI odometry:
   seconds a line), in the folder or above it. A file named by a number has that line, because
   raw KITTI drives lack some scans; otherwise there must be as many lines as files.
2. Names with a number of 16 or more digits: 16 are microseconds, more are nanoseconds.
3. Steps of 0.1 s from 0. A name with one number in it has that step, so that files of one
   number in several folders belong together; otherwise the place in the sorted folder counts.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from percept.core.clock import NS_PER_MS, NS_PER_S

__all__ = ["file_stamps_ns", "stamp_in_name", "time_list"]

_STEP_NS = 100 * NS_PER_MS
_LARGEST_STEP = 10**7
_TIME_LISTS = ("timestamps.txt", "times.txt")
_LEVELS_ABOVE = 2
_NUMBER = re.compile(r"\d+")
_LONG_NUMBER = re.compile(r"(?<!\d)\d{16,19}(?!\d)")
_DATE_TIME = re.compile(r"(\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?\s*$")


def stamp_in_name(path: Path) -> int | None:
    """Return the stamp in ns that a file's name carries, or None."""
    found = _LONG_NUMBER.findall(path.name)
    if not found:
        return None
    return int(found[-1]) * (1000 if len(found[-1]) == 16 else 1)


def file_stamps_ns(
    files: Sequence[Path], root: Path, notes: Counter[str]
) -> tuple[list[int], bool]:
    """Return a stamp for each file of one folder, and whether they are more than mere steps.

    Args:
        files: Files of one folder, sorted.
        root: The folder that was opened; lists of times are not looked for above it.
        notes: Counts lists of times that could not be used, by reason.
    """
    listed = _listed_stamps(files, root, notes)
    if listed is not None:
        return listed, True
    named = [stamp_in_name(file) for file in files]
    if all(stamp is not None for stamp in named):
        return [stamp for stamp in named if stamp is not None], True
    numbers = [_single_number(file) for file in files]
    known = [number for number in numbers if number is not None]
    if len(known) == len(files) and len(set(known)) == len(files) and max(known) <= _LARGEST_STEP:
        return [number * _STEP_NS for number in known], False
    return [place * _STEP_NS for place in range(len(files))], False


def _single_number(file: Path) -> int | None:
    found = _NUMBER.findall(file.stem)
    return int(found[0]) if len(found) == 1 else None


def _listed_stamps(files: Sequence[Path], root: Path, notes: Counter[str]) -> list[int] | None:
    path = time_list(files[0].parent, root)
    if path is None:
        return None
    try:
        lines = path.read_text(encoding="ascii").split("\n")
        stamps = [_parse_time(line) for line in lines if line.strip()]
    except (OSError, ValueError) as error:
        notes[f"{path.name}: not used, {error}"] += 1
        return None
    if all(file.stem.isdecimal() and int(file.stem) < len(stamps) for file in files):
        return [stamps[int(file.stem)] for file in files]
    if len(stamps) == len(files):
        return stamps
    notes[f"{path.name}: not used, it has {len(stamps)} lines for {len(files)} files"] += 1
    return None


def time_list(folder: Path, root: Path) -> Path | None:
    """Return the list of times of a folder, which lies in it or above it; None without one."""
    for _ in range(_LEVELS_ABOVE):
        for name in _TIME_LISTS:
            if (folder / name).is_file():
                return folder / name
        if folder == root:
            break
        folder = folder.parent
    return None


def _parse_time(line: str) -> int:
    matched = _DATE_TIME.match(line.strip())
    if matched is None:
        return round(float(line) * NS_PER_S)
    moment = datetime.fromisoformat(matched[1]).replace(tzinfo=UTC)
    fraction = (matched[2] or "").ljust(9, "0")
    return int(moment.timestamp()) * NS_PER_S + int(fraction)
