"""When a vehicle and the boards around it stand still, found from the scans themselves.

Every scan becomes a coarse range image. A vehicle that moves changes it in all directions; a
passer-by or a board that is carried changes it in a few. While the vehicle stands, what is
nearer than the background (the far end of what each cell shows over half a minute) and does
not change for a moment is a thing that is held still: a board on its stand. A passer-by is
never still for long enough, and so splits nothing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_MS, NS_PER_S
from percept.core.samples import PointCloud

__all__ = ["Frame", "FrameMaker", "StillSpan", "still_spans"]

_AZIMUTH_CELLS, _LOWEST_DEG, _ELEVATION_CELLS = 360, -50, 100
_CELLS = _AZIMUTH_CELLS * _ELEVATION_CELLS
_UNIT_M = 0.004
_NONE = np.uint16(65535)
_FEWEST_IN_SECTOR = 20
_SECTOR_DEG = 30
_LARGEST_SIGMA_M, _SMALLEST_SIGMA_M = 0.03, 0.004
_SIGMAS = 4.0
_CHANGED_SHARE, _QUIET_FACTOR = (0.05, 0.12), 2.5
_RESTLESS_LIDAR = 0.40
_CREEP_M = 0.002
_FRONT_M, _FRONT_SHARE, _FAR_QUANTILE = 0.10, 0.02, 0.9
_FARTHEST_M = 20.0
_FEWEST_HELD_CELLS = 12
_PATCH_CELLS, _FEWEST_IN_PATCH = 5, 5
_SCANS_KEPT = 4
_SAME_SHARE = 0.88
_RESTLESS_SHARE, _LOOSE_SHARE = 0.05, 0.2
_LARGEST_DRIFT_M, _PARTS = 0.01, 4
_HOLD_S, _EMPTY_NS = 0.28, 500 * NS_PER_MS
_LONGEST_BLOCK = 300


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What all LiDARs show at one scan of the first one.

    Attributes:
        stamp_ns: Stamp of that scan.
        log_time_ns: Its log time.
        ranges: (cells of all LiDARs,) uint16 median range by cell in units of 4 mm; 65535
            for a cell without a return.
    """

    stamp_ns: int
    log_time_ns: int
    ranges: NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class StillSpan:
    """A span in which everything that matters stands still.

    Attributes:
        first_ns: Stamp of the first scan of the span.
        last_ns: Stamp of the last one.
        place: The same number while the vehicle stands at the same place.
        held_cells: How many cells show something that is held before the background; 0 where
            nothing is.
    """

    first_ns: int
    last_ns: int
    place: int
    held_cells: int


@dataclass(slots=True)
class FrameMaker:
    """Puts range images of all LiDARs together: at each scan of the first, the nearest in time.

    Attributes:
        topics: Of the LiDARs; the first one sets the pace.
        points: How many points all scans had so far.
    """

    topics: Sequence[str]
    points: int = 0
    _recent: dict[str, deque[_Scan]] = field(default_factory=dict)
    _waiting: deque[_Scan] = field(default_factory=deque)
    _period_ns: int = 200 * NS_PER_MS

    def add(self, cloud: PointCloud) -> Frame | None:
        """Take the next scan in the order of the log; returns the frame before it."""
        self.points += len(cloud)
        scan = _Scan(cloud.stamp_ns, cloud.log_time_ns, _range_image(cloud.points_xyz))
        self._recent.setdefault(cloud.topic, deque(maxlen=_SCANS_KEPT)).append(scan)
        if cloud.topic != self.topics[0]:
            return None
        if self._waiting and cloud.stamp_ns > self._waiting[-1].stamp_ns:
            self._period_ns = cloud.stamp_ns - self._waiting[-1].stamp_ns
        self._waiting.append(scan)
        return self._frame() if len(self._waiting) > 1 else None

    def rest(self) -> Frame | None:
        """Return the last frame, which no scan comes after."""
        return self._frame() if self._waiting else None

    def _frame(self) -> Frame:
        """Return the frame of the scan that has waited for those of the other LiDARs."""
        first = self._waiting.popleft()
        parts = [first.ranges, *(self._part(topic, first.stamp_ns) for topic in self.topics[1:])]
        return Frame(first.stamp_ns, first.log_time_ns, np.concatenate(parts))

    def _part(self, topic: str, stamp_ns: int) -> NDArray[np.uint16]:
        scans = self._recent.get(topic, ())
        near = min(scans, key=lambda scan: abs(scan.stamp_ns - stamp_ns), default=None)
        if near is None or abs(near.stamp_ns - stamp_ns) > 0.75 * self._period_ns:
            return np.full(_CELLS, _NONE)
        return near.ranges


