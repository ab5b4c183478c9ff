"""Where the points of a map lie: one frame for all of them, and never two mixed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.geodesy import LocalFrame
from percept.hdmap.georeference import Georeference, fit_georeference
from percept.hdmap.osm import OsmFile, OsmNode, OsmWay

__all__ = ["LAID_ANYWHERE", "MapPoints", "Placement", "place_points"]

_F64 = NDArray[np.float64]
_NO_LOCAL = "points without local_x and local_y, placed by latitude and longitude"
LAID_ANYWHERE = "points of a map without an origin, laid about its own middle"
_CONTRADICTION = (
    "points whose local coordinates and latitudes and longitudes do not go together: where the "
    "map lies on the earth is not known"
)
_LARGEST_M = 1e8  # more than any grid on the earth
_APART_M = 1.0
_APART = (
    "points whose local coordinates lie more than 1 m from where their latitude and longitude are "
    "by the map's own origin; local coordinates were taken"
)
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

    def shapes(self, ways: Mapping[int, OsmWay]) -> dict[int, _F64]:
        """Return the points (K, 3) of line strings by id, of those whose points are all there."""
        counts = np.array([len(way.nodes) for way in ways.values()], dtype=np.intp)
        nodes = chain.from_iterable(way.nodes for way in ways.values())
        rows = self.rows(np.fromiter(nodes, dtype=np.int64, count=int(counts.sum())))
        places = self.xyz_map[rows]
        ends = np.cumsum(counts)
        lost = np.concatenate([[0], np.cumsum(rows < 0)])
        whole = (counts > 0) & (lost[ends] == lost[ends - counts])
        spans = zip(ways, whole.tolist(), (ends - counts).tolist(), ends.tolist(), strict=True)
        return {identity: places[start:end] for identity, ok, start, end in spans if ok}


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where the points of a map were put.

    Attributes:
        points: The points.
        origin: East, north and up of what they lie; None where the map has a grid of its own.
        georeference: The way to latitude and longitude; None where the map does not say.
        assumed: What was assumed, by how many points.
    """

    points: MapPoints
    origin: LocalFrame | None
    georeference: Georeference | None
    assumed: Counter[str]


def place_points(
    file: OsmFile, origin: LocalFrame | None, path: Path, *, anywhere: bool = False
) -> Placement:
    """Bring all points into one frame.

    With an origin given, points are laid east, north and up of it by latitude and longitude.
    Without, by `local_x` and `local_y` where every point has them, as the maps of Autoware
    (metres in a square of the MGRS grid) and of the synthetic world do; or by latitude and
    longitude about the origin that `MetaInfo` names. Where only some points have local
    coordinates, the others are placed by latitude and longitude as these are. Heights are `ele`:
    over the ellipsoid where there is an origin, otherwise taken as they are.

    Args:
        file: The map as it was read.
        origin: Where the map frame lies, or None where the map says it.
        path: The map's file, for messages.
        anywhere: Lay a map that does not say where its frame lies about its own middle.

    Raises:
        InputError: If points can be placed in no one frame, or a coordinate is no number.
    """
    given = _given(file, path)
    own = _own_origin(file.meta, path)
    frame, fitted = origin or own, None
    assumed: Counter[str] = Counter()
    if frame is None:
        fitted = fit_georeference(given.local, given.geodetic)
    if frame is None and fitted is None:
        frame = _without_frame(given, path, assumed, anywhere=anywhere)
    _level_heights(given.geodetic, frame, assumed)
    if origin is None and given.is_local.all():
        _count_apart(given, own, assumed)
        xyz = np.column_stack([given.local, _heights_over(own, given.geodetic)])
    elif frame is not None:
        xyz = frame.local(given.geodetic)
    else:
        xyz = _completed(given, fitted, assumed)
    _check_placed(given.ids, xyz, path)
    reference = fitted if frame is None else Georeference.of_origin(frame)
    return Placement(MapPoints(given.ids, xyz), frame, reference, assumed)


@dataclass(frozen=True, slots=True, eq=False)
class _Given:
    """What a file says of its points: ids (N,), local x and y (N, 2), degrees and height (N, 3)."""

    ids: NDArray[np.int64]
    local: _F64
    geodetic: _F64

    @property
    def is_local(self) -> NDArray[np.bool_]:
        return np.asarray(np.isfinite(self.local).all(axis=1))

    @property
    def is_on_earth(self) -> NDArray[np.bool_]:
        return np.asarray(np.isfinite(self.geodetic[:, :2]).all(axis=1))


