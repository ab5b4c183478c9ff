"""Which part of a data set a place belongs to: the same for ever, and never nearer than a margin.

The earth is cut into cells that depend on no data. A hash of the cell decides the part, so a
frame keeps its part whatever is added later. A frame nearer than half the margin to a cell of
another part is left out. Any way between two frames of different parts leaves the cells of the
first part at least half a margin after its start, and enters those of the second at least half a
margin before its end; so the frames are a margin apart, and nobody has to compare them.

Why by place and not by drive alone: Lilja, Fu, Stenborg, Hammarstrand, "Localization Is All You
Evaluate: Data Leakage in Online Mapping Datasets and How to Fix It", CVPR 2024.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from hashlib import blake2b
from typing import Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from percept.core.errors import GeometryError
from percept.core.settings import Settings
from percept.datasets.labelling.labelled_set import SPLITS, Split

__all__ = ["Assignment", "SplitConfig", "SplitReason", "assign_splits"]

SplitReason = Literal["place", "drive", "margin", "place_unknown"]
"""Why a frame is where it is.

`place`: by the cell it lies in. `drive`: no frame of its drive has a place, the drive decides.
`margin`: left out, too near to a cell of another part. `place_unknown`: left out, its drive has
places but it has none, so it may lie anywhere among them.
"""

_LEAST_RADIUS_M = 6335439.0
"""Least radius of curvature on WGS 84, that along the meridian at the equator. Distances on a
sphere of this radius are never longer than on the ellipsoid, or on the usual mean sphere."""
_RESERVE = 1.005
"""For who measures with a local projection: its metres differ by less than this."""
_MIX = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))


class SplitConfig(Settings):
    """How a data set is split.

    Attributes:
        train: Share of the places for training.
        val: Share for validation.
        test: Share for the test.
        margin_m: Least distance between frames of different parts, metres.
        cell_m: Side of a cell, metres; None takes five margins, and 100 m at least. Smaller cells
            bring short drives into more than one part, and lose more frames to the margin.
        seed: Another seed splits the same places in another way. Keep it for the life of a
            data set.
    """

    train: float = Field(default=0.7, ge=0, le=1)
    val: float = Field(default=0.15, ge=0, le=1)
    test: float = Field(default=0.15, ge=0, le=1)
    margin_m: float = Field(default=20.0, ge=0, le=100_000, allow_inf_nan=False)
    cell_m: float | None = Field(default=None, ge=1, le=500_000, allow_inf_nan=False)
    seed: int = Field(default=0, ge=0, lt=2**63)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not math.isclose(self.train + self.val + self.test, 1.0, abs_tol=1e-6):
            raise ValueError("train, val and test must add up to 1")
        if self.side_m < 2 * self.margin_m:
            raise ValueError("cell_m must be at least twice margin_m")
        return self

    @property
    def side_m(self) -> float:
        """Side of a cell in metres."""
        return max(100.0, 5 * self.margin_m) if self.cell_m is None else self.cell_m


class Assignment(NamedTuple):
    """The part of one frame.

    Attributes:
        split: The part; None where the frame is left out.
        reason: Why.
    """

    split: Split | None
    reason: SplitReason


def assign_splits(
    latitudes: ArrayLike,
    longitudes: ArrayLike,
    drives: Sequence[str],
    config: SplitConfig | None = None,
) -> tuple[Assignment, ...]:
    """Assign frames to parts.

    What a frame gets depends on its own place, on its drive's fingerprint and on whether its
    drive has any place at all; never on other drives. Give all images of one keyframe the place
    of the keyframe, so that they stay together. The promise of a margin holds among frames with
    reason `place`: nobody can tell where a drive without any place was.

    Args:
        latitudes: (N,) degrees north; NaN where not known.
        longitudes: (N,) degrees east, in any turn; NaN where not known.
        drives: N fingerprints of the drives that the frames are from. A drive is given whole.
        config: Shares, margin and cells.

    Returns:
        One assignment a frame.

    Raises:
        GeometryError: If the three are not of one length.
    """
    config = config or SplitConfig()
    latitude, longitude = _degrees(latitudes), _degrees(longitudes)
    if not latitude.shape == longitude.shape == (len(drives),):
        raise GeometryError(
            f"{len(drives)} frames need as many latitudes and longitudes, "
            f"not {latitude.shape} and {longitude.shape}"
        )
    known = np.isfinite(longitude) & (np.abs(latitude) <= 90.0)
    parts = np.full(len(drives), -1)
    parts[known] = _parts_by_place(latitude[known], longitude[known], config)
    placed_drives = {drive for drive, is_known in zip(drives, known, strict=True) if is_known}
    by_drive = {drive: _part_of_drive(drive, config) for drive in set(drives) - placed_drives}
    return tuple(
        _assignment(int(part), "place", "margin")
        if is_known
        else _assignment(by_drive.get(drive, -1), "drive", "place_unknown")
        for drive, is_known, part in zip(drives, known, parts, strict=True)
    )


def _degrees(values: ArrayLike) -> NDArray[np.float64]:
    return np.asarray(values, dtype=np.float64)


def _assignment(part: int, chosen: SplitReason, left_out: SplitReason) -> Assignment:
    return Assignment(None, left_out) if part < 0 else Assignment(SPLITS[part], chosen)


def _parts_by_place(
    latitude: NDArray[np.float64], longitude: NDArray[np.float64], config: SplitConfig
) -> NDArray[np.int64]:
    """Return the part (N,) of places in degrees; -1 within half a margin of another's cell.

    The square about a place is smaller than a cell, so its corners lie in all cells it touches.
    """
    reach = math.degrees(config.margin_m / 2 * _RESERVE / _LEAST_RADIUS_M)
    poleward = np.minimum(np.abs(latitude) + reach, 90.0)
    # At the pole the square takes in all longitudes; the cell there does too.
    reach_east = np.minimum(reach / np.maximum(np.cos(np.radians(poleward)), 1e-12), 180.0)
    parts = _part_of_cell(latitude, longitude, config)
    for north in (-reach, reach):
        for east in (-reach_east, reach_east):
            corner = _part_of_cell(latitude + north, longitude + east, config)
            parts = np.where(corner == parts, parts, -1)
    return parts


def _part_of_cell(
    latitude: NDArray[np.float64], longitude: NDArray[np.float64], config: SplitConfig
) -> NDArray[np.int64]:
    """Return the part (N,) of the cells that places in degrees lie in.

    Rows have one height. Each row has as many columns as leave them the side of a cell at its
    edge towards the pole, so that cells meet again at 180 degrees.
    """
    rows = max(1, int(math.pi * _LEAST_RADIUS_M / config.side_m))
    row = np.clip(np.floor((latitude + 90.0) / 180.0 * rows), 0, rows - 1)
    edges = np.radians(np.stack([row, row + 1]) * (180.0 / rows) - 90.0)
    around_m = 2 * math.pi * _LEAST_RADIUS_M * np.cos(np.abs(edges).max(axis=0))
    columns = np.maximum(1.0, np.floor(around_m / config.side_m))
    column = np.minimum(np.floor((longitude / 360.0) % 1.0 * columns), columns - 1)
    cell = row.astype(np.uint64) << np.uint64(32) | column.astype(np.uint64)
    return _part_of_share(_mixed(cell ^ _mixed(np.array([config.seed], np.uint64))), config)


def _part_of_drive(fingerprint: str, config: SplitConfig) -> int:
    digest = blake2b(f"{config.seed}:{fingerprint}".encode(), digest_size=8).digest()
    share = np.array([int.from_bytes(digest, "little")], np.uint64)
    return int(_part_of_share(share, config)[0])


def _part_of_share(hashes: NDArray[np.uint64], config: SplitConfig) -> NDArray[np.int64]:
    """Turn hashes into parts by their shares: the low end trains, the high end tests."""
    shares = (hashes >> np.uint64(11)) * 2.0**-53
    return np.searchsorted([config.train, 1.0 - config.test], shares, side="right")


def _mixed(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Hash integers: SplitMix64 (Steele, Lea, Flood, OOPSLA 2014), which wraps on purpose."""
    mixed = values + _MIX[0]
    mixed = (mixed ^ (mixed >> np.uint64(30))) * _MIX[1]
    mixed = (mixed ^ (mixed >> np.uint64(27))) * _MIX[2]
    return mixed ^ (mixed >> np.uint64(31))
