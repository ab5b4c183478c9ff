"""The course of a calibration: the vehicle goes from place to place, boards are shown at each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_MS
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.datasets.synthetic.calibration.board import board_object
from percept.datasets.synthetic.ego import Motion
from percept.datasets.synthetic.layout import Placed
from percept.datasets.synthetic.world import World

__all__ = [
    "MOVE_S",
    "POSE_S",
    "BoardHold",
    "CalibrationStreet",
    "Course",
    "StopAndGo",
    "draw_course",
]

POSE_S, MOVE_S = 1.0, 0.4
"""Time for one pose of the board, and the part of it in which the board comes from the last."""

_WAIT_S, _DRIVE_S = 1.0, 3.0
_FIRST_X_M, _SPACING_M = 20.0, (8.0, 12.0)
_SWAY_M, _SWAY_LENGTH_M = 0.8, 40.0


@dataclass(frozen=True, slots=True)
class Course:
    """When the vehicle stands where.

    Attributes:
        x_m: Places along the street.
        arrive_s: When the vehicle comes to each.
        leave_s: When it goes on.
    """

    x_m: tuple[float, ...]
    arrive_s: tuple[float, ...]
    leave_s: tuple[float, ...]

    @property
    def duration_s(self) -> float:
        """Length of the whole."""
        return self.leave_s[-1]

    def shows_s(self, place: int, count: int) -> list[float]:
        """Return when each of so many poses of the board begins at a place."""
        return [self.arrive_s[place] + _WAIT_S + k * POSE_S for k in range(count)]


def draw_course(poses_at: tuple[int, ...], rng: np.random.Generator) -> Course:
    """Draw places 8 to 12 m apart; so many poses are shown at each."""
    spacings = rng.uniform(*_SPACING_M, len(poses_at))
    x = np.cumsum(spacings) + _FIRST_X_M + rng.uniform(0, 40)
    lengths = _WAIT_S + POSE_S * np.array(poses_at)
    arrive = np.concatenate([[0.0], np.cumsum(lengths + _DRIVE_S)[:-1]])
    return Course(tuple(x.tolist()), tuple(arrive.tolist()), tuple((arrive + lengths).tolist()))


@dataclass(frozen=True, slots=True, eq=False)
class StopAndGo(Motion):
    """A vehicle that stands at the places of a course and goes smoothly between them.

    Attributes:
        course: When it stands where.
    """

    course: Course

    def _plane(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return x, y and heading; it points where it goes, along the middle of the street."""
        course = self.course
        times = np.column_stack([course.arrive_s, course.leave_s]).ravel()
        index = np.interp(time_s, times, np.arange(len(times)))
        leg = np.floor(index)
        share = np.where(leg % 2 == 1, index - leg, 0.0)
        smooth = share * share * (3 - 2 * share)
        x = np.interp((leg // 2) + smooth, np.arange(len(course.x_m)), course.x_m)
        turn = 2 * np.pi / _SWAY_LENGTH_M
        return x, _SWAY_M * np.sin(turn * x), np.arctan(_SWAY_M * turn * np.cos(turn * x))


@dataclass(frozen=True, slots=True, eq=False)
class BoardHold:
    """One pose of the board.

    Attributes:
        camera: Which one it is shown to.
        place: Number of the vehicle's place.
        start_s: From when on it is held still, since the start.
        end_s: Until when.
        T_map_board: Where; the board's frame is that of `Checkerboard.corners_board`.
    """

    camera: str
    place: int
    start_s: float
    end_s: float
    T_map_board: Transform


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationStreet(World):
    """The street without traffic: people walk on the sidewalks, and a board is shown.

    Attributes:
        holds: The poses of the board, in the order of time.
    """

    holds: tuple[BoardHold, ...] = ()

    def objects(self, time_s: float, x_m: float, reach_m: float) -> tuple[Placed, ...]:
        """Return objects and scenery within a distance along the street, the board among them."""
        placed = World.objects(self, time_s, x_m, reach_m)
        quiet = tuple(o for o in placed if not o.vx_mps or o.shape.label == "pedestrian")
        T_map_board = self.board(time_s)
        if T_map_board is None:
            return quiet
        return (*quiet, board_object(T_map_board, self.profile))

    def board(self, time_s: float) -> Transform | None:
        """Return `T_map_board` at a time, or None where no board is shown.

        Between two poses for one camera at one place it is carried straight from one to the other.
        """
        for n, hold in enumerate(self.holds):
            if hold.start_s <= time_s <= hold.end_s:
                return hold.T_map_board
            before = self.holds[n - 1] if n else hold
            if before.end_s < time_s < hold.start_s and _carried(before, hold):
                return _between(before, hold, time_s)
        return None


def _carried(before: BoardHold, after: BoardHold) -> bool:
    return (before.camera, before.place) == (after.camera, after.place)


def _between(before: BoardHold, after: BoardHold, time_s: float) -> Transform | None:
    stamps = [round(1e3 * s) * NS_PER_MS for s in (before.end_s, after.start_s)]
    matrices = np.stack([before.T_map_board.matrix, after.T_map_board.matrix])
    way = Trajectory("map", "board", np.array(stamps, dtype=np.int64), matrices)
    return way.at(round(1e9 * time_s))
