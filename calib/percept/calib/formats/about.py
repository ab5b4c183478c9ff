"""Where the numbers of an export come from, in comment lines."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from percept.calib.formats.reading import read_text
from percept.core.errors import InputError
from percept.core.results import Verdict

__all__ = ["AboutRig", "about_rig"]

_RESULT = "calibration.json"
_RIG_FILE = "rig.yaml"


@dataclass(frozen=True, slots=True)
class AboutRig:
    """Where a rig comes from.

    Attributes:
        lines: percept's version, the file and the beginning of its SHA-256, and the verdict and
            spread of the calibration; no date, so that the same rig gives the same files.
        verdict: The calibration's, or None where nothing is known of it.
    """

    lines: tuple[str, ...]
    verdict: Verdict | None = None


def about_rig(path: Path) -> AboutRig:
    """Return what is known of a rig: a `calibration.json` beside it is used.

    Args:
        path: The rig file, or the folder of the run.

    Raises:
        InputError: If the rig cannot be read, or there is a `calibration.json` that is none.
    """
    source = path / _RIG_FILE if path.is_dir() else path
    sha256 = hashlib.sha256(read_text(source).encode()).hexdigest()
    first = (
        f"written by percept {version('percept-toolkit')} from {source.name}, sha256 {sha256[:16]}"
    )
    beside = source.parent / _RESULT
    if not beside.is_file():
        return AboutRig((first,))
    try:
        result = json.loads(read_text(beside))
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON ({error})", where=beside) from error
    verdict = result.get("verdict") if isinstance(result, dict) else None
    if verdict not in list(Verdict):
        raise InputError("is no result of a calibration", where=beside)
    lines = [first, f"calibration: {verdict}: {_words(result.get('why'))}", *_spread("", result)]
    extrinsics = result.get("extrinsics")
    for entry in extrinsics if isinstance(extrinsics, list) else []:
        if isinstance(entry, Mapping):
            lines += _spread(f"{entry.get('sensor')}: {entry.get('verdict')}, ", entry)
    return AboutRig(tuple(lines), Verdict(verdict))


def _spread(begin: str, result: Mapping[str, Any]) -> list[str]:
    """Return a line with the standard deviations that a result states, if any."""
    parts = []
    for key, unit in (("sd_translation_m", "m"), ("sd_rotation_deg", "deg")):
        values = result.get(key)
        if isinstance(values, list):
            parts.append(f"{' '.join(_number(value) for value in values)} {unit}")
    sd = result.get("sd")
    if isinstance(sd, Mapping):
        parts += [f"{key} {_number(value)} px" for key, value in sd.items()]
    return [f"{begin}standard deviations {', '.join(parts)}"] if parts else []


def _number(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, int | float) else "unknown"


def _words(why: object) -> str:
    return "; ".join(map(str, why)) if isinstance(why, list) else str(why)
