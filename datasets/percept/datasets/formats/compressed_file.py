"""Log files that were compressed as a whole (`.db3.zstd`, `.mcap.zstd`)."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import BinaryIO

import zstandard

from percept.core.errors import RecordingError
from percept.datasets.messages import Connection, MessageSource, RawMessage

__all__ = ["CompressedSource", "unpack"]

# A block of zstd may grow 32768 times: this is what bounds the memory.
_BLOCK_BYTES = 1 << 11
_ALWAYS_ALLOWED_BYTES = 1 << 30
_MOST_EXPANSION = 1000


def unpack(path: Path, target: Path) -> bool:
    """Write the decompressed content of a zstd file, as far as it goes.

    Args:
        path: The compressed file.
        target: The file to write.

    Returns:
        Whether the content came to its end.
    """
    with path.open("rb") as packed, target.open("wb") as plain:
        try:
            return _copy(packed, plain)
        except zstandard.ZstdError:
            return False


def _copy(packed: BinaryIO, plain: BinaryIO) -> bool:
    """Decompress frame after frame in small steps; return whether the last one ended."""
    decompressor = zstandard.ZstdDecompressor()
    frame = decompressor.decompressobj()
    ended, data = True, packed.read(_BLOCK_BYTES)
    while data:
        if ended:
            frame = decompressor.decompressobj()
        plain.write(frame.decompress(data))
        if plain.tell() > max(_ALWAYS_ALLOWED_BYTES, _MOST_EXPANSION * packed.tell()):
            # Made to fill the disk: no log shrinks so far.
            return False
        ended = frame.eof
        data = frame.unused_data if ended and frame.unused_data else packed.read(_BLOCK_BYTES)
    return ended


class CompressedSource:
    """A `MessageSource` over a decompressed temporary copy, which is removed on close.

    Args:
        path: The compressed file.
        open_plain: Opens the decompressed file.

    Attributes:
        plain: The source that reads the copy.

    Raises:
        RecordingError: If there is no log in it.
    """

    def __init__(self, path: Path, open_plain: Callable[[Path], MessageSource]) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="percept-")
        copy = Path(self._folder.name) / path.stem
        whole = unpack(path, copy)
        try:
            self.plain = open_plain(copy)
        except RecordingError as error:
            self._folder.cleanup()
            raise RecordingError(
                f"{error.what} (after decompression)", where=path, remedy=error.remedy
            ) from error
        self.paths: tuple[Path, ...] = (path,)
        self.format = self.plain.format
        self.connections: tuple[Connection, ...] = self.plain.connections
        self.counts: dict[str, int] = self.plain.counts
        self.start_ns: int | None = self.plain.start_ns
        self.end_ns: int | None = self.plain.end_ns
        self.notes: tuple[str, ...] = self.plain.notes
        if not whole:
            self.plain.losses["compressed files that break off"] += 1

    @property
    def losses(self) -> Counter[str]:
        """What could not be read, by reason."""
        return self.plain.losses

    @losses.setter
    def losses(self, losses: Counter[str]) -> None:
        self.plain.losses = losses

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[RawMessage]:
        """Yield messages in log-time order; see `MessageSource.messages`."""
        return self.plain.messages(topics, start_ns, end_ns)

    def close(self) -> None:
        """Close and remove the temporary copy."""
        self.plain.close()
        self._folder.cleanup()
