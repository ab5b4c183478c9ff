"""Width and height of an image file, from its header alone."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

__all__ = ["image_file_size"]

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_BMP = b"BM"
_LARGEST_SIDE = 100_000
# Start-of-frame markers of ITU-T T.81, table B.1; C4, C8 and CC in between are other things.
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_ALONE = {0x01, *range(0xD0, 0xD8)}  # markers without a length
_MOST_SEGMENTS = 10_000


def image_file_size(path: Path) -> tuple[int, int] | None:
    """Return (width, height) of a PNG, JPEG or BMP file, or None where it cannot be told."""
    try:
        with path.open("rb") as file:
            size = _size(file)
    except (OSError, struct.error):
        return None
    if size is None or not all(0 < side <= _LARGEST_SIDE for side in size):
        return None
    return size


def _size(file: BinaryIO) -> tuple[int, int] | None:
    head = file.read(26)
    if head.startswith(_PNG):
        width, height = struct.unpack(">II", head[16:24])
        return int(width), int(height)
    if head.startswith(_BMP):
        width, height = struct.unpack("<ii", head[18:26])
        return int(width), abs(int(height))  # a negative height is stored from the top
    if head.startswith(_JPEG):
        file.seek(2)
        return _jpeg_size(file)
    return None


def _jpeg_size(file: BinaryIO) -> tuple[int, int] | None:
    """Walk the segments of a JPEG up to its frame header (ITU-T T.81, B.2.2)."""
    for _ in range(_MOST_SEGMENTS):
        if file.read(1) != b"\xff":
            return None
        marker = file.read(1)
        while marker == b"\xff":  # fill bytes
            marker = file.read(1)
        if not marker:
            return None
        if marker[0] in _ALONE:
            continue
        (length,) = struct.unpack(">H", file.read(2))
        if marker[0] in _FRAMES:
            _precision, height, width = struct.unpack(">BHH", file.read(5))
            return int(width), int(height)
        file.seek(max(length - 2, 0), 1)
    return None
