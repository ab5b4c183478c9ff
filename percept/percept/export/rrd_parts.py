"""The ends of .rrd files that a killed process left."""

from __future__ import annotations

import struct
from pathlib import Path

__all__ = ["cut_to_whole_messages"]

_HEAD_BYTES = 12
_MESSAGE_HEAD = struct.Struct("<QQ")


def cut_to_whole_messages(part: Path) -> None:
    """Cut off the message that a killed process did not finish.

    An .rrd file is a head of 12 bytes and messages, each behind its kind and its length as
    64-bit little-endian numbers (`RRF2`, which the pinned rerun writes).
    """
    size = part.stat().st_size
    with part.open("r+b") as file:
        end = _HEAD_BYTES
        while end + _MESSAGE_HEAD.size <= size:
            file.seek(end)
            _, length = _MESSAGE_HEAD.unpack(file.read(_MESSAGE_HEAD.size))
            if end + _MESSAGE_HEAD.size + length > size:
                break
            end += _MESSAGE_HEAD.size + length
        if end < size:
            file.truncate(end)