class _Scan(NamedTuple):
    stamp_ns: int
    log_time_ns: int
    ranges: NDArray[np.uint16]


class _Run(NamedTuple):
    first: int
    last: int
    cells: int


def still_spans(
    frames: Iterator[Frame], stands_by_odometry: Callable[[int], bool] | None = None
) -> Iterator[StillSpan]:
    """Yield the still spans of a sequence of frames, in their order.

    Memory is bounded: half a minute of frames is looked at together, at most.

    Args:
        frames: In the order of time.
        stands_by_odometry: Tells for a stamp whether the vehicle stands by its odometry; None
            where there is none. With it, the scans may change more (moving leaves, a LiDAR that
            never repeats its pattern) before the vehicle is taken to move.
    """
    place, anchor = -1, None
    for block in _blocks(frames, stands_by_odometry):
        runs = list(_runs_of_block(block))
        middle = block[len(block) // 2]
        if runs and (anchor is None or not _same_place(anchor, middle)):
            place, anchor = place + 1, middle
        for run in runs:
            first_ns, last_ns = block[run.first].stamp_ns, block[run.last].stamp_ns
            if run.cells or last_ns - first_ns >= _EMPTY_NS:
                yield StillSpan(first_ns, last_ns, place, run.cells)


def _blocks(
    frames: Iterator[Frame], stands_by_odometry: Callable[[int], bool] | None
) -> Iterator[list[Frame]]:
    """Yield frames in a row between which the vehicle does not move."""
    block: list[Frame] = []
    quietest = _CHANGED_SHARE[1]
    for frame in frames:
        if block:
            changed = _moved_share(block[-1].ranges, frame.ranges)
            quietest = min(quietest, changed)
            limit = float(np.clip(_QUIET_FACTOR * quietest, *_CHANGED_SHARE))
            if stands_by_odometry is not None:
                stands = stands_by_odometry(frame.stamp_ns) and changed <= _RESTLESS_LIDAR
            else:
                since_first = _moved_share(block[0].ranges, frame.ranges)
                stands = max(changed, since_first) <= limit and not _crept(block[0], frame)
            if not stands or len(block) >= _LONGEST_BLOCK:
                yield block
                block = []
        block.append(frame)
    if block:
        yield block


def _same_place(a: Frame, b: Frame) -> bool:
    return _moved_share(a.ranges, b.ranges) <= _CHANGED_SHARE[1] and not _crept(a, b)


def _range_image(points: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return the median range by cell of one degree (cells,) uint16; azimuth runs first."""
    x, y, z = points.T
    flat = np.hypot(x, y)
    ranges = np.hypot(flat, z)
    azimuth = np.floor(np.degrees(np.arctan2(y, x))).astype(np.int64) % _AZIMUTH_CELLS
    elevation = np.floor(np.degrees(np.arctan2(z, flat))).astype(np.int64) - _LOWEST_DEG
    inside = (elevation >= 0) & (elevation < _ELEVATION_CELLS)
    inside &= (ranges > 0.3) & (ranges < 250.0)
    units = (ranges[inside] / _UNIT_M).astype(np.int64)
    # One sort by cell and range together: the middle of each run is the median of its cell.
    keys = np.sort(((azimuth * _ELEVATION_CELLS + elevation)[inside] << 16) | units)
    image = np.full(_CELLS, _NONE)
    if len(keys):
        starts = np.flatnonzero(np.append(True, np.diff(keys >> 16) > 0))
        ends = np.append(starts[1:], len(keys)) - 1
        image[keys[starts] >> 16] = (keys[(starts + ends) // 2] & 0xFFFF).astype(np.uint16)
    return image


def _moved_share(a: NDArray[np.uint16], b: NDArray[np.uint16]) -> float:
    """Return the share of cells that changed in the middle one of all directions.

    A vehicle that moves changes what it sees all around. The median over sectors of azimuth
    does not see what moves in less than half of them.
    """
    cells, off = _differences(a, b)
    if not len(cells):
        return 1.0  # nothing says that it stands
    return float(np.median(_by_sector(cells, np.abs(off) > _tolerance_m(off))))


def _crept(a: Frame, b: Frame) -> bool:
    """Return whether most directions came nearer or went away by more than noise explains.

    The mean over a sector sees a motion that each cell hides in its noise.
    """
    cells, off = _differences(a.ranges, b.ranges)
    if not len(cells):
        return False
    tolerance = _tolerance_m(off)
    means = _by_sector(cells, np.clip(off, -tolerance, tolerance))
    doubt = tolerance / _SIGMAS / float(np.sqrt(len(cells) / len(means)))
    return float(np.median(np.abs(means))) > _CREEP_M + 2 * doubt


def _differences(
    a: NDArray[np.uint16], b: NDArray[np.uint16]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the cells (N,) that both range images show, and how much nearer the first is, m."""
    both = np.flatnonzero((a != _NONE) & (b != _NONE))
    return both, (b[both].astype(np.float64) - a[both].astype(np.float64)) * _UNIT_M


def _by_sector(cells: NDArray[np.intp], values: NDArray[np.generic]) -> NDArray[np.float64]:
    """Return the mean of values (N,) in each sector that has enough cells, of each LiDAR."""
    sector = cells // _ELEVATION_CELLS // _SECTOR_DEG
    counts, sums = np.bincount(sector), np.bincount(sector, weights=values.astype(np.float64))
    enough = counts >= min(_FEWEST_IN_SECTOR, counts.max())
    means: NDArray[np.float64] = sums[enough] / counts[enough]
    return means


def _tolerance_m(difference: NDArray[np.floating]) -> float:
    """Return how much a cell that is still may differ, from the noise of most cells."""
    sigma = 1.4826 * float(np.median(np.abs(difference))) if len(difference) else 0.0
    return _SIGMAS * float(np.clip(sigma, _SMALLEST_SIGMA_M, _LARGEST_SIGMA_M))


def _runs_of_block(block: Sequence[Frame]) -> Iterator[_Run]:
    """Yield the runs of frames that show one thing held, or nothing."""
    if len(block) < 2:
        return
    period_s = float(np.median(np.diff([f.stamp_ns for f in block]))) / NS_PER_S
    window = max(int(np.ceil(_HOLD_S / max(period_s, 1e-3))), 1) + 1
    if len(block) < window:
        return
    stack = np.stack([frame.ranges for frame in block])
    used = (stack != _NONE).any(axis=0)
    ranges = stack[:, used].astype(np.float32) * _UNIT_M
    ranges[stack[:, used] == _NONE] = np.nan
    yield from _runs(ranges, used, window)


def _runs(ranges: NDArray[np.float32], used: NDArray[np.bool_], window: int) -> Iterator[_Run]:
    """Yield the runs of frames that show one thing held, or nothing, in the order of time.

    Args:
        ranges: (F, used cells) metres; NaN without a return.
        used: (cells,) which cells these are.
        window: Frames over which a thing must not change to be held.
    """
    front = _front(ranges)
    steps = np.abs(np.diff(ranges, axis=0))
    tolerance = _tolerance_m(steps[np.isfinite(steps)])
    held = np.stack(
        [
            _patches(
                front[k : k + window].all(axis=0)
                & (steps[k : k + window - 1] <= tolerance).all(axis=0)
                & (np.abs(ranges[k] - ranges[k + window - 1]) <= tolerance),
                used,
            )
            for k in range(len(ranges) - window + 1)
        ]
    )
    runs = _apart(list(_held_runs(ranges, held, window, tolerance / _SIGMAS)))
    still = np.stack([held[min(k, len(held) - 1)] for k in range(len(front))])
    loose = np.array([_patches(f & ~s, used).sum() for f, s in zip(front, still, strict=True)])
    # What is not held may be a passer-by, but not the board on its way to the next place.
    shown = [run.cells for run in runs] or [10 * _RESTLESS_SHARE * front.shape[1]]
    quiet = loose <= max(_LOOSE_SHARE * float(np.median(shown)), min(shown) / 2)
    for run in runs:
        quiet[run.first : run.last + 1] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[False], quiet, [False]])))
    empty = [_Run(int(a), int(b) - 1, 0) for a, b in edges.reshape(-1, 2)]
    yield from sorted([*runs, *empty])


