"""Finds images that show again what another image shows.

Two checks: the hashes of the pictures are near each other, which is quick; and then no part of
the small pictures differs, so that an empty road is not taken for another part of it, nor a
street that somebody has just entered for the empty one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.settings import Settings
from percept.datasets.labelling.choice.image_look import ImageLook

__all__ = ["DuplicateConfig", "DuplicateFinder"]

_LEAST_CONTRAST = 4.0
_NO_GROUP = -1


class DuplicateConfig(Settings):
    """How alike two images are that show the same.

    Attributes:
        most_bits: So many of the 256 bits of their hashes may differ. Other pictures differ in
            about 128.
        most_change: No cell of the small picture differs by more than this, as a share of the
            standard deviation of its grey, after the brightness of one was mapped to the other's.
    """

    most_bits: int = Field(default=24, ge=0, le=255)
    most_change: float = Field(default=0.4, gt=0)


class DuplicateFinder:
    """Images in the order in which they come: each is new, or shows again an earlier new one.

    Time grows with the number of images times that of new ones: about 5 ms for each million
    pairs; memory is 0.6 kB for each new image.

    Args:
        config: How alike is alike.
    """

    def __init__(self, config: DuplicateConfig) -> None:
        self._config = config
        self._hashes = np.zeros((4, 256), np.uint64)
        self._groups = np.zeros(256, np.int64)
        self._thumbnails: list[NDArray[np.uint8]] = []
        self._numbers: list[int] = []
        self._offered = 0

    def offer(self, look: ImageLook, *, group: int | None = None) -> int | None:
        """Return which image this one repeats, or take it in as a new one.

        Args:
            look: The image.
            group: Images of one group, from 0, are never duplicates of each other, such as those
                of the two cameras of a stereo pair at one moment; None is no group.

        Returns:
            The number of the image that it repeats, counted from 0 over all that were offered:
            the one with the least change, the earliest of equals. None for a new image.
        """
        number, group = self._offered, _NO_GROUP if group is None else group
        self._offered += 1
        found = self._repeated(look, group)
        if found is None:
            self._take_in(look, group, number)
            return None
        return self._numbers[found]

    def _repeated(self, look: ImageLook, group: int) -> int | None:
        near = self._near(look.hash)
        other = near[(self._groups[near] != group) | (group == _NO_GROUP)]
        changes = [_change(self._thumbnails[i], look.thumbnail) for i in other]
        if not changes or min(changes) > self._config.most_change:
            return None
        return int(other[int(np.argmin(changes))])

    def _near(self, hashed: NDArray[np.uint64]) -> NDArray[np.intp]:
        """Return the new images whose hashes differ in few enough bits."""
        most, known = self._config.most_bits, self._hashes[:, : len(self._numbers)]
        # The first quarter of the bits leaves few for whom the others must be counted.
        near = np.flatnonzero(np.bitwise_count(known[0] ^ hashed[0]) <= most)
        bits = np.bitwise_count(known[:, near] ^ hashed[:, None]).sum(axis=0, dtype=np.int64)
        few: NDArray[np.intp] = near[bits <= most]
        return few

    def _take_in(self, look: ImageLook, group: int, number: int) -> None:
        count = len(self._numbers)
        if count == len(self._groups):
            self._hashes = np.concatenate([self._hashes, np.zeros_like(self._hashes)], axis=1)
            self._groups = np.concatenate([self._groups, np.zeros_like(self._groups)])
        self._hashes[:, count], self._groups[count] = look.hash, group
        self._thumbnails.append(look.thumbnail)
        self._numbers.append(number)


def _change(known: NDArray[np.uint8], seen: NDArray[np.uint8]) -> float:
    """Return the largest difference of two small pictures over the contrast of the first.

    The greys of one are first replaced by those of the same rank in the other: exposure, gain and
    gamma change greys and not their order.
    """
    target, ranks = known.ravel().astype(np.float64), np.empty(known.size, np.int64)
    ranks[np.argsort(seen, axis=None, kind="stable")] = np.arange(seen.size)
    mapped = np.sort(target)[ranks]
    return float(np.abs(mapped - target).max() / max(float(target.std()), _LEAST_CONTRAST))
