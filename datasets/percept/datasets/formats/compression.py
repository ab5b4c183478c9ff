"""Decompression that never trusts a size it reads, and that can stop at the break of a cut log."""

from __future__ import annotations

import bz2
from typing import Protocol

import lz4.frame
import zstandard

__all__ = ["ZSTD_MAGIC", "CompressionError", "decompress", "decompress_prefix"]

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_STEP_BYTES = 4096
_MOST_EXPANSION = 1000
_BROKEN = (zstandard.ZstdError, RuntimeError, OSError, EOFError, MemoryError)


class CompressionError(Exception):
    """Data that does not decompress; the text says why, as a clause."""


class _Decompressor(Protocol):
    def decompress(self, data: bytes, /) -> bytes: ...


def _decompressor(compression: str) -> _Decompressor:
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompressobj()
    if compression == "lz4":
        decompressor: _Decompressor = lz4.frame.LZ4FrameDecompressor()
        return decompressor
    if compression == "bz2":
        return bz2.BZ2Decompressor()
    raise CompressionError(f"that use the unknown compression '{compression[:20]}'")


def decompress(compression: str, data: bytes, size: int | None = None) -> bytes:
    """Return the whole of compressed data.

    Args:
        compression: `zstd`, `lz4`, `bz2`, or `none` or an empty text.
        data: Compressed bytes.
        size: Size after decompression, or None where it is not known.

    Raises:
        CompressionError: If the data is broken, is cut, or has another size.
    """
    if compression in ("", "none"):
        return data
    decompressor = _decompressor(compression)
    try:
        if compression == "zstd" and _states_size(data, size):
            return zstandard.ZstdDecompressor().decompress(data)
        plain = decompressor.decompress(data)
    except _BROKEN as error:
        raise CompressionError("that do not decompress") from error
    if not getattr(decompressor, "eof", True) or (size is not None and len(plain) != size):
        raise CompressionError("that do not decompress")
    return plain


def _states_size(data: bytes, size: int | None) -> bool:
    """Return whether a frame states its size and it is credible: then one call does it, faster."""
    stated = zstandard.get_frame_parameters(data).content_size
    return stated == size if size is not None else 0 < stated < _MOST_EXPANSION * len(data)


def decompress_prefix(compression: str, data: bytes) -> bytes:
    """Return as much as decompresses before the data breaks off.

    The data is fed in small steps, so that what precedes the break is not lost with it.

    Raises:
        CompressionError: If the compression is unknown.
    """
    if compression in ("", "none"):
        return data
    decompressor = _decompressor(compression)
    parts = []
    for start in range(0, len(data), _STEP_BYTES):
        try:
            parts.append(decompressor.decompress(data[start : start + _STEP_BYTES]))
        except _BROKEN:
            break
    return b"".join(parts)
