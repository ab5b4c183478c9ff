"""A point cloud laid out as the bytes of a `sensor_msgs/PointCloud2`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import UsageError
from percept.core.samples import PointCloud
from percept.datasets.decoding.point_cloud2 import DATATYPES

__all__ = ["CloudLayout", "PackedPoints", "packed_points"]

_DATATYPE_OF = {code: number for number, code in DATATYPES.items()}


@dataclass(frozen=True, slots=True)
class CloudLayout:
    """How points are laid out in the messages that are written.

    Attributes:
        xyz: numpy code of x, y, z: `f4` or `f8`.
        intensity: numpy code of the intensity: `f4`, `f8`, or `u1`, `u2`, to which it is
            rounded and clipped.
        big_endian: Byte order of the points.
        point_padding: Unused bytes behind each point.
        row_padding: Unused bytes behind each row.
        rows: Height of the cloud; the number of points must be a multiple of it.
    """

    xyz: str = "f4"
    intensity: str = "f4"
    big_endian: bool = False
    point_padding: int = 0
    row_padding: int = 0
    rows: int = 1


class PackedPoints(NamedTuple):
    """The parts of a PointCloud2.

    Attributes:
        fields: Name, offset and `PointField` datatype of each field.
        height: Rows.
        width: Points in a row.
        point_step: Bytes from one point to the next.
        row_step: Bytes from one row to the next.
        data: (height * row_step,) uint8.
    """

    fields: list[tuple[str, int, int]]
    height: int
    width: int
    point_step: int
    row_step: int
    data: NDArray[np.uint8]


def packed_points(cloud: PointCloud, layout: CloudLayout) -> PackedPoints:
    """Lay out a cloud: x, y, z and what it has of `intensity`, `t` (int32 ns) and `ring` (uint16).

    Raises:
        UsageError: If the points do not fill the rows, or a time or ring does not fit its type.
    """
    columns = _columns(cloud, layout)
    fields: list[tuple[str, int, int]] = []
    offset = 0
    for name, (_, code) in columns.items():
        fields.append((name, offset, _DATATYPE_OF[code]))
        offset += np.dtype(code).itemsize
    point_step = offset + layout.point_padding
    height = layout.rows
    width, left_over = divmod(len(cloud), height)
    if left_over:
        raise UsageError(f"{len(cloud)} points do not fill {height} rows", where=cloud.topic)
    row_step = width * point_step + layout.row_padding
    data = np.zeros(height * row_step, dtype=np.uint8)
    if not len(cloud):
        return PackedPoints(fields, height, width, point_step, row_step, data)
    order = ">" if layout.big_endian else "<"
    for (values, code), (_, start, _) in zip(columns.values(), fields, strict=True):
        view: NDArray[np.generic] = np.ndarray(
            (height, width), order + code, data, start, (row_step, point_step)
        )
        view[...] = values.reshape(height, width)
    return PackedPoints(fields, height, width, point_step, row_step, data)


def _columns(cloud: PointCloud, layout: CloudLayout) -> dict[str, tuple[NDArray[np.generic], str]]:
    columns: dict[str, tuple[NDArray[np.generic], str]] = {
        name: (cloud.points_xyz[:, axis], layout.xyz) for axis, name in enumerate("xyz")
    }
    if cloud.intensity is not None:
        intensity = cloud.intensity
        code = layout.intensity
        if code.startswith("u"):
            intensity = np.clip(np.rint(intensity), 0, np.iinfo(code).max)
        columns["intensity"] = (intensity, code)
    if cloud.offset_ns is not None:
        columns["t"] = (_fitting(cloud.offset_ns, "i4", "per-point times", cloud.topic), "i4")
    if cloud.ring is not None:
        columns["ring"] = (_fitting(cloud.ring, "u2", "rings", cloud.topic), "u2")
    return columns


def _fitting(values: NDArray[np.integer], code: str, what: str, topic: str) -> NDArray[np.generic]:
    limits = np.iinfo(code)
    if len(values) and (values.min() < limits.min or values.max() > limits.max):
        raise UsageError(f"{what} do not fit {np.dtype(code).name}", where=topic)
    return values
