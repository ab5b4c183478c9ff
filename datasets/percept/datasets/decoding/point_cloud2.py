"""`sensor_msgs/PointCloud2` in every layout, and Livox's own message, as structured arrays."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import DecodeError
from percept.datasets.decoding.point_records import POINT_FIELDS
from percept.datasets.messages import RosMessage

__all__ = ["DATATYPES", "records_of_livox", "records_of_point_cloud2"]

DATATYPES = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    8: "f8",
    # Added to sensor_msgs/PointField by later ROS 2 releases.
    9: "i8",
    10: "u8",
    11: "?",
}
"""numpy type codes of `sensor_msgs/PointField.datatype`, without the byte order."""

_LONGEST_POINT_BYTES = 1 << 20


def records_of_point_cloud2(message: RosMessage, topic: str) -> NDArray[np.void]:
    """Return a view (height, width) of the fields that percept reads; nothing is copied.

    Padding of points (`point_step`) and rows (`row_step`) is stepped over by strides. Fields
    that nobody reads may be nameless, doubled or of unknown types.

    Args:
        message: The decoded message.
        topic: Where it comes from, for errors.

    Raises:
        DecodeError: If a field lies outside of its point, is given twice or has no known type,
            or if the data is shorter than the sizes say.
    """
    height, width = int(message.height), int(message.width)
    point_step, row_step = int(message.point_step), int(message.row_step)
    order = ">" if message.is_bigendian else "<"
    if height == 0 or width == 0:
        return np.empty((0, 0), dtype=_record_dtype(message.fields, point_step, order, topic))
    if height == 1 or row_step == 0:
        row_step = width * point_step
    if row_step < width * point_step:
        raise DecodeError(
            f"rows of {width} points of {point_step} bytes do not fit row_step {row_step}",
            where=topic,
        )
    needed = (height - 1) * row_step + width * point_step
    if len(message.data) < needed:
        raise DecodeError(
            f"{height} x {width} points need {needed} bytes, the message has {len(message.data)}",
            where=topic,
        )
    data = np.ascontiguousarray(message.data, dtype=np.uint8)
    dtype = _record_dtype(message.fields, point_step, order, topic)
    return np.ndarray((height, width), dtype, buffer=data, strides=(row_step, point_step))


def _record_dtype(
    fields: Iterable[RosMessage], point_step: int, order: str, topic: str
) -> np.dtype[np.void]:
    if point_step > _LONGEST_POINT_BYTES:
        raise DecodeError(f"points of {point_step} bytes", where=topic)
    formats: dict[str, tuple[str, int]] = {}
    for field in fields:
        name = str(field.name).lower()
        if name not in POINT_FIELDS:
            continue
        if name in formats:
            raise DecodeError(f"the field '{name}' is given twice", where=topic)
        formats[name] = (_field_format(field, point_step, order, topic), int(field.offset))
    layout = {
        "names": list(formats),
        "formats": [code for code, _ in formats.values()],
        "offsets": [offset for _, offset in formats.values()],
        "itemsize": max(point_step, 1),
    }
    return np.dtype(layout)  # type: ignore[call-overload, no-any-return]  # names come at run time


def _field_format(field: RosMessage, point_step: int, order: str, topic: str) -> str:
    code = DATATYPES.get(int(field.datatype))
    if code is None:
        raise DecodeError(
            f"the field '{field.name}' has the unknown datatype {field.datatype}", where=topic
        )
    # Some drivers leave the count at zero where they mean one.
    if int(field.count) > 1:
        raise DecodeError(f"the field '{field.name}' has {field.count} values", where=topic)
    if int(field.offset) + np.dtype(code).itemsize > point_step:
        raise DecodeError(
            f"the field '{field.name}' at byte {field.offset} lies outside of a point of "
            f"{point_step} bytes",
            where=topic,
        )
    return order + code


_LIVOX_DTYPE = np.dtype(
    [
        ("x", "f4"),
        ("y", "f4"),
        ("z", "f4"),
        ("reflectivity", "f4"),
        ("line", "i4"),
        ("offset_time", "i8"),
    ]
)


def records_of_livox(message: RosMessage, stamp_ns: int, topic: str) -> NDArray[np.void]:
    """Return records (N,) of a Livox `CustomMsg`, with times relative to the header stamp.

    The points' times count from `timebase`. Where it is the header's clock (within a second),
    the difference is added; otherwise the header's stamp is taken for the start.

    Args:
        message: The decoded message.
        stamp_ns: Its header stamp.
        topic: Where it comes from, for errors.

    Raises:
        DecodeError: If the log's definition of the message has other fields.
    """
    try:
        shift_ns = int(message.timebase) - stamp_ns
        rows = [(p.x, p.y, p.z, p.reflectivity, p.line, p.offset_time) for p in message.points]
    except AttributeError as error:
        raise DecodeError(f"not the Livox message that is known ({error})", where=topic) from error
    records = np.array(rows, dtype=_LIVOX_DTYPE)
    if abs(shift_ns) < 1_000_000_000:
        records["offset_time"] += shift_ns
    return records
