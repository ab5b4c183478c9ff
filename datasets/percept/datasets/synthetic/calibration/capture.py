"""A synthetic calibration: a vehicle that stops at some places, where a board is shown to it."""

from __future__ import annotations

from collections.abc import Iterator
from heapq import merge
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.clock import NS_PER_MS, ns_from_seconds
from percept.core.errors import UsageError
from percept.core.rig import CameraSensor, Rig
from percept.core.samples import CameraImage, CameraInfo, Sample
from percept.core.settings import Settings
from percept.core.transform import Transform
from percept.datasets.synthetic.calibration.board import stand_mesh
from percept.datasets.synthetic.calibration.course import (
    MOVE_S,
    POSE_S,
    BoardHold,
    CalibrationStreet,
    StopAndGo,
    draw_course,
)
from percept.datasets.synthetic.calibration.poses import LidarView, draw_poses
from percept.datasets.synthetic.calibration.rig import wrong_rig
from percept.datasets.synthetic.drive import MAP_ORIGIN, START_NS
from percept.datasets.synthetic.lidar import LidarModel, LidarScan, cloud_of_scan, scan_world
from percept.datasets.synthetic.mesh import joined
from percept.datasets.synthetic.navigation import Navigation
from percept.datasets.synthetic.sensor_rig import (
    BASE,
    CAMERA_NAMES,
    make_cameras,
    make_lidars,
    make_rig,
)
from percept.datasets.synthetic.terrain import make_profile

__all__ = ["CalibrationConfig", "Capture"]

_REFERENCE = "lidar_top"
_FIRST_SCAN_NS, _SCAN_STEP_NS = 50 * NS_PER_MS, 200 * NS_PER_MS
_FIRST_IMAGE_NS, _IMAGE_STEP_NS, _IMAGE_DELAY_NS = (
    200 * NS_PER_MS,
    500 * NS_PER_MS,
    15 * NS_PER_MS,
)
_FARTHEST_M = {"cam_front": 5.5, "cam_rear": 5.5, "cam_left": 5.0, "cam_right": 5.0}
_IMAGE_NOISE_SD = 1.5


class CalibrationConfig(Settings):
    """What calibration log to make. The same settings give the same bytes of samples.

    Attributes:
        seed: Of the street, the rig's errors, the board's poses and the noise.
        stops: Places at which the vehicle stands.
        poses: Poses of the board that are shown to each camera, over all places.
        noise: 0 makes everything exact, 1 is an ordinary set of sensors.
        cameras: Which cameras are calibrated.
        image_size: (width, height) in pixels.
        beam_share: Share of each LiDAR's beams and firings; half of them keep the log small.
    """

    seed: int = Field(default=0, ge=0, lt=2**31)
    stops: int = Field(default=5, ge=1, le=20)
    poses: int = Field(default=32, ge=1, le=200)
    noise: float = Field(default=1.0, ge=0, le=10)
    cameras: tuple[str, ...] = ("cam_front",)
    image_size: tuple[int, int] = (1280, 800)
    beam_share: float = Field(default=0.5, gt=0, le=1)


