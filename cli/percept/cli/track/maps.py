"""The map that a command is given."""

from __future__ import annotations

from pathlib import Path

from percept.core.errors import UsageError
from percept.core.geodesy import LocalFrame
from percept.hdmap import HdMap, load_map

__all__ = ["load_wanted_map", "named_place"]

_HIGHEST_LATITUDE_DEG, _HIGHEST_LONGITUDE_DEG = 90.0, 180.0


def load_wanted_map(path: Path | None, origin: str | None) -> HdMap | None:
    """Read `--map` and `--origin`; None where no map is given.

    Raises:
        UsageError: If the origin is no place on earth, or is given without a map.
        InputError: If the file is no map.
    """
    if path is None:
        if origin is not None:
            raise UsageError("--origin is for --map, which is not given")
        return None
    return load_map(path, named_place(origin))


def named_place(text: str | None) -> LocalFrame | None:
    """Return the place that `--origin` names; None where it is not given.

    Raises:
        UsageError: If it is no place on earth.
    """
    if text is None:
        return None
    try:
        latitude, longitude, *altitude = (float(part) for part in text.split(","))
    except ValueError:
        latitude, longitude, altitude = float("nan"), 0.0, []
    known = abs(latitude) <= _HIGHEST_LATITUDE_DEG and abs(longitude) <= _HIGHEST_LONGITUDE_DEG
    if not known or len(altitude) > 1:
        raise UsageError(
            f"--origin '{text}' is no place", remedy="Give LAT,LON[,ALT] in degrees and metres"
        )
    return LocalFrame(latitude, longitude, altitude[0] if altitude else 0.0)
