"""A drive through the synthetic street: a log, a map, a rig, and the truth beside them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from heapq import merge
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.clock import NS_PER_MS, ns_from_seconds
from percept.core.errors import UsageError
from percept.core.geodesy import LocalFrame
from percept.core.rig import CameraSensor, Rig, rig_as_yaml
from percept.core.samples import CameraImage, CameraInfo, Sample
from percept.core.settings import Settings
from percept.core.transform import Transform
from percept.datasets.synthetic.ego import EGO_SPEED_MPS, EGO_START_X_M, EgoMotion
from percept.datasets.synthetic.lanelet_map import StreetMap, make_map, write_map
from percept.datasets.synthetic.layout import BLOCK_M
from percept.datasets.synthetic.lidar import (
    SCAN_PERIOD_NS,
    LidarModel,
    LidarScan,
    cloud_of_scan,
    scan_world,
)
from percept.datasets.synthetic.map_changes import (
    MapChange,
    plan_changes,
    plant_changes,
    write_changes,
)
from percept.datasets.synthetic.map_sight import DriveSight
from percept.datasets.synthetic.navigation import Navigation
from percept.datasets.synthetic.sensor_rig import (
    BASE,
    CAMERA_NAMES,
    make_cameras,
    make_lidars,
    make_rig,
)
from percept.datasets.synthetic.truth import (
    BOX_COLUMNS,
    IMAGE_COLUMNS,
    LIGHT_COLUMNS,
    OBJECT_COLUMNS,
    TableStream,
    box_rows,
    light_rows,
    object_rows,
    write_markings,
    write_poses,
)
from percept.datasets.synthetic.world import World

if TYPE_CHECKING:
    from percept.datasets.synthetic.visible import VisibleBoxes
    from percept.datasets.write import LogFormat

__all__ = ["MAP_ORIGIN", "START_NS", "Drive", "DriveConfig", "DriveSummary", "generate_drive"]

START_NS = 1_760_000_000_000_000_000
"""Stamp of the first moment of every drive."""

MAP_ORIGIN = LocalFrame(43.7822, -79.4661, 160.0)
"""Where the map frame's origin lies: latitude, longitude, altitude over the ellipsoid."""

_LOG_NAMES = {"mcap": "drive.mcap", "rosbag1": "drive.bag", "rosbag2": "drive"}
_FIRST_SCAN_NS = SCAN_PERIOD_NS // 2
_CAMERA_DELAY_NS = 15 * NS_PER_MS
_CAMERA_PERIOD_NS = 100 * NS_PER_MS
_CAMERA_PHASES_NS = {"cam_front": 50, "cam_left": 70, "cam_right": 30, "cam_rear": 100}
_POSE_STEP_NS = 5 * NS_PER_MS
_MAP_MARGIN_M = 240.0
_IMAGE_NOISE_SD = 1.5

Progress = Callable[[float], None]
OnScan = Callable[[int, int, LidarScan], None]
OnImage = Callable[[str, int, "VisibleBoxes"], None]


class DriveConfig(Settings):
    """What drive to make. The same settings give the same bytes of samples.

    Attributes:
        seed: Of the world and of the noise.
        seconds: Length; ten scans of every LiDAR a second.
        noise: 0 makes everything exact, 1 is an ordinary set of sensors.
        cameras: Which cameras are rendered; none makes the drive several times faster.
        image_size: (width, height) in pixels.
        beam_share: Share of each LiDAR's beams and firings, for small drives in tests.
        map_changes: How many changes are planted into the map; the road stays as it is.
    """

    seed: int = Field(default=0, ge=0, lt=2**31)
    seconds: float = Field(default=3.0, gt=0, le=3600)
    noise: float = Field(default=1.0, ge=0, le=10)
    cameras: tuple[str, ...] = ("cam_front",)
    image_size: tuple[int, int] = (640, 400)
    beam_share: float = Field(default=1.0, gt=0, le=1)
    map_changes: int = Field(default=0, ge=0, le=10_000)


@dataclass(frozen=True, slots=True)
class DriveSummary:
    """What was written.

    Attributes:
        log: The log.
        counts: Messages by topic.
    """

    log: Path
    counts: dict[str, int]


