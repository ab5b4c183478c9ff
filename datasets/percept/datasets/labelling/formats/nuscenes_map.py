"""A drive's map for nuScenes: where it was driven, in a frame whose coordinates are positive."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.transform import Transform
from percept.datasets.labelling.formats.nuscenes_tables import token
from percept.datasets.labelling.labelled_set import Drive

__all__ = ["DriveMap"]

_F64 = NDArray[np.float64]

_MARGIN_M = 100.0
_PIXELS_A_METRE = 10  # the development kit takes nothing else
_LARGEST_M = 2000.0
_DRIVEN_RADIUS_M = 1.0
_DRIVEN = 255


@dataclass(frozen=True, slots=True, eq=False)
class DriveMap:
    """The global frame of a drive and what its map shows.

    Attributes:
        drive: The drive.
        offset_m: (2,) what is added to x and y of the drive's own frame, whole metres.
        places_m: (N, 2) where the vehicle was, in the global frame.
        size_m: (2,) width and height of the map, which begins at 0, 0.
    """

    drive: str
    offset_m: _F64
    places_m: _F64
    size_m: _F64

    @classmethod
    def around(cls, drive: str, places_m: _F64) -> DriveMap:
        """Return the map around places (N, 2) of a vehicle in the drive's own frame."""
        offset = np.ceil(_MARGIN_M - places_m.min(axis=0))
        size = np.ceil(np.ptp(places_m, axis=0)) + 2 * _MARGIN_M + 1
        return cls(drive, offset, places_m + offset, size)

    @property
    def file(self) -> str:
        """Name of the picture."""
        return f"maps/{self.drive}.png"

    def place(self, T_world_base: Transform) -> Transform:
        """Return where a vehicle is in the global frame."""
        matrix = T_world_base.matrix.copy()
        matrix[:2, 3] += self.offset_m
        return Transform("global", T_world_base.source, matrix)

    def log_record(self, drive: Drive) -> dict[str, Any]:
        """Return the row of `log`."""
        captured = datetime.fromtimestamp(drive.start_ns // 10**9, UTC)
        return {
            "token": token("log", self.drive),
            "logfile": drive.log,
            "vehicle": drive.base_frame,
            "date_captured": f"{captured:%Y-%m-%d}",
            "location": self.drive,
            "global_offset_m": self.offset_m.tolist(),
        }

    def map_record(self) -> dict[str, Any]:
        """Return the row of `map`."""
        return {
            "token": token("map", self.drive),
            "log_tokens": [token("log", self.drive)],
            "category": "semantic_prior",
            "filename": self.file,
        }

    def draw(self, folder: Path) -> bool:
        """Write the picture; return whether it shows the map or, too large, a single pixel.

        Args:
            folder: The data set's; `maps` is in it.

        Raises:
            InputError: If the file cannot be written.
        """
        shown = bool(self.size_m.max() <= _LARGEST_M)
        width, height = (self.size_m * _PIXELS_A_METRE).astype(int) if shown else (1, 1)
        pixels = np.zeros((height, width), np.uint8)
        if shown:
            at = np.round(self.places_m * _PIXELS_A_METRE).astype(int)
            for column, row in at.tolist():
                radius = round(_DRIVEN_RADIUS_M * _PIXELS_A_METRE)
                cv2.circle(pixels, (column, height - row), radius, _DRIVEN, cv2.FILLED)
        if not cv2.imwrite(str(folder / self.file), pixels):
            raise InputError("the map cannot be written", where=folder / self.file)
        return shown