class Capture:
    """All streams of one calibration log, made while they are read.

    Args:
        config: What to make.

    Attributes:
        street: The street with the board.
        motion: The exact motion of the vehicle.
        lidars: The LiDARs.
        cameras: The cameras.
        rig: The exact rig.
        start_rig: The wrong rig; the log's `tf_static` and `CameraInfo` say the same.
        holds: The poses of the board.
        duration_ns: Length.

    Raises:
        UsageError: If a camera's name is unknown, or there are fewer poses than stops.
    """

    def __init__(self, config: CalibrationConfig) -> None:
        if config.cameras and config.poses < config.stops:
            raise UsageError(
                f"{config.poses} poses of the board for {config.stops} stops",
                remedy="Show the board at least once at each stop",
            )
        self.config = config
        self.lidars: tuple[LidarModel, ...] = make_lidars(config.beam_share)
        self.cameras: tuple[CameraSensor, ...] = make_cameras(config.cameras, config.image_size)
        self.rig: Rig = make_rig(self.lidars, self.cameras)
        self.start_rig = wrong_rig(self.rig, _REFERENCE, np.random.default_rng([config.seed, 60]))
        profile = make_profile(np.random.default_rng([config.seed, 10**6]))
        # Each camera gets its poses, evenly over the places.
        shares = np.diff(np.linspace(0, config.poses, config.stops + 1).astype(int)).tolist()
        poses_at = tuple(share * len(self.cameras) for share in shares)
        course = draw_course(poses_at, np.random.default_rng([config.seed, 61]))
        self.motion = StopAndGo(profile, START_NS, course)
        self.duration_ns = ns_from_seconds(course.duration_s)
        self.holds = tuple(self._draw_holds(shares))
        self.street = CalibrationStreet(config.seed, profile, self.holds)

    def _draw_holds(self, shares: list[int]) -> Iterator[BoardHold]:
        """Yield the poses of the board in the order of time: place by place, camera by camera."""
        course = self.motion.course
        drawn = {}
        for number, camera in enumerate(self.cameras):
            T_map_cams = [
                self.camera_pose(camera, course.arrive_s[place])
                for place, share in enumerate(shares)
                for _ in range(share)
            ]
            rng = np.random.default_rng([self.config.seed, 62, number])
            farthest_m = _FARTHEST_M[camera.name]
            profile = self.motion.profile
            view = _lidar_view(self.lidars[0], camera)
            drawn[camera.name] = iter(
                draw_poses(camera.camera(), view, T_map_cams, profile, farthest_m, rng)
            )
        for place, share in enumerate(shares):
            starts = iter(course.shows_s(place, share * len(self.cameras)))
            for camera in self.cameras:
                for _ in range(share):
                    start_s = next(starts)
                    yield BoardHold(
                        camera.name, place, start_s + MOVE_S, start_s + POSE_S,
                        next(drawn[camera.name]),
                    )  # fmt: skip

    def camera_pose(self, camera: CameraSensor, time_s: float) -> Transform:
        """Return the exact pose of a camera at a time since the start."""
        T_map_base = Transform("map", BASE, self.motion.poses(np.array([time_s]))[0])
        return T_map_base @ (camera.T_base_sensor or Transform.identity(BASE, camera.frame))

    def scan(self, sensor: int, number: int) -> LidarScan:
        """Return one scan of one LiDAR with its truth; five of each are recorded a second."""
        model, config = self.lidars[sensor], self.config
        rng = np.random.default_rng([config.seed, 70 + sensor, number])
        stamp_ns = START_NS + _FIRST_SCAN_NS + number * _SCAN_STEP_NS + model.phase_ns
        return scan_world(model, self.street, self.motion, stamp_ns, config.noise, rng)

    def samples(self) -> Iterator[Sample]:
        """Yield all samples in the order of their log times."""
        navigation = Navigation(self.motion, MAP_ORIGIN, self.config.seed, self.config.noise)
        yield from navigation.static_transforms(self.start_rig)
        streams = [
            navigation.imu(self.duration_ns),
            navigation.odometry(self.duration_ns),
            navigation.gnss(self.duration_ns),
            *(self._clouds(i) for i in range(len(self.lidars))),
            *(self._images(camera) for camera in self.cameras),
        ]
        yield from merge(*streams, key=lambda sample: sample.log_time_ns)

    def _clouds(self, sensor: int) -> Iterator[Sample]:
        for number in range(self.duration_ns // _SCAN_STEP_NS):
            yield cloud_of_scan(self.scan(sensor, number), self.lidars[sensor].name)

    def _images(self, camera: CameraSensor) -> Iterator[Sample]:
        """Yield images while the board is shown to this camera, and before anything is shown."""
        start = self.start_rig.cameras()[camera.name].pinhole()
        for number in range((self.duration_ns - _FIRST_IMAGE_NS) // _IMAGE_STEP_NS + 1):
            since_ns = _FIRST_IMAGE_NS + number * _IMAGE_STEP_NS
            if self._shown_to(since_ns / 1e9) not in (None, camera.name):
                continue
            head: dict[str, Any] = {
                "stamp_ns": START_NS + since_ns,
                "log_time_ns": START_NS + since_ns + _IMAGE_DELAY_NS,
                "frame": camera.frame,
            }
            yield CameraInfo(
                topic=f"/{camera.name}/camera_info",
                image_size=camera.image_size,
                model="plumb_bob",
                K=start.K,
                distortion=start.distortion,
                **head,
            )
            pixels = self.image(camera, since_ns / 1e9)
            yield CameraImage(topic=camera.topic or "", pixels=pixels, encoding="jpeg", **head)

    def _shown_to(self, time_s: float) -> str | None:
        """Return the camera that the board is shown to, or carried for, at a time."""
        shown = (h for h in self.holds if h.start_s - MOVE_S <= time_s <= h.end_s)
        return next((hold.camera for hold in shown), None)

    def image(self, camera: CameraSensor, time_s: float) -> NDArray[np.uint8]:
        """Return what a camera sees (height, width, 3) BGR at a time since the start."""
        from percept.datasets.synthetic.render import RenderConfig, render_image
        from percept.datasets.synthetic.street_mesh import street_mesh

        config = self.config
        T_map_cam = self.camera_pose(camera, time_s)
        empty = CalibrationStreet(config.seed, self.street.profile)
        meshes = [street_mesh(empty, time_s, float(T_map_cam.translation_m[0]))]
        T_map_board = self.street.board(time_s)
        if T_map_board is not None:
            meshes.append(stand_mesh(T_map_board, self.street.profile))
        places = [config.seed, 80 + CAMERA_NAMES.index(camera.name), round(1e3 * time_s)]
        seed = int(np.random.default_rng(places).integers(2**31))
        light = RenderConfig(noise_sd=_IMAGE_NOISE_SD * config.noise, seed=seed)
        return render_image(joined(meshes), camera.pinhole(), T_map_cam.inverse(), light)


def _lidar_view(lidar: LidarModel, camera: CameraSensor) -> LidarView:
    T_base_cam = camera.T_base_sensor or Transform.identity(BASE, camera.frame)
    elevations = lidar.elevations_rad
    return LidarView(
        T_base_cam.inverse() @ lidar.T_base_sensor,
        float(elevations.min()),
        float(elevations.max()),
    )
