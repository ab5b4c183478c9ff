"""What became of every view that was given: used or not, why, and how well it fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from percept.calib.intrinsics.coverage import tilts_deg
from percept.calib.intrinsics.outliers import Sorted
from percept.calib.intrinsics.result import CameraView
from percept.calib.intrinsics.solver import Solution
from percept.calib.intrinsics.views import UsableViews

if TYPE_CHECKING:
    from percept.calib.boards.detection import BoardView, NoBoard

__all__ = ["Posed", "view_records"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """All usable views under the final camera, their poses fitted to it.

    Attributes:
        solution: Poses and residuals of all usable views.
        sorted_views: Which of them and of their corners are used.
        middles_cam: (V, 3) middles of the corners in the camera's frame, metres.
    """

    solution: Solution
    sorted_views: Sorted
    middles_cam: _F64


def view_records(
    views: Sequence[BoardView],
    rejected: Sequence[NoBoard],
    usable: UsableViews,
    posed: Posed | None,
) -> tuple[CameraView, ...]:
    """Return a record of every view: in the order given, then the images without a board."""
    rows = {int(index): row for row, index in enumerate(usable.indices)}
    records = []
    for index, view in enumerate(views):
        if index in rows and posed is not None:
            records.append(_posed_record(view, usable, posed, rows[index]))
        else:
            unknown = np.full((len(view.ids), 2), np.nan)
            reason = usable.unusable.get(index, "not tried: there are too few views in all")
            records.append(_unused(view.name, reason, view.corners_px, unknown))
    nothing = np.zeros((0, 2))
    records += [_unused(none.name, none.reason, nothing, nothing) for none in rejected]
    return tuple(records)


def _unused(name: str, reason: str, corners_px: _F64, residuals_px: _F64) -> CameraView:
    return CameraView(
        name, used=False, reason=reason, corners_px=corners_px, residuals_px=residuals_px
    )


def _posed_record(view: BoardView, usable: UsableViews, posed: Posed, row: int) -> CameraView:
    counted = usable.counted[row]
    weights = posed.sorted_views.weights[row, : int(counted.sum())]
    found = posed.solution.residuals[row, : len(weights)]
    residuals = np.full((len(view.ids), 2), np.nan)
    residuals[counted] = np.where(weights[:, None] > 0, found, np.nan)
    used = bool(posed.sorted_views.used[row])
    rms = float(np.sqrt((weights * (found**2).sum(axis=1)).sum() / max(weights.sum(), 1)))
    if not used:  # what ruled it out is the error over all of its corners
        rms = float(posed.sorted_views.view_px[row])
    middle = posed.middles_cam[row : row + 1]
    R = posed.solution.estimate.R_camera_board[row]
    T_camera_board = np.eye(4)
    T_camera_board[:3, :3] = R
    T_camera_board[:3, 3] = posed.solution.estimate.t_camera_board[row]
    return CameraView(
        view.name,
        used,
        None if used else _misfit(rms, posed.sorted_views.usual_px),
        view.corners_px,
        residuals,
        rms if np.isfinite(rms) else None,
        float(tilts_deg(R[None], middle)[0]),
        float(np.linalg.norm(middle)),
        T_camera_board,
    )


def _misfit(rms_px: float, usual_px: float) -> str:
    times = rms_px / max(usual_px, 1e-12)
    return (
        f"does not fit the camera of the other views: {rms_px:.2f} px rms, "
        f"{times:.1f} times the usual {usual_px:.2f} px"
    )
