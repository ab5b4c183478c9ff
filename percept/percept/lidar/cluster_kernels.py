"""Compiled single-linkage clustering on a hash grid, exact to the last pair.

Cells are cubes whose diagonal is the tolerance, so that all points of a cell are one component
and only pairs of cells have to be tested. Cells stand in columns (x, y) with their z sorted: a
neighbourhood is then a few column look-ups and short runs in z instead of 124 cell look-ups.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from percept.lidar.compiled import compiled

__all__ = ["CELL_PER_TOLERANCE", "label_components"]

_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]
_I32 = NDArray[np.int32]
_Columns = tuple[_I32, _I32, _I32, _I32]
_Cells = tuple[_F32, _F64, _I32, _I32]

# A hair under 1/sqrt(3): rounding of a cell index must not let a cell be wider than the tolerance.
CELL_PER_TOLERANCE = (1.0 - 1e-6) / math.sqrt(3.0)


@compiled
def label_components(
    points: _F32,
    tolerance: float,
    growth: float,
    largest_tolerance: float,
    smallest: int,
    largest: int,
) -> _I32:
    """Return (N,) int32 cluster of each point (N, 3), numbered by first point; -1 is none."""
    edge = tolerance * CELL_PER_TOLERANCE
    table, column_x, column_y, column = _find_columns(points, 1.0 / edge)
    order, height = _order_by_column_and_height(points, 1.0 / edge, column, len(column_x))
    cell_of_point, cell_start, cell_z, first_cell = _cut_into_cells(
        order, column, height, len(column_x)
    )
    sorted_points, reach = _gather(points, order, tolerance, growth, largest_tolerance)
    column_reach = _largest_by_column(reach, cell_start, first_cell)
    parent = np.arange(len(cell_z)).astype(np.int32)
    cells = (sorted_points, reach * reach, cell_start, parent)
    for dx, dy, gap in _neighbour_columns(column_reach.max(), edge):
        for c in range(len(column_x)):
            if gap > column_reach[c]:
                continue
            d = _look_up(table, column_x, column_y, column_x[c] + dx, column_y[c] + dy)
            if d >= 0:
                window = _height_window(column_reach[c], gap, edge)
                _join_columns(cells, cell_z, first_cell, c, d, window)
    return _number_by_first_point(parent, cell_of_point, smallest, largest)


@compiled
def _slot(ix: int, iy: int, size: int) -> int:
    """Return where column (ix, iy) is looked for first in a table of 2^k places."""
    mixed = np.uint64(ix) * np.uint64(0x9E3779B97F4A7C15)
    mixed += np.uint64(iy) * np.uint64(0xC2B2AE3D27D4EB4F)
    return int(np.int64((mixed ^ (mixed >> np.uint64(32))) & np.uint64(size - 1)))


@compiled
def _find_columns(points: _F32, inverse: float) -> _Columns:
    """Give each point its column by open addressing; columns are numbered as they appear."""
    n = len(points)
    size = 16
    while size < 2 * n:
        size *= 2
    table = np.full(size, -1, np.int32)
    column = np.empty(n, np.int32)
    column_x = np.empty(n, np.int32)
    column_y = np.empty(n, np.int32)
    count = 0
    for i in range(n):
        ix = math.floor(points[i, 0] * inverse)
        iy = math.floor(points[i, 1] * inverse)
        slot = _slot(ix, iy, size)
        while table[slot] >= 0 and not (
            column_x[table[slot]] == ix and column_y[table[slot]] == iy
        ):
            slot = (slot + 1) & (size - 1)
        if table[slot] < 0:
            table[slot] = count
            column_x[count] = ix
            column_y[count] = iy
            count += 1
        column[i] = table[slot]
    return table, column_x[:count], column_y[:count], column


@compiled
def _look_up(table: _I32, column_x: _I32, column_y: _I32, ix: int, iy: int) -> int:
    """Return the column at (ix, iy), or -1."""
    slot = _slot(ix, iy, len(table))
    while table[slot] >= 0:
        c = table[slot]
        if column_x[c] == ix and column_y[c] == iy:
            return int(c)
        slot = (slot + 1) & (len(table) - 1)
    return -1


@compiled
def _order_by_column_and_height(
    points: _F32, inverse: float, column: _I32, columns: int
) -> tuple[_I32, _I32]:
    """Return the points' order by column, cell in z and index, and each point's cell in z."""
    n = len(points)
    height = np.empty(n, np.int32)
    for i in range(n):
        height[i] = np.int32(math.floor(points[i, 2] * inverse))
    lowest = int(height.min())
    extent = int(height.max()) - lowest + 1
    if extent <= 4 * n + 1024:
        order = _stable_order((height - lowest).astype(np.int32), extent, np.arange(n))
    else:
        order = np.argsort(height, kind="mergesort").astype(np.int32)
    return _stable_order(column, columns, order), height


@compiled
def _stable_order(keys: _I32, count: int, order: NDArray[np.integer]) -> _I32:
    """Counting sort of `order` by keys in 0..count-1; equal keys keep their order."""
    starts = np.zeros(count + 1, np.int32)
    for key in keys:
        starts[key + 1] += 1
    for k in range(count):
        starts[k + 1] += starts[k]
    ordered = np.empty(len(order), np.int32)
    for i in order:
        ordered[starts[keys[i]]] = i
        starts[keys[i]] += 1
    return ordered


@compiled
def _cut_into_cells(order: _I32, column: _I32, height: _I32, columns: int) -> _Columns:
    """Return each point's cell, each cell's first sorted point and z, each column's first cell."""
    n = len(order)
    cell_of_point = np.empty(n, np.int32)
    cell_start = np.empty(n + 1, np.int32)
    cell_z = np.empty(n, np.int32)
    first_cell = np.empty(columns + 1, np.int32)
    cells = 0
    previous = -1
    for k in range(n):
        i = order[k]
        new_column = column[i] != previous
        if new_column:
            first_cell[column[i]] = cells
            previous = column[i]
        if new_column or height[i] != cell_z[cells - 1]:
            cell_start[cells] = k
            cell_z[cells] = height[i]
            cells += 1
        cell_of_point[i] = cells - 1
    cell_start[cells] = n
    first_cell[columns] = cells
    return cell_of_point, cell_start[: cells + 1], cell_z[:cells], first_cell


