"""Whether the boards stood so that the transform can be known, and which poses to add.

A plane fixes the LiDAR along its normal and about two axes only, so boards that all face one way
leave a shift free that the outlines alone must hold; boards at one distance cannot tell a range
error from a shift; boards in one direction cannot tell a turn from a shift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.limits import CameraLidarLimits

__all__ = ["BoardSpread", "board_spread", "shortcomings"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class BoardSpread:
    """How the boards were spread over directions and distances, seen from the camera.

    Attributes:
        normals_condition: Largest over smallest singular value of the stacked normals; 1 is
            best, above 25 the normals are nearly parallel or in one plane.
        turned_deg: Root mean square turn to the left or right, about the average.
        tilted_deg: The same up or down.
        nearest_m, farthest_m: Distances of the boards' centres.
        across_deg: Width of the range of directions to the boards, left to right.
        upright_deg: The same, up to down.
    """

    normals_condition: float
    turned_deg: float
    tilted_deg: float
    nearest_m: float
    farthest_m: float
    across_deg: float
    upright_deg: float


def board_spread(poses: _F64) -> BoardSpread:
    """Describe plates by their poses.

    Args:
        poses: (P, 4, 4) T_camera_plate of at least one plate, z away from the camera.
    """
    normals, centres = poses[:, :3, 2], poses[:, :3, 3]
    singular = np.linalg.svd(normals, compute_uv=False)
    smallest = singular[2] if len(singular) == 3 else 0.0
    turned, tilted = np.arctan2(normals[:, 0], normals[:, 2]), np.arcsin(-normals[:, 1])
    across = np.degrees(np.arctan2(centres[:, 0], centres[:, 2]))
    upright = np.degrees(np.arctan2(centres[:, 1], centres[:, 2]))
    distance_m = np.linalg.norm(centres, axis=1)
    return BoardSpread(
        normals_condition=float(singular[0] / smallest) if smallest > 1e-9 else float("inf"),
        turned_deg=float(np.degrees(np.std(np.unwrap(turned)))),
        tilted_deg=float(np.degrees(np.std(tilted))),
        nearest_m=float(distance_m.min()),
        farthest_m=float(distance_m.max()),
        across_deg=float(np.ptp(across)),
        upright_deg=float(np.ptp(upright)),
    )


def shortcomings(spread: BoardSpread, limits: CameraLidarLimits) -> list[tuple[str, str]]:
    """Return what the poses lack, and the poses to add, in words; empty where nothing."""
    found: list[tuple[str, str]] = []
    turned = spread.turned_deg >= limits.smallest_tilt_deg
    tilted = spread.tilted_deg >= limits.smallest_tilt_deg
    if not turned and not tilted:
        found.append(
            (
                f"the boards all face one way (normals within {spread.turned_deg:.1f} deg left "
                f"and right and {spread.tilted_deg:.1f} deg up and down)",
                "Add poses with the board turned 20 to 40 deg to the left, to the right, "
                "up and down",
            )
        )
    elif not turned or not tilted:
        axis, missing = ("turned left or right", "to the left and to the right")
        if not tilted:
            axis, missing = ("tilted up or down", "up and down")
        found.append(
            (
                f"the boards are never {axis}",
                f"Add poses with the board turned 20 to 40 deg {missing}",
            )
        )
    elif spread.normals_condition > limits.largest_condition:
        found.append(
            (
                f"the boards' normals lie nearly in one plane (condition "
                f"{spread.normals_condition:.0f})",
                "Add poses with the board tilted in other directions, 20 to 40 deg",
            )
        )
    if spread.farthest_m < limits.smallest_distance_ratio * spread.nearest_m:
        found.append(
            (
                f"the boards are all at one distance ({spread.nearest_m:.1f} to "
                f"{spread.farthest_m:.1f} m)",
                f"Add poses at other distances, such as {spread.farthest_m * 1.6:.1f} m",
            )
        )
    if max(spread.across_deg, spread.upright_deg) < limits.smallest_width_deg:
        found.append(
            (
                f"the boards are all in one direction (within {spread.across_deg:.0f} deg left "
                f"to right)",
                "Add poses near the left, right, upper and lower rim of the image",
            )
        )
    return found
