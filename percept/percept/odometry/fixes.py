"""GNSS fixes as points of a local frame, with a covariance each."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError, InsufficientDataError
from percept.core.geodesy import LocalFrame
from percept.odometry.filter_config import FilterConfig
from percept.odometry.readings import Readings

__all__ = ["Fixes", "local_fixes"]

_FEWEST = 5
_UPWARDS = 2.0
# Beyond this "up" of the map leans by half a degree where the vehicle is.
_FARTHEST_M = 50e3


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fixes:
    """Fixes of one antenna.

    Attributes:
        frame: `map` where the origin was given, else `enu`.
        origin: Where that frame lies on the earth.
        stamps_ns: (F,) int64, strictly rising.
        points_m: (F, 3) float64 antenna in `frame`, metres.
        covariances_m2: (F, 3, 3) float64, positive definite.
        dropped: Fixes that cannot be used, by reason.
    """

    frame: str
    origin: LocalFrame
    stamps_ns: NDArray[np.int64]
    points_m: NDArray[np.float64]
    covariances_m2: NDArray[np.float64]
    dropped: Counter[str] = field(default_factory=Counter)

    def median_sd_m(self) -> float:
        """Return the median horizontal standard deviation, metres an axis."""
        horizontal = np.trace(self.covariances_m2[:, :2, :2], axis1=1, axis2=2) / 2
        return float(np.sqrt(np.median(horizontal)))


def local_fixes(readings: Readings, origin: LocalFrame | None, config: FilterConfig) -> Fixes:
    """Return the fixes of a log in a local frame.

    A fix without a covariance gets one from its status.

    Raises:
        InsufficientDataError: If there are fewer than five.
        InputError: If the origin lies so far away that it is not that of this drive.
    """
    dropped = Counter(readings.dropped)
    stamps_ns, rows = readings.gnss.sorted("GNSS fixes", dropped)
    if len(stamps_ns) < _FEWEST:
        raise InsufficientDataError(f"the log has {len(stamps_ns)} GNSS fixes")
    frame = LocalFrame(*rows[0, :3].tolist()) if origin is None else origin
    points = frame.local(rows[:, :3])
    distance_m = float(np.median(np.linalg.norm(points, axis=1)))
    if distance_m > _FARTHEST_M:
        raise InputError(
            f"the map's origin lies {distance_m / 1000:.0f} km from the fixes",
            remedy="Give the map of this place, or its right origin",
        )
    return Fixes(
        frame="enu" if origin is None else "map",
        origin=frame,
        stamps_ns=stamps_ns,
        points_m=points,
        covariances_m2=_covariances(rows, config),
        dropped=dropped,
    )


def _covariances(rows: NDArray[np.float64], config: FilterConfig) -> NDArray[np.float64]:
    """Return (F, 3, 3) what the messages say, or their status, and never below the floor."""
    told = rows[:, 4:].reshape(-1, 3, 3)
    told = (told + np.swapaxes(told, 1, 2)) / 2
    status = np.clip(rows[:, 3].astype(np.int64), 0, len(config.status_sd_m) - 1)
    sd = np.array(config.status_sd_m)[status]
    usual = sd[:, None, None] ** 2 * np.diag([1.0, 1.0, _UPWARDS**2])
    covariances = np.where(np.isfinite(told), told, usual)
    # A message may give a matrix that is none: its diagonal is what was meant.
    broken = np.linalg.eigvalsh(covariances)[:, 0] <= 0
    diagonal = np.einsum("nij,ij->nij", covariances, np.eye(3))
    covariances = np.where(broken[:, None, None], diagonal, covariances)
    floor = config.gnss_sd_floor_m**2 * np.eye(3)
    return covariances + np.where(
        np.trace(covariances, axis1=1, axis2=2)[:, None, None] < np.trace(floor), floor, 0.0
    )