@compiled
def _gather(
    points: _F32, order: _I32, tolerance: float, growth: float, largest_tolerance: float
) -> tuple[_F32, _F64]:
    """Return the points in sorted order and how far each of them reaches, metres."""
    sorted_points = np.empty((len(order), 3), np.float32)
    reach = np.empty(len(order))
    for k in range(len(order)):
        i = order[k]
        for axis in range(3):
            sorted_points[k, axis] = points[i, axis]
        x = np.float64(points[i, 0])
        y = np.float64(points[i, 1])
        reach[k] = min(tolerance + growth * math.sqrt(x * x + y * y), largest_tolerance)
    return sorted_points, reach


@compiled
def _largest_by_column(reach: _F64, cell_start: _I32, first_cell: _I32) -> _F64:
    """Return the longest reach in each column."""
    largest = np.zeros(len(first_cell) - 1)
    for c in range(len(largest)):
        for k in range(cell_start[first_cell[c]], cell_start[first_cell[c + 1]]):
            largest[c] = max(largest[c], reach[k])
    return largest


@compiled
def _neighbour_columns(reach: float, edge: float) -> list[tuple[int, int, float]]:
    """Return (dx, dy, smallest gap in metres) of one half of the columns within reach.

    Nearest first: once near cells are one component, far pairs between them need no test.
    """
    window = int(reach / edge) + 1
    found = [(0.0, 0, 0)]
    for dx in range(window + 1):
        for dy in range(-window, window + 1):
            if dx > 0 or dy > 0:
                gap = math.hypot(max(dx - 1, 0), max(abs(dy) - 1, 0)) * edge
                if gap * (1.0 - 1e-9) <= reach:
                    found.append((gap * (1.0 - 1e-9), dx, dy))
    found.sort()
    return [(dx, dy, gap) for gap, dx, dy in found]


@compiled
def _height_window(reach: float, gap: float, edge: float) -> int:
    """Return how many cells up or down a point may reach in a column this far away."""
    return int(math.sqrt(max(reach * reach - gap * gap, 0.0)) / edge * (1.0 + 1e-9)) + 1


@compiled
def _join_columns(
    cells: _Cells, cell_z: _I32, first_cell: _I32, c: int, d: int, window: int
) -> None:
    """Test all cells of column c against those of column d that are near enough in z."""
    low = first_cell[d]
    for a in range(first_cell[c], first_cell[c + 1]):
        while low < first_cell[d + 1] and cell_z[low] < cell_z[a] - window:
            low += 1
        b = max(low, a + 1) if c == d else low
        while b < first_cell[d + 1] and cell_z[b] <= cell_z[a] + window:
            _join_cells(cells, a, b)
            b += 1


@compiled
def _join_cells(cells: _Cells, a: int, b: int) -> None:
    """Make two cells one component if a pair of their points is near enough."""
    parent = cells[3]
    root_a = _root(parent, a)
    root_b = _root(parent, b)
    if root_a != root_b and _any_pair_joins(cells, a, b):
        parent[max(root_a, root_b)] = min(root_a, root_b)


@compiled
def _root(parent: _I32, cell: int) -> int:
    while parent[cell] != cell:
        parent[cell] = parent[parent[cell]]
        cell = parent[cell]
    return cell


@compiled
def _any_pair_joins(cells: _Cells, a: int, b: int) -> bool:
    """Return whether a point of cell a and one of cell b lie within the nearer one's reach."""
    points, reach_squared, start, _ = cells
    for i in range(start[a], start[a + 1]):
        x = np.float64(points[i, 0])
        y = np.float64(points[i, 1])
        z = np.float64(points[i, 2])
        for j in range(start[b], start[b + 1]):
            dx = x - points[j, 0]
            dy = y - points[j, 1]
            dz = z - points[j, 2]
            if dx * dx + dy * dy + dz * dz <= min(reach_squared[i], reach_squared[j]):
                return True
    return False


@compiled
def _number_by_first_point(parent: _I32, cell_of_point: _I32, smallest: int, largest: int) -> _I32:
    """Number the components of allowed size in the order of their first points."""
    size = np.zeros(len(parent), np.int64)
    labels = np.empty(len(cell_of_point), np.int32)
    for i in range(len(cell_of_point)):
        labels[i] = _root(parent, cell_of_point[i])
        size[labels[i]] += 1
    number = np.full(len(parent), -1, np.int32)
    count = 0
    for i in range(len(labels)):
        root = labels[i]
        if smallest <= size[root] <= largest and number[root] < 0:
            number[root] = count
            count += 1
        labels[i] = number[root]
    return labels
