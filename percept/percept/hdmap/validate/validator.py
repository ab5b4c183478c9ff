"""Looks of drives taken one by one: placed on the map, matched with its lines, summed up."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError, InputError, UsageError
from percept.core.lane_markings import PaintObservation, Sight
from percept.core.map_findings import Decision
from percept.core.trajectory import Trajectory
from percept.hdmap.elements import Lanelet, MapMarking
from percept.hdmap.on_map import check_near
from percept.hdmap.validate.config import ValidationConfig
from percept.hdmap.validate.localise import Shift, ShiftFilter
from percept.hdmap.validate.look import Placed, Strokes, usable_strokes
from percept.hdmap.validate.match import match_strokes, nearest_only, vote
from percept.hdmap.validate.result import StretchOffset, Validation
from percept.hdmap.validate.stations import cut_lines, usable_markings
from percept.hdmap.validate.stop_lines import StopLineTally
from percept.hdmap.validate.summary import Gathered, summarise
from percept.hdmap.validate.tally import Moment, Tally, look_weights
from percept.hdmap.validate.unmatched import UnmatchedPaint

__all__ = ["LaneValidator", "MarkedMap", "validate_lanes"]

_F64 = NDArray[np.float64]
_I64 = NDArray[np.int64]

_BEYOND_M = 10.0
_STRETCH_M = 10.0
_MAP_REACH_M = 5.0
_CROSSWALK_REACH_M = 3.0
_PAIR_M = 0.5


class MarkedMap(Protocol):
    """A map with markings and lanelets: `percept.hdmap.HdMap` is one."""

    @property
    def markings(self) -> Sequence[MapMarking]:
        """Lines and bars."""

    @property
    def lanelets(self) -> Mapping[int, Lanelet]:
        """Pieces of lanes by id."""


class LaneValidator:
    """Gathers looks of one or more drives, and says where road and map disagree.

    Memory is bounded by the length of lines that the drives come near, not by the looks.

    Args:
        markings: Of the map.
        lanelets: Of the map, by id.
        config: What counts as a difference.
        decisions: What persons said of findings of earlier runs.

    Raises:
        InputError: If the map has nothing painted to compare with.
    """

    def __init__(
        self,
        markings: Sequence[MapMarking],
        lanelets: Mapping[int, Lanelet],
        config: ValidationConfig | None = None,
        decisions: Iterable[Decision] = (),
    ) -> None:
        self._config = config = config or ValidationConfig()
        self._dropped: Counter[str] = Counter()
        usable = usable_markings(markings, self._dropped)
        lines = [marking for marking in usable if marking.kind == "line"]
        self._stations = cut_lines([line for line in lines if line.painted])
        if not len(self._stations):
            raise InputError(
                "the map has no painted lines to compare the road with",
                remedy="Give a map whose line strings have the types line_thin or line_thick",
            )
        gap_ns = round(config.pass_gap_s * 1e9)
        self._gathered = Gathered(
            config=config,
            lanelets=lanelets,
            stations=self._stations,
            unpainted=cut_lines([line for line in lines if not line.painted]),
            tally=Tally(len(self._stations), gap_ns),
            unmatched=UnmatchedPaint(
                self._stations.points[0, :2], self._stations.tangents[0], gap_ns
            ),
            stop_lines=StopLineTally(
                [marking for marking in usable if marking.kind == "stop_line"], lanelets, config
            ),
            decisions=tuple(decisions),
            dropped=self._dropped,
        )
        self._crosswalks = cut_lines([m for m in usable if m.kind == "crosswalk"]).tree
        self._drive: _Drive | None = None

    def begin_drive(self, name: str, poses: Trajectory) -> None:
        """Begin a drive: looks that follow are of it.

        Args:
            name: What people call it.
            poses: `T_map_base`, in the frame of the map.

        Raises:
            InputError: If no pose is finite, or the drive is not on the map.
        """
        path = poses.matrices[:, :2, 3]
        path = path[np.isfinite(path).all(axis=1)]
        if not len(path):
            raise InputError("the poses of the drive are not finite", where=name)
        check_near(float(self._stations.tree.query(path)[0].min()), name)
        self._gathered.drives.append(name)
        self._drive = _Drive(poses, ShiftFilter(self._config.window_m, self._config.pose_sd_m))

    def push(self, look: PaintObservation) -> None:
        """Take one look.

        Raises:
            UsageError: If no drive was begun.
        """
        drive = self._drive
        if drive is None:
            raise UsageError("a look needs a drive", remedy="Call begin_drive before push")
        matrix = self._pose(drive, look.stamp_ns)
        if matrix is None:
            return
        self._gathered.counts["looks"] += 1
        moment = Moment(
            len(self._gathered.drives) - 1,
            self._gathered.sensor(look.sensor),
            look.stamp_ns,
            is_image=not look.lines_only,
        )
        strokes = usable_strokes(look, self._config.line_range_m, self._dropped)
        moved = drive.move(matrix[:3, 3])
        self._localise(strokes, matrix, drive, moved)
        placed = Placed(matrix, drive.filter.shift)
        self._note_offset(placed, drive, moment.drive)
        self._add_strokes(strokes, placed, look, moment)
        if not look.lines_only:
            self._gathered.stop_lines.add(look, placed, self._crosswalks, moment, self._dropped)

    def finish(self) -> Validation:
        """Return what all looks together say."""
        return summarise(self._gathered)

    def _pose(self, drive: _Drive, stamp_ns: int) -> _F64 | None:
        """Return `T_map_base` (4, 4) of a look; count looks that have none."""
        try:
            pose = drive.poses.at(stamp_ns)
        except GeometryError:
            self._dropped["looks with a pose that is not rigid"] += 1
            return None
        if pose is None:
            self._dropped["looks without a pose"] += 1
            return None
        return pose.matrix

    def _localise(self, strokes: Strokes, matrix: _F64, drive: _Drive, moved_m: float) -> None:
        """Let the lines of a look vote for the shift of the poses."""
        before = Placed(matrix, drive.filter.shift)
        points = before.to_map(strokes.points_m)[:, :2]
        direction = strokes.direction_rad + before.yaw_rad
        found = match_strokes(
            points, direction, self._stations, ShiftFilter.reach_m, strokes.step_m
        )
        found = nearest_only(found, len(strokes), slack_m=0.0)
        sense = np.sign(self._stations.tangents[found.station] @ before.heading)
        weight = look_weights(strokes.range_m) / (1.0 + (strokes.sd_m / 0.1) ** 2)
        drive.filter.push(
            moved_m,
            sense * found.offset_m + before.shift.lateral_m,
            weight[found.stroke],
            self._stations.line[found.station],
            found.turn_rad + before.shift.heading_rad,
        )

    def _add_strokes(
        self, strokes: Strokes, placed: Placed, look: PaintObservation, moment: Moment
    ) -> None:
        points = placed.to_map(strokes.points_m)
        direction = strokes.direction_rad + placed.yaw_rad
        found = match_strokes(
            points[:, :2], direction, self._stations, self._config.gate_m, strokes.step_m
        )
        found = nearest_only(found, len(strokes))
        votes = vote(found, strokes.sd_m, strokes.width_m, strokes.yellow, strokes.step_m)
        if look.lines_only:
            votes = replace(votes, pair=np.full_like(votes.pair, np.nan))
        near, sights, range_m = self._sights(placed, look)
        self._gathered.tally.add(near, sights, range_m, votes, moment)
        reach_m = self._config.gate_m + _PAIR_M if look.lines_only else 0.0
        self._add_unmatched(strokes, points, direction, found.stroke[votes.used], moment, reach_m)

    def _sights(
        self, placed: Placed, look: PaintObservation
    ) -> tuple[_I64, NDArray[np.uint8], _F64]:
        """Return the stations near the vehicle, how they are seen, and how far they are."""
        reach = self._config.line_range_m
        found = self._stations.tree.query_ball_point(placed.position, reach + _BEYOND_M)
        near = np.sort(np.array(found, dtype=np.int64))
        base = placed.to_base(self._stations.points[near, :2])
        range_m = np.linalg.norm(base, axis=1)
        sights = look.coverage.at(base)
        sights[(sights == Sight.SEEN) & (range_m > reach)] = Sight.TOO_FAR
        return near, sights, range_m

    def _add_unmatched(
        self,
        strokes: Strokes,
        points: _F64,
        direction: _F64,
        used: _I64,
        moment: Moment,
        reach_m: float,
    ) -> None:
        """Gather strokes that are near the map and beside none of its lines.

        Nearer to a line than a reach they may be the second line of a pair that is a little off.
        """
        left = np.ones(len(strokes), dtype=bool)
        left[used] = False
        if not left.any():
            return
        rows = np.flatnonzero(left)
        apart = self._stations.tree.query(points[rows, :2])[0]
        beyond = apart > _MAP_REACH_M
        crossing = np.zeros(len(rows), dtype=bool)
        if self._crosswalks.n:
            crossing = self._crosswalks.query(points[rows, :2])[0] < _CROSSWALK_REACH_M
        self._dropped["strokes beyond the lines of the map"] += int(beyond.sum())
        self._dropped["strokes on crosswalks"] += int((crossing & ~beyond).sum())
        beside = ~beyond & ~crossing & (apart < reach_m)
        self._dropped["strokes that may be of a pair on the map"] += int(beside.sum())
        rows = rows[~beyond & ~crossing & ~beside]
        if len(rows):
            self._gathered.unmatched.add(
                points[rows],
                direction[rows],
                strokes.yellow[rows],
                strokes.sd_m[rows],
                strokes.range_m[rows],
                moment,
            )

    def _note_offset(self, placed: Placed, drive: _Drive, number: int) -> None:
        if drive.along_m < drive.next_note_m:
            return
        drive.next_note_m = drive.along_m + _STRETCH_M
        shift: Shift = placed.shift
        self._gathered.offsets.append(
            StretchOffset(
                drive=number,
                along_m=drive.along_m,
                x_m=float(placed.position[0]),
                y_m=float(placed.position[1]),
                yaw_rad=placed.yaw_rad,
                lateral_m=shift.lateral_m,
                heading_rad=shift.heading_rad,
                sd_m=shift.sd_m,
                lines=shift.lines,
                ambiguous=shift.ambiguous,
            )
        )


class _Drive:
    """The drive that looks come from: its poses, its shift, and the way behind."""

    def __init__(self, poses: Trajectory, shifts: ShiftFilter) -> None:
        self.poses = poses
        self.filter = shifts
        self.along_m = 0.0
        self.next_note_m = 0.0
        self._last: _F64 | None = None

    def move(self, position: _F64) -> float:
        """Go on to a position (3,) and return the way."""
        moved = 0.0 if self._last is None else float(np.linalg.norm(position - self._last))
        self._last = position
        self.along_m += moved
        return moved


def validate_lanes(
    hd_map: MarkedMap,
    drives: Iterable[tuple[str, Trajectory, Iterable[PaintObservation]]],
    config: ValidationConfig | None = None,
    decisions: Iterable[Decision] = (),
) -> Validation:
    """Compare the paint of drives with a map.

    Args:
        hd_map: The map.
        drives: Of each its name, its poses `T_map_base`, and its looks.
        config: What counts as a difference.
        decisions: What persons said of findings of earlier runs.

    Raises:
        InputError: If the map has no painted lines, or a drive is not on the map.
    """
    validator = LaneValidator(hd_map.markings, hd_map.lanelets, config, decisions)
    for name, poses, looks in drives:
        validator.begin_drive(name, poses)
        for look in looks:
            validator.push(look)
    return validator.finish()
