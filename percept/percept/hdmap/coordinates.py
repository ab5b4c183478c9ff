"""Where the points of a map lie: one frame for all of them, and never two mixed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.geodesy import LocalFrame
from percept.hdmap.osm import OsmFile

__all__ = ["MapPoints", "place_points"]

_F64 = NDArray[np.float64]
_NO_HEIGHT = "points without a height ('ele'), taken as level with the origin"


@dataclass(frozen=True, slots=True, eq=False)
class MapPoints:
    """The points of a map in its frame.

    Attributes:
        ids: (N,) int64, rising.
        xyz_map: (N, 3) float64 metres.
    """

    ids: NDArray[np.int64]
    xyz_map: _F64

    def __len__(self) -> int:
        return len(self.ids)

    def rows(self, ids: NDArray[np.int64]) -> NDArray[np.intp]:
        """Return the rows (K,) of points by their ids (K,); -1 of one that is not there."""
        if not len(self.ids):
            return np.full(len(ids), -1, np.intp)
        rows = np.minimum(np.searchsorted(self.ids, ids), len(self.ids) - 1)
        found: NDArray[np.intp] = np.where(self.ids[rows] == ids, rows, -1)
        return found


def place_points(
    file: OsmFile, origin: LocalFrame | None, path: Path
) -> tuple[MapPoints, LocalFrame | None, Counter[str]]:
    """Bring all points into one frame.

    With an origin given, points are laid east, north and up of it by latitude and longitude.
    Without, by `local_x` and `local_y` where every point has them, as the maps of Autoware
    (metres in a square of the MGRS grid) and of the synthetic world do; or by latitude and
    longitude about the origin that `MetaInfo` names. Heights are `ele`: over the ellipsoid
    where there is an origin, otherwise taken as they are.

    Args:
        file: The map as it was read.
        origin: Where the map frame lies, or None where the map says it.
        path: The map's file, for messages.

    Returns:
        The points, the origin where there is one, and counts of what was assumed.

    Raises:
        InputError: If points can be placed in no one frame, or a coordinate is no number.
    """
    ids = np.array(sorted(file.nodes), dtype=np.int64)
    own = _own_origin(file.meta, path)
    frame = origin or own
    assumed: Counter[str] = Counter()
    height = _column(file, ids, "ele", path)
    unknown = np.isnan(height)
    if unknown.any():
        assumed[_NO_HEIGHT] = int(unknown.sum())
        height[unknown] = 0.0 if frame is None else frame.altitude_m
    local = np.column_stack([_column(file, ids, f"local_{axis}", path) for axis in "xy"])
    degrees = np.array([(file.nodes[i].latitude_deg, file.nodes[i].longitude_deg) for i in ids])
    geodetic = np.column_stack([degrees.reshape(-1, 2), height])
    if origin is None and not np.isnan(local).any():
        return MapPoints(ids, np.column_stack([local, _heights_over(own, geodetic)])), own, assumed
    if frame is None:
        lacking = int(np.isnan(local).any(axis=1).sum())
        raise InputError(
            f"{lacking} of {len(ids)} points have no local_x and local_y, and the map names no "
            "origin",
            where=path,
            remedy="Give the origin of the map frame with --origin LAT,LON,ALT",
        )
    _check_placed(ids, geodetic, path)
    return MapPoints(ids, frame.local(geodetic)), frame, assumed


def _own_origin(meta: Mapping[str, str], path: Path) -> LocalFrame | None:
    """Return the origin that `MetaInfo` names."""
    texts = [meta.get(f"origin_{name}") for name in ("lat", "lon", "ele")]
    if texts[0] is None or texts[1] is None:
        return None
    lat, lon, ele = (
        _number(text, f"MetaInfo: origin_{name}", path)
        for text, name in zip((*texts[:2], texts[2] or "0"), ("lat", "lon", "ele"), strict=True)
    )
    if abs(lat) > 90 or abs(lon) > 180:
        raise InputError(f"MetaInfo: the origin {lat:g}, {lon:g} is no place", where=path)
    return LocalFrame(lat, lon, ele)


def _column(file: OsmFile, ids: NDArray[np.int64], key: str, path: Path) -> _F64:
    """Return a tag of all points as numbers (N,); NaN where it is not given."""
    values = np.full(len(ids), np.nan)
    for row, identity in enumerate(ids.tolist()):
        text = file.nodes[identity].tags.get(key)
        if text is not None:
            values[row] = _number(text, f"node {identity}: {key}", path)
    return values


def _number(text: str | None, what: str, path: Path) -> float:
    try:
        number = float(text or "")
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{what}='{(text or '')[:40]}' is no number", where=path)
    return number


def _heights_over(origin: LocalFrame | None, geodetic: _F64) -> _F64:
    """Return heights (N,) over the plane that touches the earth at the origin.

    `ele` follows the earth's curve and the plane does not: 1 km away they differ by 8 cm. Where
    a point has no latitude the difference of the altitudes is taken for it.
    """
    if origin is None:
        return geodetic[:, 2]
    up = origin.local(geodetic)[:, 2]
    return np.where(np.isnan(up), geodetic[:, 2] - origin.altitude_m, up)


def _check_placed(ids: NDArray[np.int64], geodetic: _F64, path: Path) -> None:
    nowhere = np.flatnonzero(np.isnan(geodetic).any(axis=1))
    if len(nowhere):
        raise InputError(
            f"node {ids[nowhere[0]]} has no latitude and longitude ({len(nowhere)} of {len(ids)})",
            where=path,
        )
