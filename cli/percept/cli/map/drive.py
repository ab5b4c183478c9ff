"""One log on the map: where the vehicle was, which cameras look at the road, what hides it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from percept.cli.detect.camera_part import CameraPart, plan_cameras
from percept.cli.detect.lidar_part import LidarPart, plan_lidars
from percept.cli.detect.models import open_models
from percept.cli.detect.request import DetectConfig
from percept.cli.detect.used_rig import camera_sensor
from percept.cli.map.on_map import poses_on_map
from percept.cli.map.validate_request import MapValidateConfig, MapValidateRequest
from percept.cli.odometry.found import FoundPoses
from percept.cli.odometry.sources import PoseFinder
from percept.cli.window import log_window_ns
from percept.core.errors import InputError
from percept.core.rig import CameraSensor, Rig
from percept.core.samples import PointCloud
from percept.core.trajectory import Trajectory
from percept.datasets.cameras import CameraStream, choose_cameras
from percept.datasets.recording import Recording
from percept.datasets.sensors import choose_lidars, read_static_transforms
from percept.detection.road_lines import RoadLineNetwork
from percept.hdmap import HdMap
from percept.hdmap.road_heights import RoadHeights
from percept.lanes import PaintConfig, flat_ground
from percept.lanes.birdseye import BirdsEye, BirdsEyeGrid
from percept.lanes.ground import GroundSurface

__all__ = ["DriveFacts", "MapDrive", "plan_drive"]

_LEAST_VIEW = 0.02  # of the road ahead; a camera that looks back shows none of it


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MapDrive:
    """What is settled of one log before its first image.

    Attributes:
        number: Of the drive, from 0.
        name: What people call it.
        recording: The log.
        poses: `T_map_base`.
        found: What the poses rest on.
        cameras: Cameras that look at the road, by topic, with lens and place.
        lidars: The LiDARs; None where the log has none of known place.
        networks: What finds traffic lights; None where they are not looked for.
        lane_network: What marks the paint of lines in images; None finds it by contrast.
        window_ns: First and last log time that are wanted.
        notes: What a user should know, as sentences.
    """

    number: int
    name: str
    recording: Recording
    poses: Trajectory
    found: FoundPoses
    cameras: dict[str, CameraSensor]
    lidars: LidarPart | None
    networks: CameraPart | None
    lane_network: RoadLineNetwork | None
    window_ns: tuple[int | None, int | None]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DriveFacts:
    """What is known of a drive when its log is closed again.

    Attributes:
        name: What people call it.
        bag: The log.
        files: Its files.
        poses: `T_map_base`.
        found: What the poses rest on.
        cameras: Cameras that looked at the road, by topic.
        grounds: The road as each look took it, by camera and time.
        notes: What a user should know, as sentences.
    """

    name: str
    bag: Path
    files: tuple[Path, ...]
    poses: Trajectory
    found: FoundPoses
    cameras: dict[str, CameraSensor]
    grounds: dict[tuple[str, int], GroundSurface]
    notes: tuple[str, ...]

    def position_m(self, stamp_ns: int) -> tuple[float, float]:
        """Return where the vehicle was in the map frame, level; infinitely far if not known."""
        pose = self.poses.at(stamp_ns)
        if pose is None:
            return math.inf, math.inf
        x, y, _ = pose.translation_m.tolist()
        return x, y


def plan_drive(
    recording: Recording,
    number: int,
    name: str,
    *,
    hd_map: HdMap,
    heights: RoadHeights,
    rig: Rig | None,
    config: MapValidateConfig,
    request: MapValidateRequest,
    check_interrupt: Callable[[], None],
) -> MapDrive:
    """Settle how a log is looked at.

    Args:
        recording: The log.
        number: Of the drive, from 0.
        name: What people call it.
        hd_map: The map.
        heights: Of its roads.
        rig: Lenses and places; None takes what the log says.
        config: Settings.
        request: What was asked for.
        check_interrupt: Raises `KeyboardInterrupt` if Ctrl-C was pressed.

    Raises:
        PerceptError: If nothing tells where the vehicle was in the map, or no camera of known lens
            and place looks at the road ahead.
    """
    window_ns = log_window_ns(recording, request.start_s, request.end_s)
    tree = read_static_transforms(recording)
    streams = choose_cameras(recording, rig, request.cameras, tree)
    cameras, notes = _usable(streams, config.paint, recording.paths[0])
    found = PoseFinder(
        recording,
        rig,
        config.odometry,
        source=request.poses,
        window_ns=window_ns,
        origin=None if hd_map.georeference is None else hd_map.georeference.frame,
        check_interrupt=check_interrupt,
    ).find()
    poses, pose_notes = poses_on_map(found, hd_map, heights, recording.paths[0])
    base = next(iter(cameras.values())).T_base_sensor
    if base is not None and poses.source != base.target:
        raise InputError(
            f"poses are of '{poses.source}', and cameras are placed in '{base.target}'",
            where=recording.paths[0],
            remedy="Give a --rig whose base_frame is that of the poses",
        )
    lidars, lidar_notes = _lidars(recording, rig, config, window_ns)
    return MapDrive(
        number=number,
        name=name,
        recording=recording,
        poses=poses,
        found=found,
        cameras=cameras,
        lidars=lidars,
        networks=_networks(recording, streams, cameras, config, request, window_ns),
        lane_network=None if request.lane_model is None else RoadLineNetwork(request.lane_model),
        window_ns=window_ns,
        notes=(
            *notes,
            *lidar_notes,
            *(f"Poses: {note.rstrip('.')}." for note in found.notes),
            *pose_notes,
        ),
    )


def _usable(
    streams: tuple[CameraStream, ...], config: PaintConfig, log: Path
) -> tuple[dict[str, CameraSensor], list[str]]:
    """Return the cameras that can look at the road, by topic, and what is said of others."""
    cameras: dict[str, CameraSensor] = {}
    lacking = []
    for stream in streams:
        sensor = camera_sensor(stream)
        why = _why_not(sensor, config)
        if sensor is None or why:
            lacking.append(f"{stream.name} is not looked at: {why}.")
        else:
            cameras[stream.topic] = sensor
    if not cameras:
        raise InputError(
            f"no camera can look at the road ({' '.join(lacking).rstrip('.')})",
            where=log,
            remedy="Give --rig with lens and place of a camera that looks ahead; `percept calib "
            "camera` and `percept calib camera-lidar` make one",
        )
    return cameras, lacking


def _why_not(sensor: CameraSensor | None, config: PaintConfig) -> str:
    """Return why a camera cannot look at the road ahead; empty where it can."""
    if sensor is None:
        return "its lens is not known"
    if sensor.T_base_sensor is None:
        return "its place on the vehicle is not known"
    view = BirdsEye(sensor, flat_ground(), BirdsEyeGrid.ahead_of(sensor, config))
    return "" if view.seen.mean() >= _LEAST_VIEW else "it shows none of the road ahead"


def _lidars(
    recording: Recording,
    rig: Rig | None,
    config: MapValidateConfig,
    window_ns: tuple[int | None, int | None],
) -> tuple[LidarPart | None, list[str]]:
    """Return the LiDARs in the base frame: they tell the shape of the road and what hides it."""
    without = "the road is taken as flat, and what stands on it does not hide it."
    if not any(t.sample_type is PointCloud and t.count for t in recording.topics()):
        return None, [f"The log has no LiDAR: {without}"]
    sensors = choose_lidars(recording, rig, {}, read_static_transforms(recording))
    placed = tuple(sensor for sensor in sensors if sensor.T_base_sensor is not None)
    if not placed:
        return None, [f"No LiDAR has a known place: {without}"]
    part = plan_lidars(
        recording,
        placed,
        wanted="merge" if len(placed) > 1 else "separate",
        config=config.lidar,
        window_ns=window_ns,
    )
    return part, []


def _networks(
    recording: Recording,
    streams: tuple[CameraStream, ...],
    cameras: dict[str, CameraSensor],
    config: MapValidateConfig,
    request: MapValidateRequest,
    window_ns: tuple[int | None, int | None],
) -> CameraPart | None:
    if not request.models:
        return None
    return plan_cameras(
        recording,
        [stream for stream in streams if stream.topic in cameras],
        open_models(request.models, DetectConfig(models=config.models)),
        undistort=False,
        window_ns=window_ns,
    )