def _held_runs(
    ranges: NDArray[np.float32], held: NDArray[np.bool_], window: int, sigma_m: float
) -> Iterator[_Run]:
    """Yield the runs of frames in which one thing is held, which may overlap."""
    for a, b in _chains(held):
        # At the ends of a chain the thing may just be put down or taken up.
        for start, end in ((a, b), (a, b - 1), (a + 1, b), (a + 1, b - 1)):
            first, last = start, end + window - 1
            cells = held[start : end + 1].all(axis=0)
            if end < start or cells.sum() < _FEWEST_HELD_CELLS:
                continue
            if not _drifts(ranges[first : last + 1, cells], sigma_m):
                yield _Run(first, last, int(cells.sum()))
                break


def _drifts(ranges: NDArray[np.float32], sigma_m: float) -> bool:
    """Return whether a part of a thing (F, cells) comes nearer or goes away while it is held.

    The median over many cells sees a motion that each cell hides in its noise.
    """
    off = ranges - np.nanmedian(ranges, axis=0)
    parts = np.array_split(off, _PARTS, axis=1)
    largest = max(float(np.abs(np.nanmedian(part, axis=1)).max()) for part in parts)
    doubt = sigma_m / float(np.sqrt(off.shape[1] / _PARTS))
    return largest > _LARGEST_DRIFT_M + 3 * doubt