class Drive:
    """All streams of one drive, made while they are read.

    Args:
        config: What drive to make.

    Attributes:
        world: The street.
        ego: The exact motion of the vehicle.
        lidars: The LiDARs.
        cameras: The cameras that are rendered.
        duration_ns: Length.
        rig: The exact rig of both.
        scans: Number of scans of every LiDAR.

    Raises:
        UsageError: If a camera's name is unknown or the drive is too short for a scan.
    """

    def __init__(self, config: DriveConfig) -> None:
        self.config = config
        self.world = World.from_seed(config.seed)
        self.ego = EgoMotion(self.world.profile, START_NS)
        self.lidars: tuple[LidarModel, ...] = make_lidars(config.beam_share)
        self.cameras: tuple[CameraSensor, ...] = make_cameras(config.cameras, config.image_size)
        self.rig: Rig = make_rig(self.lidars, self.cameras)
        self.duration_ns = ns_from_seconds(config.seconds)
        self.scans = self.duration_ns // SCAN_PERIOD_NS
        if not self.scans:
            raise UsageError("too short for one scan", where=f"--seconds {config.seconds:g}")

    def scan_stamp_ns(self, model: LidarModel, number: int) -> int:
        """Return the stamp of a scan: when the sensor faces its +x."""
        return START_NS + _FIRST_SCAN_NS + number * SCAN_PERIOD_NS + model.phase_ns

    def image_stamp_ns(self, camera: CameraSensor, number: int) -> int:
        """Return the stamp of an image."""
        phase_ns = _CAMERA_PHASES_NS[camera.name] * NS_PER_MS
        return START_NS + phase_ns + number * _CAMERA_PERIOD_NS

    def scan(self, sensor: int, number: int) -> LidarScan:
        """Return one scan of one LiDAR with its truth."""
        model, config = self.lidars[sensor], self.config
        rng = np.random.default_rng([config.seed, 20 + sensor, number])
        stamp_ns = self.scan_stamp_ns(model, number)
        return scan_world(model, self.world, self.ego, stamp_ns, config.noise, rng)

    def samples(
        self, on_scan: OnScan | None = None, on_image: OnImage | None = None
    ) -> Iterator[Sample]:
        """Yield all samples in the order of their log times.

        Args:
            on_scan: Called with sensor number, scan number and scan as each scan is made.
            on_image: Called with camera, stamp and what is seen as each image is made.
        """
        navigation = Navigation(self.ego, MAP_ORIGIN, self.config.seed, self.config.noise)
        yield from navigation.static_transforms(self.rig)
        streams = [
            navigation.imu(self.duration_ns),
            navigation.odometry(self.duration_ns),
            navigation.gnss(self.duration_ns),
            *(self._clouds(i, on_scan) for i in range(len(self.lidars))),
            *(self._images(camera, on_image) for camera in self.cameras),
        ]
        yield from merge(*streams, key=lambda sample: sample.log_time_ns)

    def _clouds(self, sensor: int, on_scan: OnScan | None) -> Iterator[Sample]:
        name = self.lidars[sensor].name
        for number in range(self.scans):
            scan = self.scan(sensor, number)
            if on_scan is not None:
                on_scan(sensor, number, scan)
            yield cloud_of_scan(scan, name)

    def _images(self, camera: CameraSensor, on_image: OnImage | None) -> Iterator[Sample]:
        pinhole = camera.pinhole()
        for number in range(self.scans):
            stamp_ns = self.image_stamp_ns(camera, number)
            head: dict[str, Any] = {
                "stamp_ns": stamp_ns,
                "log_time_ns": stamp_ns + _CAMERA_DELAY_NS,
                "frame": camera.frame,
            }
            yield CameraInfo(
                topic=f"/{camera.name}/camera_info",
                image_size=camera.image_size,
                model="plumb_bob",
                K=pinhole.K,
                distortion=pinhole.distortion,
                **head,
            )
            pixels, boxes = self.picture(camera, number)
            if on_image is not None:
                on_image(camera.name, stamp_ns, boxes)
            yield CameraImage(topic=camera.topic or "", pixels=pixels, encoding="jpeg", **head)

    def picture(self, camera: CameraSensor, number: int) -> tuple[NDArray[np.uint8], VisibleBoxes]:
        """Return one image of one camera, (height, width, 3) uint8 BGR, and what it shows."""
        from percept.datasets.synthetic.render import RenderConfig
        from percept.datasets.synthetic.visible import picture_with_boxes

        config = self.config
        time_s = float(self.ego.seconds(self.image_stamp_ns(camera, number)))
        T_map_base = Transform("map", BASE, self.ego.poses(np.array([time_s]))[0])
        T_base_cam = camera.T_base_sensor or Transform.identity(BASE, camera.frame)
        light = RenderConfig.model_validate(
            {"noise_sd": _IMAGE_NOISE_SD * config.noise, "seed": self._image_seed(camera, number)}
        )
        T_cam_map = (T_map_base @ T_base_cam).inverse()
        x_m = float(T_map_base.translation_m[0])
        return picture_with_boxes(self.world, camera.pinhole(), T_cam_map, time_s, x_m, light)

    def _image_seed(self, camera: CameraSensor, number: int) -> int:
        """Return a seed of its own for every image of every camera."""
        places = [self.config.seed, 40 + CAMERA_NAMES.index(camera.name), number]
        return int(np.random.default_rng(places).integers(2**31))


