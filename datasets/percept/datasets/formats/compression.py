"""Decompression that never trusts a size it reads, and that can stop at the break of a cut log.

A few bytes can be made to decompress to gigabytes. Recorders write chunks of 0.8 to 32 MB, some
of 100 MB and more, and what they hold rarely shrinks below a hundredth. So nothing may grow
beyond 512 MiB, and beyond 64 MiB not to more than 1000 times its size in the file.
"""

from __future__ import annotations

import bz2
from collections.abc import Iterator
from typing import Protocol

import lz4.frame
import zstandard

__all__ = ["ZSTD_MAGIC", "CompressionError", "decompress", "decompress_prefix", "largest_plain"]

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
# So small that even the best packed step gives less than 100 MB.
_STEP_BYTES = {"zstd": 2048, "lz4": 1 << 18, "bz2": 4096}
_PREFIX_STEP_BYTES = 1024
_LARGEST_BYTES = 1 << 29
_ALWAYS_ALLOWED_BYTES = 1 << 26
_MOST_EXPANSION = 1000
_BROKEN = (zstandard.ZstdError, RuntimeError, OSError, EOFError, MemoryError)


class CompressionError(Exception):
    """Data that does not decompress; the text says why, as a clause."""


class _Decompressor(Protocol):
    def decompress(self, data: bytes, /) -> bytes: ...


def largest_plain(packed_bytes: int) -> int:
    """Return to how many bytes so many compressed ones may grow."""
    return min(max(_ALWAYS_ALLOWED_BYTES, _MOST_EXPANSION * packed_bytes), _LARGEST_BYTES)


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
        CompressionError: If the data is broken, is cut, has another size, or would grow beyond
            what a recorder writes.
    """
    if compression in ("", "none"):
        return data
    limit = largest_plain(len(data))
    _require_credible(size or 0, limit)
    decompressor = _decompressor(compression)
    try:
        if compression == "zstd" and (stated := _stated_size(data)) and size in (None, stated):
            # One call is faster, and allocates what the frame states.
            _require_credible(stated, limit)
            return zstandard.ZstdDecompressor().decompress(data)
        steps = _steps(decompressor, data, _STEP_BYTES[compression], size or limit)
        plain = b"".join(steps)
    except _BROKEN as error:
        raise CompressionError("that do not decompress") from error
    _require_credible(0 if size else len(plain), limit)
    if not getattr(decompressor, "eof", True) or (size is not None and len(plain) != size):
        raise CompressionError("that do not decompress")
    return plain


def _require_credible(size: int, limit: int) -> None:
    if size > limit:
        raise CompressionError("that would decompress to more than any recorder writes")


def _stated_size(data: bytes) -> int:
    """Return the size that a zstd frame states, or 0 where it states none."""
    stated = zstandard.get_frame_parameters(data).content_size
    return 0 if stated == zstandard.CONTENTSIZE_UNKNOWN else stated


def _steps(
    decompressor: _Decompressor, data: bytes, step_bytes: int, limit: int
) -> Iterator[bytes]:
    """Decompress step by step, until the end or until there is more than the limit."""
    given = 0
    for start in range(0, len(data), step_bytes):
        if given > limit or getattr(decompressor, "eof", False):
            return
        part = decompressor.decompress(data[start : start + step_bytes])
        given += len(part)
        yield part


def decompress_prefix(compression: str, data: bytes) -> bytes:
    """Return as much as decompresses before the data breaks off, or grows beyond belief.

    The data is fed in small steps, so that what precedes the break is not lost with it.

    Raises:
        CompressionError: If the compression is unknown.
    """
    if compression in ("", "none"):
        return data
    parts: list[bytes] = []
    limit = largest_plain(len(data))
    try:
        for part in _steps(_decompressor(compression), data, _PREFIX_STEP_BYTES, limit):
            parts.append(part)  # noqa: PERF402 (what precedes a break is kept)
    except _BROKEN:
        pass
    return b"".join(parts)
