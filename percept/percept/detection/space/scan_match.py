"""Images, scans and depth images of one log: each image waits for those nearest to it in time.

Stamps decide what belongs together, times of recording how long an image waits. No motion between
the two is taken out: at 20 m/s of relative speed, 50 ms apart are 1 m.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Generic, NamedTuple, TypeVar

from percept.core.clock import NS_PER_MS
from percept.core.errors import UsageError
from percept.core.samples import CameraImage, PointCloud
from percept.detection.result import ImageResult
from percept.lidar.result import ScanResult

__all__ = ["ImageMatch", "ScanMatcher"]

_LONGEST_WAIT_NS = 500 * NS_PER_MS
_MOST_WAITING = 64

_Item = TypeVar("_Item", ScanResult, CameraImage)


class ImageMatch(NamedTuple):
    """An image and what other sensors saw at its moment.

    Attributes:
        image: The image.
        scans: By LiDAR stream, the scan nearest in time; streams without one are left out.
        depth: The camera's depth image nearest in time, or None.
    """

    image: ImageResult
    scans: Mapping[str, ScanResult]
    depth: CameraImage | None


class ScanMatcher:
    """Gives every image the scan of each LiDAR stream, and the depth image, nearest in time.

    It is fed in log order and gives the images back in the order in which they came. An image
    waits until each stream has shown something that is not older, or half a second of the log has
    gone by, or 64 images wait: so a sensor that dies holds nothing up and memory stays flat. What
    was recorded more than half a second before or after an image never belongs to it.

    Attributes:
        unmatched: By camera, images without a scan or depth image near enough.
    """

    def __init__(
        self,
        streams: Sequence[str],
        largest_difference_ns: int = 100 * NS_PER_MS,
        *,
        depth_cameras: Collection[str] = (),
    ) -> None:
        """Take the streams; without any, images pass through at once.

        Args:
            streams: Names of the LiDAR streams that scans will come from.
            largest_difference_ns: Largest difference of the stamps of an image and its scan.
            depth_cameras: Names of the cameras that depth images will come from.

        Raises:
            UsageError: If the difference is negative.
        """
        if largest_difference_ns < 0:
            raise UsageError(f"a difference of {largest_difference_ns} ns cannot be negative")
        self.unmatched: Counter[str] = Counter()
        self._largest_ns = largest_difference_ns
        self._scans = {name: _Recent[ScanResult]() for name in streams}
        self._depths = {name: _Recent[CameraImage]() for name in depth_cameras}
        self._waiting: deque[ImageResult] = deque()
        self._now_ns = 0

    def add_scan(self, stream: str, scan: ScanResult) -> list[ImageMatch]:
        """Take a scan, and return the images that wait no longer.

        Raises:
            UsageError: If the stream is none of the matcher's.
        """
        if stream not in self._scans:
            raise UsageError(f"no LiDAR stream '{stream}' among {', '.join(self._scans)}")
        self._scans[stream].add(scan, scan.cloud)
        return self._advance(scan.cloud.log_time_ns)

    def add_depth(self, camera: str, depth: CameraImage) -> list[ImageMatch]:
        """Take a depth image of a camera, and return the images that wait no longer.

        Raises:
            UsageError: If the camera is none of those with depth images.
        """
        if camera not in self._depths:
            raise UsageError(f"no camera '{camera}' among {', '.join(self._depths)}")
        self._depths[camera].add(depth, depth)
        return self._advance(depth.log_time_ns)

    def add_image(self, image: ImageResult) -> list[ImageMatch]:
        """Take an image, and return the images that wait no longer."""
        self._waiting.append(image)
        return self._advance(image.log_time_ns)

    def flush(self) -> list[ImageMatch]:
        """Return the images that still wait at the end of the log."""
        return [self._matched(self._waiting.popleft()) for _ in range(len(self._waiting))]

    def _advance(self, log_time_ns: int) -> list[ImageMatch]:
        self._now_ns = max(self._now_ns, log_time_ns)
        ready = []
        while self._waiting and self._is_settled(self._waiting[0]):
            ready.append(self._matched(self._waiting.popleft()))
        oldest_ns = self._waiting[0].log_time_ns if self._waiting else self._now_ns
        for scans in self._scans.values():
            scans.forget_before(oldest_ns - _LONGEST_WAIT_NS)
        for depths in self._depths.values():
            depths.forget_before(oldest_ns - _LONGEST_WAIT_NS)
        return ready

    def _is_settled(self, image: ImageResult) -> bool:
        late = self._now_ns > image.log_time_ns + _LONGEST_WAIT_NS
        if late or len(self._waiting) > _MOST_WAITING:
            return True
        depth = self._depths.get(image.camera)
        reached = [recent.has_reached(image.stamp_ns) for recent in self._scans.values()]
        return all(reached) and (depth is None or depth.has_reached(image.stamp_ns))

    def _matched(self, image: ImageResult) -> ImageMatch:
        scans = {
            stream: scan
            for stream, recent in self._scans.items()
            if (scan := recent.nearest(image, self._largest_ns)) is not None
        }
        depths = self._depths.get(image.camera)
        depth = None if depths is None else depths.nearest(image, self._largest_ns)
        if (self._scans or depths is not None) and not scans and depth is None:
            self.unmatched[image.camera] += 1
        return ImageMatch(image, MappingProxyType(scans), depth)


class _Recent(Generic[_Item]):
    """What one sensor delivered in the last moments, each with its stamp and log time."""

    def __init__(self) -> None:
        self._items: deque[tuple[int, int, _Item]] = deque()

    def add(self, item: _Item, sample: PointCloud | CameraImage) -> None:
        self._items.append((sample.stamp_ns, sample.log_time_ns, item))

    def forget_before(self, log_time_ns: int) -> None:
        while self._items and self._items[0][1] < log_time_ns:
            self._items.popleft()

    def has_reached(self, stamp_ns: int) -> bool:
        return any(stamp >= stamp_ns for stamp, _, _ in self._items)

    def nearest(self, image: ImageResult, largest_ns: int) -> _Item | None:
        near = [
            (abs(stamp - image.stamp_ns), item)
            for stamp, log_time, item in self._items
            if abs(stamp - image.stamp_ns) <= largest_ns
            and abs(log_time - image.log_time_ns) <= _LONGEST_WAIT_NS
        ]
        return min(near, key=lambda candidate: candidate[0], default=(0, None))[1]
