"""Lines of paint that the map does not have."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from percept.core.map_findings import Discrepancy, Kind
from percept.core.polyline import length_m
from percept.hdmap.elements import Lanelet
from percept.hdmap.validate.config import ValidationConfig
from percept.hdmap.validate.findings import best_looks, finding_id, looks_factor
from percept.hdmap.validate.lanes import in_lanes
from percept.hdmap.validate.match import folded
from percept.hdmap.validate.pieces import LONGEST_DASH_M, LONGEST_GAP_M
from percept.hdmap.validate.stations import STATION_M, Stations
from percept.hdmap.validate.tally import Tally
from percept.hdmap.validate.unmatched import CELL_M

__all__ = ["extra_lines", "with_links"]

_F64 = NDArray[np.float64]
_Rows = NDArray[np.void]

_ASIDE_M = 0.4
_TURN_RAD = np.radians(12.0)
_LEAST_SHARE = 0.3
_LEAST_PAINT_M = 5.0
_BORDER_M = 0.6
_BORDER_TRUST = 0.8
_LINK_M = 3.0
_IN_LANE_SHARE = 0.5
_BESIDE_TRUST = 0.4
_PARALLEL_RAD = np.radians(4.0)
_SOLID_SHARE, _DASHED_SHARE = 0.8, 0.15


@dataclass(frozen=True, slots=True, eq=False)
class _Chain:
    """Cells of one line in their order, with points (N, 3) every half metre or more."""

    rows: _Rows
    points: _F64
    length_m: float
    painted_m: float


def extra_lines(
    cells: _Rows,
    stations: Stations,
    unpainted: Stations,
    lanelets: Mapping[int, Lanelet],
    tally: Tally,
    sensors: Sequence[str],
    config: ValidationConfig,
) -> Iterator[Discrepancy]:
    """Return lines of at least 8 m among the paint that belongs to no line of the map.

    What lies beside all lanes, or is not parallel to the lines of the map, is trusted less: it
    is more often a kerb or the foot of a parked car than paint.

    Args:
        cells: As `UnmatchedPaint.rows` returns them.
        stations: Of the painted lines of the map.
        unpainted: Of its other lines: paint along one belongs to it.
        lanelets: Of the map; without any, all places are taken to be on a lane.
        tally: Sums of the stations: how many looks saw the road beside a cell.
        sensors: Names of the sensors by number.
        config: What counts.
    """
    if not len(cells):
        return
    share = cells["looks"] / np.maximum(_looks_beside(cells, stations, tally), 1.0)
    cells, share = cells[share >= _LEAST_SHARE], share[share >= _LEAST_SHARE]
    for members in _chains_of(cells):
        chain = _in_order(cells[members])
        if chain.length_m < config.shortest_m or chain.painted_m < _LEAST_PAINT_M:
            continue
        sure = looks_factor(float(np.median(chain.rows["looks"])))
        sure *= min(1.0, float(np.median(share[members])) / 0.6)
        sure *= 1.0 - math.exp(-chain.painted_m / (0.6 * _LEAST_PAINT_M))
        if lanelets and float(np.mean(in_lanes(chain.points[:, :2], lanelets))) < _IN_LANE_SHARE:
            sure *= _BESIDE_TRUST
        if _turn_to_map(chain, stations) > _PARALLEL_RAD:
            sure *= _BESIDE_TRUST
        yield _finding(chain, unpainted, sensors, sure)


def with_links(findings: list[Discrepancy]) -> list[Discrepancy]:
    """Say in words where a line that the map lacks may be one that is gone from its place."""
    gone = [finding for finding in findings if finding.kind is Kind.MISSING_ON_ROAD]
    linked = []
    for finding in findings:
        if finding.kind is Kind.MISSING_IN_MAP and gone:
            apart = [_apart(finding, other) for other in gone]
            best = int(np.argmin(apart))
            if apart[best] <= _LINK_M:
                words = (
                    f"{finding.observed}; perhaps line {gone[best].map_element_id}, "
                    f"which is gone {apart[best]:.1f} m beside it"
                )
                finding = replace(finding, observed=words)
        linked.append(finding)
    return linked


def _turn_to_map(chain: _Chain, stations: Stations) -> float:
    """Return the angle between a line's chord and the nearest line of the map."""
    chord = chain.points[-1, :2] - chain.points[0, :2]
    near = stations.tree.query(chain.points[:, :2])[1]
    along = stations.tangents[near]
    along = along * np.sign(along @ along[0])[:, None]
    mean = along.mean(axis=0)
    return float(abs(folded(np.arctan2(chord[1], chord[0]) - np.arctan2(mean[1], mean[0]))))


def _looks_beside(cells: _Rows, stations: Stations, tally: Tally) -> _F64:
    near = stations.tree.query(np.stack([cells["x"], cells["y"]], axis=1))[1]
    looks: _F64 = tally.rows(near)["looks"].astype(np.float64)
    return looks


