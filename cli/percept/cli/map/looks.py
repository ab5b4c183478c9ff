"""The looks at the road in a log: images a few metres apart, with the scan nearest to each.

The calling thread reads the log; workers decode images, find what hides the road, and the paint.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from threading import Lock

from percept.cli.detect.lidar_part import LidarPart
from percept.cli.detect.lidar_streams import ScanFeed
from percept.cli.map.drive import MapDrive
from percept.cli.map.validate_request import MapValidateConfig
from percept.core.errors import DecodeError
from percept.core.lane_markings import PaintObservation
from percept.core.results import Detections2D, Detections3D
from percept.core.rig import CameraSensor
from percept.core.samples import CameraImage, PointCloud
from percept.core.transform import Transform
from percept.datasets.recording import UndecodedMessage
from percept.detection.cores import available_cores
from percept.detection.runner import ImageJob, ordered_map
from percept.export.canvas import Image, as_bgr
from percept.lanes import ground_from_image, ground_from_points, observe_paint
from percept.lanes.ground import GroundSurface
from percept.lanes.sweeps import RoadSweep, road_sweep
from percept.lidar.result import ScanResult

__all__ = ["Looked", "looks_of"]

_OLDEST_SCAN_NS = 300_000_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Looked:
    """One look.

    Attributes:
        camera: The camera.
        stamp_ns: Time of the image.
        T_map_base: Where the vehicle was.
        paint: What was seen of the road; None where the image could not be used.
        image: The image; None where it could not be used.
        boxes: What the networks found, by their names.
        hiding: What may hide something, in the vehicle's frame; None without a scan.
        ground: The road as it was taken; None where the image could not be used.
        sweep: What the last scan shows of the road, where its paint is looked for.
        failure: Why the image could not be used, or empty.
    """

    camera: CameraSensor
    stamp_ns: int
    T_map_base: Transform
    paint: PaintObservation | None = None
    image: CameraImage | None = None
    boxes: dict[str, Detections2D] = field(default_factory=dict)
    hiding: Detections3D | None = None
    ground: GroundSurface | None = None
    sweep: RoadSweep | None = None
    failure: str = ""

    def distance_to(self, other: Looked) -> float:
        """Return how far the vehicle was from where it was at another look, metres."""
        away = self.T_map_base.translation_m - other.T_map_base.translation_m
        return math.sqrt(float(away @ away))


def looks_of(drive: MapDrive, config: MapValidateConfig, dropped: Counter[str]) -> Iterator[Looked]:
    """Yield the looks of a drive in the order of the log.

    Args:
        drive: The drive.
        config: Settings.
        dropped: Takes the images that have no pose, by reason.
    """
    chooser = _Chooser(drive, config, dropped)
    return ordered_map(_done, chooser.jobs(), workers=available_cores())


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    drive: MapDrive
    config: MapValidateConfig
    camera: CameraSensor
    message: UndecodedMessage
    number: int
    T_map_base: Transform
    scan: _Scan | None


class _Scan:
    """Scans that belong together. Looks of several cameras share what is found in them."""

    def __init__(self, lidars: LidarPart, stream: str, scans: tuple[PointCloud, ...]) -> None:
        self._lidars = lidars
        self._stream = stream
        self._scans = scans
        self._lock = Lock()
        self._result: ScanResult | None = None

    def result(self) -> ScanResult | None:
        """Return what stands there, found once; None if the stream never had a point."""
        with self._lock:
            if self._result is None and self._stream in self._lidars.detectors:
                self._result = self._lidars.detect(self._stream, self._scans)
            return self._result


class _Chooser:
    """Chooses images as far apart as the settings say, and gives each the last whole scan."""

    def __init__(self, drive: MapDrive, config: MapValidateConfig, dropped: Counter[str]) -> None:
        self._drive = drive
        self._config = config
        self._dropped = dropped
        self._feed = None if drive.lidars is None else ScanFeed(drive.lidars.streams)
        self._latest: _Scan | None = None
        self._last: dict[str, Transform] = {}
        self._to_go_m: dict[str, float] = {}
        self._number = 0

    def jobs(self) -> Iterator[_Job]:
        drive = self._drive
        lidars = drive.lidars
        topics = [*drive.cameras, *(() if lidars is None else lidars.streams.topics)]
        start_ns, end_ns = drive.window_ns
        for message in drive.recording.undecoded(topics=topics, start_ns=start_ns, end_ns=end_ns):
            if message.topic in drive.cameras:
                yield from self._image(message)
            elif lidars is not None:
                self._scan(message, lidars)

    def _scan(self, message: UndecodedMessage, lidars: LidarPart) -> None:
        try:
            samples = message.decode()
        except DecodeError:
            return  # the recording counts and names it
        for scan in samples:
            if isinstance(scan, PointCloud) and self._feed is not None:
                for stream, scans in self._feed.push(scan):
                    self._latest = _Scan(lidars, stream, scans)

    def _image(self, message: UndecodedMessage) -> Iterator[_Job]:
        stamp_ns = _stamp_of(message)
        T_map_base = self._drive.poses.at(stamp_ns)
        if T_map_base is None:
            self._dropped["images without a pose of their time"] += 1
            return
        if not self._is_due(message.topic, T_map_base):
            return
        camera = self._drive.cameras[message.topic]
        yield _Job(
            self._drive, self._config, camera, message, self._number, T_map_base, self._latest
        )
        self._number += 1

    def _is_due(self, topic: str, now: Transform) -> bool:
        """Return whether the vehicle has gone far enough for the next look of a camera.

        What an image came late is taken off the way to the next, so that looks are so far
        apart in the mean whatever the rate of the camera.
        """
        last = self._last.get(topic)
        self._last[topic] = now
        if last is None:
            self._to_go_m[topic] = self._config.spacing_m
            return True
        step = now.translation_m - last.translation_m
        self._to_go_m[topic] -= math.sqrt(float(step @ step))
        if self._to_go_m[topic] > 0:
            return False
        spacing_m = self._config.spacing_m
        self._to_go_m[topic] = max(self._to_go_m[topic] + spacing_m, 0.1 * spacing_m)
        return True


def _done(job: _Job) -> Looked:
    stamp_ns = _stamp_of(job.message)
    look = partial(Looked, camera=job.camera, stamp_ns=stamp_ns, T_map_base=job.T_map_base)
    try:
        image, boxes = _image_and_boxes(job)
    except DecodeError:  # the recording counts and names it
        return look(failure="images that cannot be decoded")
    height, width = image.pixels.shape[:2]
    if (width, height) != job.camera.image_size:
        lens = "{}x{}".format(*job.camera.image_size)
        return look(failure=f"images of {width}x{height} pixels for a lens of {lens}")
    pixels = as_bgr(image.pixels)
    ground, hiding, sweep = _road(job, pixels, stamp_ns)
    paint = observe_paint(
        pixels,
        job.camera,
        stamp_ns=stamp_ns,
        ground=ground,
        occluders=() if hiding is None else hiding.boxes_m,
        config=job.config.paint,
        paint_mask=None if job.drive.lane_network is None else job.drive.lane_network.mask,
    )
    return look(
        paint=paint,
        image=image,
        boxes=boxes,
        hiding=hiding,
        ground=ground,
        sweep=sweep,
    )


def _stamp_of(message: UndecodedMessage) -> int:
    return message.log_time_ns if message.stamp_ns is None else message.stamp_ns


def _image_and_boxes(job: _Job) -> tuple[CameraImage, dict[str, Detections2D]]:
    """Return the image of a look, and what the networks find in it.

    Raises:
        DecodeError: If the image cannot be decoded.
    """
    networks = job.drive.networks
    if networks is None:
        return _image_in(job.message), {}
    result = networks.detect(
        ImageJob(
            frame=job.number,
            camera=job.camera.name,
            stamp_ns=job.message.stamp_ns,
            log_time_ns=job.message.log_time_ns,
            models=tuple(model.name for model in networks.models),
            load=partial(_image_in, job.message),
        )
    )
    if result.image is None:
        raise DecodeError(result.failure or "no image", where=job.message.topic)
    return result.image, dict(result.boxes)


def _image_in(message: UndecodedMessage) -> CameraImage:
    for sample in message.decode():
        if isinstance(sample, CameraImage):
            return sample
    raise DecodeError("the message holds no image", where=message.topic)


def _road(
    job: _Job, pixels: Image, stamp_ns: int
) -> tuple[GroundSurface, Detections3D | None, RoadSweep | None]:
    """Return the shape of the road at the time of an image, what may hide it, and its points.

    All come from the last scan before the image, and the vehicle has moved on since. Without a
    scan the shape is that at which the lines in the image are parallel.
    """
    result = None if job.scan is None else job.scan.result()
    if result is not None and abs(stamp_ns - result.detections.stamp_ns) <= _OLDEST_SCAN_NS:
        T_map_then = job.drive.poses.at(result.detections.stamp_ns)
        if T_map_then is not None:
            T_now_then = job.T_map_base.inverse() @ T_map_then
            points = T_now_then.apply(result.cloud.points_xyz)
            ground, hiding = ground_from_points(points), result.detections.transformed(T_now_then)
            intensity = result.cloud.intensity
            if not job.config.lidar_paint or intensity is None or ground.source != "points":
                return ground, hiding, None
            sweep = road_sweep(
                points,
                intensity,
                ground=ground,
                boxes_m=hiding.boxes_m,
                T_map_base=job.T_map_base,
            )
            return ground, hiding, sweep
    return ground_from_image(pixels, job.camera, job.config.paint), None, None