def _given(file: OsmFile, path: Path) -> _Given:
    ids = np.array(sorted(file.nodes), dtype=np.int64)
    nodes = [file.nodes[identity] for identity in ids.tolist()]
    height, x, y = (_column(nodes, ids, key, path) for key in ("ele", "local_x", "local_y"))
    degrees = np.array([(node.latitude_deg, node.longitude_deg) for node in nodes])
    geodetic = np.column_stack([degrees.reshape(-1, 2), height])
    return _Given(ids, np.column_stack([x, y]), geodetic)


def _without_frame(
    given: _Given, path: Path, assumed: Counter[str], *, anywhere: bool
) -> LocalFrame | None:
    """Return where to lay a map that names no origin and whose points are no known grid.

    None for one whose points all have local coordinates.
    """
    known = int(given.is_on_earth.sum())
    if given.is_local.all():
        if known > 1:
            assumed[_CONTRADICTION] = known
        return None
    if anywhere and known:
        assumed[LAID_ANYWHERE] = len(given.ids)
        return _middle(given.geodetic)
    lacking = int((~given.is_local).sum())
    raise InputError(
        f"{lacking} of {len(given.ids)} points have no local_x and local_y, and the map names no "
        "origin",
        where=path,
        remedy="Give the origin of the map frame with --origin LAT,LON,ALT",
    )


def _middle(geodetic: _F64) -> LocalFrame:
    """Return the frame in the middle of points (N, 3), level with the middle one of them."""
    low, high = np.nanmin(geodetic[:, :2], axis=0), np.nanmax(geodetic[:, :2], axis=0)
    latitude, longitude = ((low + high) / 2).tolist()
    known = geodetic[np.isfinite(geodetic[:, 2]), 2]
    return LocalFrame(latitude, longitude, float(np.median(known)) if len(known) else 0.0)


def _level_heights(geodetic: _F64, frame: LocalFrame | None, assumed: Counter[str]) -> None:
    """Put points (N, 3) without a height level with the origin, in place."""
    unknown = np.isnan(geodetic[:, 2])
    if unknown.any():
        assumed[_NO_HEIGHT] = int(unknown.sum())
        geodetic[unknown, 2] = 0.0 if frame is None else frame.altitude_m


def _count_apart(given: _Given, own: LocalFrame | None, assumed: Counter[str]) -> None:
    known = given.is_on_earth
    if own is not None and known.any():
        apart = own.local(given.geodetic[known])[:, :2] - given.local[known]
        count = int((np.hypot(apart[:, 0], apart[:, 1]) > _APART_M).sum())
        if count:
            assumed[_APART] = count


def _completed(given: _Given, fitted: Georeference | None, assumed: Counter[str]) -> _F64:
    """Return points (N, 3) by local coordinates, and by latitude and longitude without them."""
    xyz = np.column_stack([given.local, given.geodetic[:, 2]])
    lacking = ~given.is_local
    if fitted is not None:
        assumed[_NO_LOCAL] = int(lacking.sum())
        xyz[lacking, :2] = fitted.map_points(given.geodetic[lacking])[:, :2]
    return xyz


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


def _column(nodes: Sequence[OsmNode], ids: NDArray[np.int64], key: str, path: Path) -> _F64:
    """Return a tag of all points as numbers (N,); NaN where it is not given."""
    texts = [node.tags.get(key) for node in nodes]
    try:
        values = np.array([math.nan if text is None else float(text) for text in texts])
    except ValueError:
        values = np.full(len(texts), np.inf)
    given = np.array([text is not None for text in texts], dtype=bool)
    for row in np.flatnonzero(given & ~(np.abs(values) <= _LARGEST_M)).tolist():
        values[row] = _number(texts[row], f"node {ids[row]}: {key}", path)
    return values


def _number(text: str | None, what: str, path: Path) -> float:
    try:
        number = float(text or "")
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{what}='{(text or '')[:40]}' is no number", where=path)
    if abs(number) > _LARGEST_M:
        raise InputError(f"{what}='{(text or '')[:40]}' is no place on earth", where=path)
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


def _check_placed(ids: NDArray[np.int64], xyz: _F64, path: Path) -> None:
    nowhere = np.flatnonzero(np.isnan(xyz[:, :2]).any(axis=1))
    if len(nowhere):
        raise InputError(
            f"node {ids[nowhere[0]]} has no latitude and longitude ({len(nowhere)} of {len(ids)})",
            where=path,
        )
