"""The parts of KISS-ICP 1.3.0, and nothing else: the only file that knows the package."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.odometry.lidar.config import LidarOdometryConfig
from percept.odometry.lidar.point_times import ScanTimes

__all__ = ["KissParts"]

_F = NDArray[np.float64]
# Where the search for the pose ends; the surfaces of the map give what is below.
_CONVERGED = 1e-3


class KissParts:
    """What `KissICP.register_frame` puts together, one by one.

    Args:
        config: Settings.
    """

    def __init__(self, config: LidarOdometryConfig) -> None:
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP

        settings = KISSConfig()
        settings.data.max_range = config.max_range_m
        settings.data.min_range = config.min_range_m
        settings.data.deskew = config.deskew
        settings.mapping.voxel_size = config.cell_m
        settings.registration.convergence_criterion = _CONVERGED
        # Sums over several threads come in any order, and a run would not repeat itself.
        settings.registration.max_num_threads = 1
        self._initial_m = settings.adaptive_threshold.initial_threshold
        self._kiss: Any = KissICP(settings)

    def thin_out(self, points: _F, times: ScanTimes, motion: _F) -> tuple[_F, _F]:
        """Return the points for the map and those to register, moved to the end of the scan.

        Args:
            points: (N, 3) float64 in the base frame.
            times: When they were measured.
            motion: (4, 4) what the base frame did from the first point to the last.
        """
        source, dense = self._kiss.voxelize(self.deskewed(points, times, motion))
        return dense, source

    def deskewed(self, points: _F, times: ScanTimes, motion: _F) -> _F:
        """Return the points in range, each where it would have been seen with the last one."""
        # It brings times to 0..1 by itself, and ends the process where all are the same.
        stamps = np.zeros(0) if times.offsets_s is None else times.offsets_s
        moved: _F = self._kiss.preprocessor.preprocess(points, stamps, motion)
        return moved

    def reaches_m(self) -> tuple[float, ...]:
        """Return how far off a prediction may be: as it was so far, and as at the beginning."""
        usual = float(self._kiss.adaptive_threshold.get_threshold())
        return (usual, self._initial_m) if usual < self._initial_m else (usual,)

    def align(self, source: _F, expected: _F, reach_m: float) -> _F:
        """Return the pose (4, 4) at which points fit the map."""
        pose: _F = self._kiss.registration.align_points_to_map(
            points=source,
            voxel_map=self._kiss.local_map,
            initial_guess=expected,
            max_correspondance_distance=3 * reach_m,
            kernel=reach_m,
        )
        return pose

    def learn(self, deviation: _F) -> None:
        """Take note of how far a prediction was off."""
        self._kiss.adaptive_threshold.update_model_deviation(deviation)

    def add(self, dense: _F, pose: _F) -> None:
        """Put points of a scan into the map; what is out of range of the pose leaves it."""
        self._kiss.local_map.update(dense, pose)

    def map_points(self) -> _F:
        """Return the points (M, 3) of the map."""
        points: _F = self._kiss.local_map.point_cloud()
        return points

    def clear(self) -> None:
        """Forget the map."""
        self._kiss.local_map.clear()