def _apart(runs: Sequence[_Run]) -> list[_Run]:
    """Return the runs that show most, of those that share frames."""
    kept: list[_Run] = []
    for run in sorted(runs, key=lambda run: -run.cells):
        if all(run.last < other.first or run.first > other.last for other in kept):
            kept.append(run)
    return kept


def _patches(cells: NDArray[np.bool_], used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells of a mask (used cells,) that have others of it around them.

    A thing covers cells beside each other; noise on a far road does not.
    """
    import cv2

    grid = np.zeros(len(used), np.float32)
    grid[used] = cells
    image = grid.reshape(-1, _ELEVATION_CELLS)
    around = cv2.boxFilter(image, -1, (_PATCH_CELLS, _PATCH_CELLS), normalize=False)
    patches: NDArray[np.bool_] = cells & (around.reshape(-1)[used] > _FEWEST_IN_PATCH - 0.5)
    return patches


def _front(ranges: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return (F, cells) what is before the background and near enough to be a board.

    The background of a cell is the far end of what it shows. A cell without a return most of the
    time is the sky; one that loses a return now and then is not.
    """
    filled = np.sort(ranges, axis=0)  # NaN come last
    seen = np.isfinite(filled).sum(axis=0)
    far_end = filled[np.maximum((_FAR_QUANTILE * seen).astype(int) - 1, 0), np.arange(len(seen))]
    background = np.where(seen > 0.5 * len(ranges), far_end, np.inf)
    gap = np.maximum(_FRONT_M, _FRONT_SHARE * ranges)
    front: NDArray[np.bool_] = (ranges < background - gap) & (ranges < _FARTHEST_M)
    return front


def _chains(held: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield first and last window of chains of windows in which the same cells are held."""
    start = 0
    for k in range(1, len(held) + 1):
        if k == len(held) or not _same(held[start], held[k]):
            yield start, k - 1
            start = k


def _same(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> bool:
    """Return whether two windows show the same thing held."""
    return int((a & b).sum()) >= _SAME_SHARE * max(int(a.sum()), int(b.sum()))
