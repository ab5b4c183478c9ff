"""Images on their last step: which boxes count, and where they are by scans and depth images."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from percept.core.cameras import Camera
from percept.core.errors import GeometryError
from percept.core.results import Detections2D
from percept.core.samples import CameraImage
from percept.core.transform import Transform
from percept.detection.boxes.merge_models import primary_boxes
from percept.detection.result import ImageResult, Positions
from percept.detection.space.positions import best_positions, locate_boxes, locate_in_depth
from percept.detection.space.scan_match import ImageMatch, ScanMatcher
from percept.lidar.result import ScanResult

__all__ = ["BoxPlacer", "CameraPlace", "PlacedImage"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraPlace:
    """A camera among the sensors that measure distance.

    Attributes:
        camera: Its lens.
        T_camera_clouds: By LiDAR stream, maps points of its clouds into the optical frame. All
            start at one frame.
        T_target_camera: Maps the optical frame into that in which depth images give places, the
            one of the clouds where there are some; None for a camera without depth images.

    Raises:
        GeometryError: If the frames differ.
    """

    camera: Camera
    T_camera_clouds: Mapping[str, Transform] = field(default_factory=dict)
    T_target_camera: Transform | None = None

    def __post_init__(self) -> None:
        frames = {T_camera_cloud.source for T_camera_cloud in self.T_camera_clouds.values()}
        frames |= set() if self.T_target_camera is None else {self.T_target_camera.target}
        if len(frames) > 1:
            raise GeometryError(f"places of one camera are in one frame, not in {sorted(frames)}")


@dataclass(frozen=True, slots=True, eq=False)
class PlacedImage:
    """One image after all that is done to it.

    Attributes:
        result: What the networks found, with places where other sensors tell.
        scans: By LiDAR stream, the scans of its moment.
    """

    result: ImageResult
    scans: Mapping[str, ScanResult]


class BoxPlacer:
    """Takes what sensors saw in log order, and gives each image with what tells its places.

    `place` then works on several of them at once. Scans count before depth images, which tell
    where no scan does.

    Args:
        places: By camera, where it is; boxes of other cameras get no place.
        largest_gap_ns: Largest difference of the stamps of an image and what places its boxes.

    Attributes:
        reach_ns: How far in time an image looks for that; None where no image does.
        dropped: Images without places, and depth images, that do not fit the lens, by reason.

    Raises:
        UsageError: If the difference is negative.
    """

    def __init__(self, places: Mapping[str, CameraPlace], largest_gap_ns: int) -> None:
        streams = dict.fromkeys(s for place in places.values() for s in place.T_camera_clouds)
        with_depth = [name for name, p in places.items() if p.T_target_camera is not None]
        self._places = places
        self._streams = frozenset(streams)
        self._matcher = ScanMatcher(list(streams), largest_gap_ns, depth_cameras=with_depth)
        self.reach_ns = largest_gap_ns if streams or with_depth else None
        self.dropped = Counter[str]()
        self._lock = threading.Lock()

    @property
    def unmatched(self) -> Counter[str]:
        """By camera, images without a scan or depth image near enough."""
        return self._matcher.unmatched

    def add_scan(self, scan: ScanResult) -> list[ImageMatch]:
        """Take a scan, and return the images that wait no longer."""
        stream = scan.detections.sensor
        return self._matcher.add_scan(stream, scan) if stream in self._streams else []

    def add_depth(self, camera: str, depth: CameraImage) -> list[ImageMatch]:
        """Take a depth image of a camera, and return the images that wait no longer."""
        return self._matcher.add_depth(camera, depth)

    def add_image(self, image: ImageResult) -> list[ImageMatch]:
        """Take an image, and return the images that wait no longer."""
        return self._matcher.add_image(image)

    def end(self) -> list[ImageMatch]:
        """Return the images that still wait at the end of the log."""
        return self._matcher.flush()

    def place(self, match: ImageMatch) -> PlacedImage:
        """Return an image with places for its boxes; several threads may call it at once."""
        image = replace(match.image, primary=primary_boxes(match.image.boxes))
        place = self._places.get(image.camera)
        if place is None or not self._fits(image, place.camera):
            return PlacedImage(image, {})
        scans = {s: scan for s, scan in match.scans.items() if s in place.T_camera_clouds}
        positions = {
            model: located
            for model, found in image.boxes.items()
            if (located := self._located(found, place, scans, match.depth)) is not None
        }
        return PlacedImage(replace(image, positions=positions), scans)

    def _fits(self, image: ImageResult, camera: Camera) -> bool:
        """Tell whether an image has the size that its lens is known for; count it if not."""
        if image.image is None or image.image.pixels.shape[1::-1] == camera.image_size:
            return True
        if image.boxes:  # an image that no network could judge is counted as such
            size, known = (
                f"{width}x{height}"
                for width, height in (image.image.pixels.shape[1::-1], camera.image_size)
            )
            self._drop(
                f"images of {image.camera} without places: they have {size} pixels, and the lens "
                f"is known for {known}"
            )
        return False

    def _drop(self, reason: str) -> None:
        with self._lock:
            self.dropped[reason] += 1

    def _located(
        self,
        found: Detections2D,
        place: CameraPlace,
        scans: Mapping[str, ScanResult],
        depth: CameraImage | None,
    ) -> Positions | None:
        by_scans = [
            locate_boxes(found, place.camera, place.T_camera_clouds[stream], scan)
            for stream, scan in scans.items()
        ]
        known = best_positions(by_scans) if by_scans else None
        if depth is None or place.T_target_camera is None:
            return known
        try:
            by_depth = locate_in_depth(found, place.camera, depth.pixels, place.T_target_camera)
        except GeometryError as error:
            self._drop(f"{depth.topic}: {error.what}")
            return known
        return by_depth if known is None else _filled(known, by_depth)


def _filled(known: Positions, others: Positions) -> Positions:
    """Return positions in which others stand where nothing is known."""
    lacking = np.array([not source for source in known.sources], dtype=np.bool_)
    return Positions(
        known.frame_id,
        np.where(lacking[:, None], others.points_m, known.points_m),
        np.where(lacking, others.range_m, known.range_m),
        tuple(a or b for a, b in zip(known.sources, others.sources, strict=True)),
        np.where(lacking, others.points, known.points),
    )
