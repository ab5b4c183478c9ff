"""What is settled before the first scan or image: which halves run, on which sensors, and how."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from percept.cli.detect.lidar_part import LidarPart, plan_lidars
from percept.cli.detect.request import DetectConfig, DetectRequest
from percept.cli.track.maps import load_wanted_map
from percept.cli.window import log_window_ns
from percept.core.errors import UsageError
from percept.core.rig import Rig
from percept.core.samples import CameraImage, PointCloud
from percept.core.transform_tree import TransformTree
from percept.datasets.recording import Recording
from percept.datasets.sensors import choose_lidars, read_static_transforms, split_topics
from percept.hdmap import HdMap

if TYPE_CHECKING:  # the networks' runtime is not loaded where no network runs
    from percept.cli.detect.camera_part import CameraPart

__all__ = ["RunPlan", "plan_run"]

_GIVE_MODEL = "Give --model NAME=FILE.onnx, or --model small=builtin for the one that ships"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunPlan:
    """What is settled before the first scan or image.

    Attributes:
        config: Settings.
        lidars: The LiDAR half, or None.
        cameras: The camera half, or None.
        window_ns: First and last log time that are wanted; None is no limit.
        model_files: Files of the networks.
        map_file: The map's file, or None.
        rig: The rig that was given, or None.
        tree: The log's static transforms.
        hd_map: The map, or None.
        notes: What a user should know beforehand, as sentences.
    """

    config: DetectConfig
    lidars: LidarPart | None
    cameras: CameraPart | None
    window_ns: tuple[int | None, int | None]
    model_files: tuple[Path, ...]
    map_file: Path | None
    rig: Rig | None
    tree: TransformTree
    hd_map: HdMap | None
    notes: tuple[str, ...]

    def files(self, recording: Recording) -> tuple[Path, ...]:
        """Return all files that the run rests on: the log, networks, the map."""
        maps = () if self.map_file is None else (self.map_file,)
        return (*recording.paths, *self.model_files, *maps)

    @property
    def all_notes(self) -> list[str]:
        """What a user should know of sensors and networks, as sentences."""
        return [*self.notes, *(self.cameras.notes if self.cameras is not None else ())]

    @property
    def expected(self) -> int:
        """Scans and images that will come, about."""
        scans = 0 if self.lidars is None else self.lidars.scans_expected
        return scans + (0 if self.cameras is None else self.cameras.messages_in_log)


def plan_run(
    recording: Recording, rig: Rig | None, config: DetectConfig, request: DetectRequest
) -> RunPlan:
    """Settle which halves run, on which sensors, and how.

    Raises:
        PerceptError: If the log, a network or a setting cannot be used.
    """
    _check_halves(request)
    hd_map = load_wanted_map(request.map_file, request.origin)
    topics = _Topics.of(recording, request)
    if not request.models:
        _check_without_models(recording, request, topics)
    window_ns = log_window_ns(recording, request.start_s, request.end_s)
    tree = read_static_transforms(recording)
    # Cameras first: what is wrong with a network is said before the first scan is read.
    cameras = (
        _plan_cameras(recording, rig, config, request, topics, tree) if request.models else None
    )
    lidars = None
    if not request.camera_only and (topics.have_clouds or topics.lidars or cameras is None):
        lidars = plan_lidars(
            recording,
            choose_lidars(recording, rig, topics.lidars, tree),
            wanted=config.lidars,
            config=config.lidar,
            window_ns=window_ns,
        )
    unseen = topics.have_images and cameras is None and not request.lidar_only
    return RunPlan(
        config=config,
        lidars=lidars,
        cameras=cameras,
        window_ns=window_ns,
        model_files=tuple(model.path for model in request.models),
        map_file=request.map_file,
        rig=rig,
        tree=tree,
        hd_map=hd_map,
        notes=(f"No camera was looked at. {_GIVE_MODEL}.",) if unseen else (),
    )


@dataclass(frozen=True, slots=True)
class _Topics:
    """What a log has, and what was asked for by `--topic`."""

    have_images: bool
    have_clouds: bool
    cameras: Mapping[str, str]
    lidars: Mapping[str, str]

    @classmethod
    def of(cls, recording: Recording, request: DetectRequest) -> _Topics:
        kinds = {topic.sample_type for topic in recording.topics() if topic.count}
        lidars, cameras = split_topics(recording, request.topics)
        # A half that does not run takes no topics: the other one says that it cannot use them.
        if request.lidar_only:
            lidars, cameras = dict(request.topics), {}
        if request.camera_only:
            lidars, cameras = {}, dict(request.topics)
        return cls(CameraImage in kinds, PointCloud in kinds, cameras, lidars)


def _plan_cameras(
    recording: Recording,
    rig: Rig | None,
    config: DetectConfig,
    request: DetectRequest,
    topics: _Topics,
    tree: TransformTree,
) -> CameraPart:
    from percept.cli.detect.camera_part import plan_cameras
    from percept.cli.detect.models import open_models
    from percept.datasets.cameras import choose_cameras

    return plan_cameras(
        recording,
        choose_cameras(recording, rig, topics.cameras, tree),
        open_models(request.models, config),
        undistort=config.camera.undistort,
        window_ns=log_window_ns(recording, request.start_s, request.end_s),
    )


def _check_halves(request: DetectRequest) -> None:
    if not request.track:
        unused = {"--map": request.map_file is not None, "--poses": request.poses != "auto"}
        for option in (option for option, given in unused.items() if given):
            raise UsageError(f"--no-track makes no use of {option}", remedy="Leave one of them out")
    if request.camera_only and request.map_file is None and request.poses != "auto":
        raise UsageError(
            "--camera-only makes use of --poses for the lights of a map alone",
            remedy="Give --map too, or leave --poses out",
        )
    if request.lidar_only and request.camera_only:
        raise UsageError("--lidar-only and --camera-only leave nothing to look at")
    if request.lidar_only and request.models:
        raise UsageError(
            "--lidar-only leaves no camera for --model", remedy="Leave one of them out"
        )
    if request.camera_only and not request.models:
        raise UsageError("--camera-only without a network finds nothing", remedy=_GIVE_MODEL)


def _check_without_models(recording: Recording, request: DetectRequest, topics: _Topics) -> None:
    if request.lidar_only:
        return
    if topics.cameras:
        raise UsageError(
            f"--topic names camera {next(iter(topics.cameras.values()))}, but there is no network",
            remedy=_GIVE_MODEL,
        )
    if topics.have_images and not topics.have_clouds:
        raise UsageError(
            "the log has images but no point clouds, and no network is given to look at them",
            where=recording.paths[0],
            remedy=_GIVE_MODEL,
        )