def _chains_of(cells: _Rows) -> list[NDArray[np.int64]]:
    """Return the rows of cells that lie on one line: each bends to the next as on an arc."""
    if not len(cells):
        return []
    points = np.stack([cells["x"], cells["y"]], axis=1)
    yaw = 0.5 * np.arctan2(cells["sin2"], cells["cos2"])
    pairs = cKDTree(points).query_pairs(LONGEST_GAP_M, output_type="ndarray")
    apart = points[pairs[:, 1]] - points[pairs[:, 0]]
    distance = np.linalg.norm(apart, axis=1)
    turn = folded(yaw[pairs[:, 1]] - yaw[pairs[:, 0]])
    mean = yaw[pairs[:, 0]] + turn / 2
    aside = np.abs(np.cos(mean) * apart[:, 1] - np.sin(mean) * apart[:, 0])
    fits = (np.abs(turn) < _TURN_RAD) & (aside < _ASIDE_M) & (distance > 0)
    fits &= (aside < 0.1 * distance) | (distance < 3 * CELL_M)
    first, second = pairs[fits].T
    graph = coo_matrix((np.ones(len(first)), (first, second)), shape=(len(cells), len(cells)))
    count, label = connected_components(graph, directed=False)
    return [np.flatnonzero(label == number) for number in range(count)]


def _in_order(rows: _Rows) -> _Chain:
    """Put cells in order along their line: by the projection on its chord."""
    points = np.stack([rows["x"], rows["y"], rows["z"]], axis=1)
    apart = points[:, :2] - points[:, :2].mean(axis=0)
    axis = np.linalg.svd(apart, full_matrices=False)[2][0] if len(rows) > 1 else np.array([1.0, 0])
    along = apart @ axis
    place = np.floor((along - along.min()) / (2 * CELL_M)).astype(np.int64)
    _, of = np.unique(place, return_inverse=True)
    weight = np.bincount(of, rows["strokes"])
    path = np.stack([np.bincount(of, rows["strokes"] * c) / weight for c in points.T], axis=1)
    covered = np.zeros(round(float(np.ptp(along)) / STATION_M) + 1, dtype=bool)
    covered[np.rint((along - along.min()) / STATION_M).astype(np.int64)] = True
    holes = ~covered[1:-1] & covered[:-2] & covered[2:]
    painted = float(covered.sum() + holes.sum()) * STATION_M
    length = length_m(path[:, :2]) + CELL_M
    return _Chain(rows[np.argsort(along)], path, length, painted)


def _finding(
    chain: _Chain, unpainted: Stations, sensors: Sequence[str], sure: float
) -> Discrepancy:
    middle = chain.points[len(chain.points) // 2]
    element, along, expected = 0, 0.0, "no line"
    if len(unpainted):
        distance, near = unpainted.tree.query(chain.points[:, :2])
        if float(np.median(distance)) < _BORDER_M:
            station = int(np.median(near))
            line = unpainted.lines[int(unpainted.line[station])]
            element, expected = line.marking.element_id, "a border without paint"
            along = max(0.0, (int(near.min()) - line.first) * line.step_m)
            sure *= _BORDER_TRUST
    return Discrepancy(
        finding_id=finding_id(Kind.MISSING_IN_MAP, element, *middle[:2]),
        kind=Kind.MISSING_IN_MAP,
        map_element_id=element,
        along_m=along,
        offset_m=math.nan,
        length_m=chain.length_m,
        sd_m=float(np.median(chain.rows["sd"])),
        observations=int(np.median(chain.rows["looks"])),
        visits=int(chain.rows["passes"].max()),
        confidence=float(np.clip(sure, 0.0, 1.0)),
        expected=expected,
        observed=f"{_look_of(chain)} of {chain.length_m:.0f} m",
        points_map=chain.points,
        points_expected_map=np.zeros((0, 3)),
        looks=best_looks(chain.rows, sensors),
    )


def _look_of(chain: _Chain) -> str:
    """Return colour and type in words."""
    votes, share = float(chain.rows["colour"].sum()), chain.painted_m / chain.length_m
    yellow = float((np.nan_to_num(chain.rows["yellow"]) * chain.rows["colour"]).sum())
    colour = "" if votes <= 0 else ("yellow " if yellow > 0.5 * votes else "white ")
    if share > _SOLID_SHARE:
        return f"a solid {colour}line"
    dashes = share > _DASHED_SHARE and chain.length_m > 2 * LONGEST_DASH_M
    return f"a {'dashed ' if dashes else ''}{colour}line"


def _apart(finding: Discrepancy, other: Discrepancy) -> float:
    """Return how far two findings' points lie apart, in the median of the shorter one."""
    first, second = sorted((finding.points_map, other.points_map), key=len)
    return float(np.median(cKDTree(second[:, :2]).query(first[:, :2])[0]))
