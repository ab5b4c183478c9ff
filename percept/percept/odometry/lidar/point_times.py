"""When the points of a scan were measured, as far as odometry can use it.

The pose of a scan is that of its END: the last point stays where it is, and all others are moved
to where they would have been seen then. KISS-ICP 1.3.0 does so, which a test holds it to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_S
from percept.core.samples import PointCloud

__all__ = ["ScanTimes", "scan_times"]

_LONGEST_SCAN_NS = NS_PER_S


@dataclass(frozen=True, slots=True, eq=False)
class ScanTimes:
    """The time of a scan and of its points.

    Attributes:
        end_ns: Time of the last point; the header stamp where points have no times.
        duration_s: From the first point to the last.
        offsets_s: (N,) float64 seconds of each point from the first one on, or None where the
            scan has no times that could be used.
        note: Why not, or an empty text.
    """

    end_ns: int
    duration_s: float
    offsets_s: NDArray[np.float64] | None
    note: str = ""


def scan_times(cloud: PointCloud) -> ScanTimes:
    """Return the times of a scan; those that no spinning sensor can have are not used, and named.

    Args:
        cloud: The scan; `offset_ns` may be relative to any moment of it.
    """
    offsets = cloud.offset_ns
    if offsets is None:
        return ScanTimes(cloud.stamp_ns, 0.0, None, "points have no times: no deskewing")
    if not len(offsets):
        return ScanTimes(cloud.stamp_ns, 0.0, None, "no points")
    first, last = int(offsets.min()), int(offsets.max())
    if first == last:
        note = "all points have one time: no deskewing"
        return ScanTimes(cloud.stamp_ns + last, 0.0, None, note)
    if last - first > _LONGEST_SCAN_NS or max(abs(first), abs(last)) > 10 * _LONGEST_SCAN_NS:
        note = "times of points span more than a second: not used"
        return ScanTimes(cloud.stamp_ns, 0.0, None, note)
    seconds = (offsets - first).astype(np.float64) / NS_PER_S
    return ScanTimes(cloud.stamp_ns + last, (last - first) / NS_PER_S, seconds)