def generate_drive(
    config: DriveConfig, out: Path, log_format: LogFormat = "mcap", progress: Progress | None = None
) -> DriveSummary:
    """Write a drive: the log, `rig.yaml`, `map.osm`, and `truth/` with tables and the exact rig.

    `truth/map_changes.json` lists what was changed in the map, `truth/markings.geojson` the paint
    of the road.

    Memory does not grow with the length of the drive. Images are written as JPEG.

    Args:
        config: What drive to make.
        out: Folder, which is made where it does not exist.
        log_format: Format of the log: `drive.mcap`, `drive.bag`, or the folder `drive`.
        progress: Called with the share that is done, from 0 to 1.

    Raises:
        UsageError: If a setting is out of range, or the drive has no place for all changes.
    """
    from percept.datasets.write import LogWriter

    drive = Drive(config)
    road, street, changes = _maps_of_road(drive)
    truth = out / "truth"
    truth.mkdir(parents=True, exist_ok=True)
    for folder in (out, truth):
        (folder / "rig.yaml").write_text(rig_as_yaml(drive.rig), encoding="utf-8")
    write_map(street, out / "map.osm")
    write_markings(road, truth / "markings.geojson")
    write_changes(changes, truth / "map_changes.json")
    _write_poses(drive, truth / "poses.parquet")
    log = out / _LOG_NAMES[log_format]
    counts: Counter[str] = Counter()
    with (
        LogWriter(log, log_format, images="jpeg") as writer,
        TableStream(truth / "objects.parquet", OBJECT_COLUMNS) as objects,
        TableStream(truth / "lights.parquet", LIGHT_COLUMNS) as lights,
        TableStream(truth / "boxes_2d.parquet", BOX_COLUMNS) as boxes,
        TableStream(truth / "images_2d.parquet", IMAGE_COLUMNS) as images,
    ):
        ledger = _TruthLedger(drive, objects, lights)

        def on_image(camera: str, stamp_ns: int, seen: VisibleBoxes) -> None:
            images.write([{"stamp_ns": stamp_ns, "camera": camera}])
            boxes.write(box_rows(camera, stamp_ns, seen))

        for sample in drive.samples(ledger.add, on_image):
            writer.write(sample)
            counts[sample.topic] += 1
            if progress is not None:
                done = (sample.log_time_ns - START_NS) / drive.duration_ns
                progress(min(done, 1.0))
    return DriveSummary(log, dict(counts))


class _TruthLedger:
    """Counts the returns of all LiDARs in a scan, then writes that scan's truth."""

    def __init__(self, drive: Drive, objects: TableStream, lights: TableStream) -> None:
        self._drive = drive
        self._objects = objects
        self._lights = lights
        self._open: dict[int, tuple[int, Counter[int]]] = {}

    def add(self, _sensor: int, number: int, scan: LidarScan) -> None:
        drive = self._drive
        done, points = self._open.pop(number, (0, Counter()))
        ids, counts = np.unique(scan.object_ids, return_counts=True)
        points.update(dict(zip(ids.tolist(), counts.tolist(), strict=True)))
        if done + 1 < len(drive.lidars):
            self._open[number] = (done + 1, points)
            return
        stamp_ns = drive.scan_stamp_ns(drive.lidars[0], number)
        self._objects.write(object_rows(drive.world, drive.ego, stamp_ns, points))
        self._lights.write(light_rows(drive.world, drive.ego, stamp_ns, drive.cameras))


def _maps_of_road(drive: Drive) -> tuple[StreetMap, StreetMap, list[MapChange]]:
    """Return the road as it is, its map as it is written, and how the two differ."""
    config = drive.config
    blocks = _map_blocks(config.seconds)
    road = make_map(drive.world, MAP_ORIGIN, blocks)
    if not config.map_changes:
        return road, road, []
    camera = make_cameras(CAMERA_NAMES[:1], config.image_size)[0]
    sight = DriveSight(drive.world, drive.ego, camera, config.seconds)
    sites = plan_changes(sight, _map_blocks, config.map_changes)
    street = make_map(drive.world, MAP_ORIGIN, blocks)
    return road, street, plant_changes(street, sight, sites, config.seed)


def _map_blocks(seconds: float) -> range:
    """Return the blocks that the map of a drive holds."""
    end_m = EGO_START_X_M + EGO_SPEED_MPS * seconds
    first = int(np.floor((EGO_START_X_M - _MAP_MARGIN_M) / BLOCK_M))
    return range(first, int(np.ceil((end_m + _MAP_MARGIN_M) / BLOCK_M)))


def _write_poses(drive: Drive, path: Path) -> None:
    until_ns = START_NS + drive.duration_ns + SCAN_PERIOD_NS
    stamps = np.arange(START_NS, until_ns, _POSE_STEP_NS, dtype=np.int64)
    write_poses(drive.ego.trajectory(stamps), path)
