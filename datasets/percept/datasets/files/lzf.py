"""LZF decompression for PCD's `binary_compressed` (the format of Marc Lehmann's liblzf)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["decompress_lzf"]


@njit(cache=True)
def decompress_lzf(packed: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Return the `size` bytes that were packed.

    A control byte below 32 is followed by that many literal bytes plus one. Any other holds
    the length (3 bits, 7: one more byte) and the distance (13 bits) of a copy from what was
    already unpacked.

    Args:
        packed: (M,) uint8.
        size: Number of bytes to expect.

    Returns:
        (size,) uint8, or (0,) where the data is damaged.
    """
    unpacked = np.empty(size, dtype=np.uint8)
    failed = np.empty(0, dtype=np.uint8)
    read = 0
    written = 0
    while read < len(packed):
        control = int(packed[read])
        read += 1
        if control < 32:
            length = control + 1
            if read + length > len(packed) or written + length > size:
                return failed
            unpacked[written : written + length] = packed[read : read + length]
            read += length
            written += length
            continue
        length = control >> 5
        if length == 7:
            if read >= len(packed):
                return failed
            length += int(packed[read])
            read += 1
        if read >= len(packed):
            return failed
        start = written - ((control & 31) << 8) - int(packed[read]) - 1
        read += 1
        length += 2
        if start < 0 or written + length > size:
            return failed
        # Byte by byte, because a copy may reach into what it writes itself.
        for step in range(length):
            unpacked[written + step] = unpacked[start + step]
        written += length
    return unpacked if written == size else failed
