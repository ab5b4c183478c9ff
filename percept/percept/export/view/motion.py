"""How a view that stands still shows a vehicle that moves: every drawing where it was made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform, quat_xyzw_from_matrix
from percept.export.view.layout import VEHICLE, VEHICLE_PATH
from percept.export.view.stream import ViewStream

__all__ = ["Motion"]

_PATH_POINTS = 20_000
_POSES_DRAWN = 50_000
_VEHICLE_SIZE_M = (4.4, 1.9, 1.6)
_VEHICLE_RGB = (228, 232, 236)
_PATH_RGB = (120, 130, 140)


class Motion:
    """Places what is drawn in the frame that poses are given in.

    A drawing hangs below its frame, which is placed in the vehicle. With poses it gets the
    vehicle's motion at its own stamp between the two: sensors that measure at different times
    then lie on each other, which a vehicle that moves as a whole would smear.

    Args:
        stream: The view.
    """

    def __init__(self, stream: ViewStream) -> None:
        self._stream = stream
        self._poses: Trajectory | None = None
        self._drawn: dict[tuple[str, str], list[int]] = {}
        self._unplaced: set[str] = set()

    def place(self, entity: str, frame_id: str, stamp_ns: int) -> None:
        """Remember that something is drawn now, and place it once the poses are known.

        Args:
            entity: What holds the drawing.
            frame_id: The frame that it hangs below.
            stamp_ns: Its time.
        """
        if self._poses is None:
            self._drawn.setdefault((entity, frame_id), []).append(stamp_ns)
        else:
            self._send(entity, frame_id, [stamp_ns])

    def add(self, poses: Trajectory) -> None:
        """Take the poses, draw the path, and place all that was drawn before.

        Raises:
            GeometryError: If there are poses already, or theirs is no frame of the vehicle.
        """
        if self._poses is not None:
            raise GeometryError("a view has one trajectory")
        self._poses = _of_root(poses, self._stream.root_of(poses.source))
        self._stream.add_root(poses.target)
        self._draw_vehicle(self._poses)
        for (entity, frame_id), stamps_ns in self._drawn.items():
            self._send(entity, frame_id, stamps_ns)
        self._drawn.clear()

    def _draw_vehicle(self, poses: Trajectory) -> None:
        """Draw the path, and the vehicle that moves along it."""
        step = max(1, -(-len(poses) // _PATH_POINTS))
        places = np.split(
            poses.matrices[:, :3, 3], np.searchsorted(poses.stamps_ns, poses.gaps_ns[:, 1])
        )
        path = rr.LineStrips3D(
            [part[::step] for part in places], colors=_PATH_RGB, radii=rr.Radius.ui_points(1.5)
        )
        self._stream.log(VEHICLE_PATH, path, static=True)
        body = rr.Boxes3D(
            half_sizes=[[side / 2 for side in _VEHICLE_SIZE_M]],
            centers=[[1.4, 0, _VEHICLE_SIZE_M[2] / 2]],
            colors=[_VEHICLE_RGB],
            labels=["vehicle"],
            show_labels=False,
        )
        self._stream.log(VEHICLE, body, static=True)
        step = max(1, -(-len(poses) // _POSES_DRAWN))
        self._columns(VEHICLE, poses.stamps_ns[::step], poses.matrices[::step])

    def _send(self, entity: str, frame_id: str, stamps_ns: list[int]) -> None:
        if self._poses is None:
            return
        T_root_frame = self._stream.frame_in_root(frame_id)
        stamps = np.array(stamps_ns, dtype=np.int64)
        matrices, known = self._poses.poses_at(stamps)
        if not known.all() and entity not in self._unplaced:
            self._unplaced.add(entity)
            text = f"{entity} has no pose at times, and then stays where it was last"
            self._stream.note(text, level="WARN")
        moved = np.linalg.inv(T_root_frame) @ matrices[known] @ T_root_frame
        self._columns(entity, stamps[known], moved)

    def _columns(
        self, entity: str, stamps_ns: NDArray[np.int64], matrices: NDArray[np.float64]
    ) -> None:
        if not len(stamps_ns):
            return
        quats = [quat_xyzw_from_matrix(matrix[:3, :3]) for matrix in matrices]
        self._stream.send(
            entity,
            stamps_ns,
            rr.Transform3D.columns(translation=matrices[:, :3, 3], quaternion=np.array(quats)),
        )


def _of_root(poses: Trajectory, T_root_source: Transform) -> Trajectory:
    """Return the motion of the root frame, which the source frame is fixed to."""
    matrices = poses.matrices @ np.linalg.inv(T_root_source.matrix)
    return replace(poses, source=T_root_source.target, matrices=matrices)
