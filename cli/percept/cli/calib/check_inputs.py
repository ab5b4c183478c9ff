"""The data of `percept calib check`: clouds of the rig's LiDARs, and pairs that show a board."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from percept.calib.board_in_cloud.find import BoardInCloudConfig
from percept.calib.check.check import CameraBoards
from percept.cli.calib.board_pairs import board_and_plate, find_board_pairs
from percept.cli.calib.camera_lidar_inputs import (
    PairInputs,
    Shot,
    listed_pairs,
    shots_from_bags,
    shots_from_files,
)
from percept.cli.calib.lidar_inputs import LidarInputs, clouds_from_bags, clouds_from_files
from percept.cli.progress import progress_bar
from percept.core.errors import UsageError
from percept.core.rig import CameraSensor, LidarSensor, Rig

__all__ = ["CheckInputs", "CheckSources", "read_inputs"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckSources:
    """Which data the command line named; see the options of `percept calib check`."""

    bags: tuple[Path, ...]
    topics: Mapping[str, str]
    clouds: tuple[str, ...]
    pairs: tuple[str, ...]
    table: Path | None
    board: str | None
    board_size: str | None
    camera: str | None
    lidar: str | None
    start_s: float | None
    end_s: float | None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CheckInputs:
    """What there is to check with.

    Attributes:
        scenes: Points (N, 3) by LiDAR, scene by scene; only LiDARs that the rig places.
        boards: Pairs that show a board, or None.
        shots: The images and clouds of these pairs.
        files: What was read.
        notes: What a user should know.
        not_checked: Sensors that there is no data of, and why.
        dropped: What was left out, by reason.
    """

    scenes: tuple[dict[str, Any], ...]
    boards: CameraBoards | None
    shots: tuple[Shot, ...]
    files: tuple[Path, ...]
    notes: tuple[str, ...]
    not_checked: Mapping[str, str] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)


def read_inputs(sources: CheckSources, rig: Rig, config: BoardInCloudConfig) -> CheckInputs:
    """Read the clouds, and find the board in the pairs.

    Raises:
        PerceptError: If options do not go together, or the data cannot be used.
    """
    _check_sources(sources)
    placed = {n for n, s in rig.sensors.items() if s.T_base_sensor is not None}
    clouds = _clouds(sources, rig)
    scenes = tuple({n: p for n, p in scene.items() if n in placed} for scene in clouds.scenes)
    files, notes, dropped = [*clouds.files], [*clouds.notes], dict(clouds.dropped or {})
    boards, shots = None, PairInputs((), ())
    if sources.board is not None:
        boards, shots = _boards(sources, rig, config)
        files += [path for path in shots.files if path not in files]
        notes += shots.notes
        for reason, count in (shots.dropped or {}).items():
            dropped[reason] = max(dropped.get(reason, 0), count)
    named = {name for scene in clouds.scenes for name in scene}
    seen = {name for scene in scenes for name in scene}
    if boards is not None:
        seen |= {boards.camera, boards.lidar}
    return CheckInputs(
        scenes=scenes,
        boards=boards,
        shots=shots.shots,
        files=tuple(files),
        notes=tuple(notes),
        not_checked=_not_checked(rig, placed, named, seen),
        dropped=dropped,
    )


def _not_checked(rig: Rig, placed: set[str], named: set[str], seen: set[str]) -> dict[str, str]:
    reasons = {}
    for name in dict.fromkeys((*rig.sensors, *sorted(named))):
        if name in seen:
            continue
        if name not in placed:
            reasons[name] = "the rig does not say where it sits"
        elif name in rig.cameras():
            reasons[name] = "no board was given for it (--board, --camera)"
        else:
            reasons[name] = "the data have no points of it"
    return reasons


def _check_sources(sources: CheckSources) -> None:
    listed = bool(sources.pairs) or sources.table is not None
    files = listed or bool(sources.clouds)
    if files == bool(sources.bags):
        raise UsageError(
            "one of --bag, --cloud, --pair and --pairs is needed, and --bag goes with none of them",
            remedy="Give --bag LOG, or --cloud NAME=PATH for every LiDAR and scene",
        )
    window = sources.start_s is not None or sources.end_s is not None
    if files and (sources.topics or window):
        raise UsageError("--topic, --start and --end go with --bag", remedy="Leave them out")
    if listed and sources.board is None:
        raise UsageError(
            "--pair and --pairs need the board that they show",
            remedy="Give --board, such as checkerboard:7x5:0.095",
        )
    if sources.clouds and not listed and sources.board is not None:
        raise UsageError("--board needs images", remedy="Give --pair IMAGE=CLOUD or --bag LOG")
    if sources.board is None and (sources.board_size or sources.camera or sources.lidar):
        raise UsageError("--board-size, --camera and --lidar go with --board")


def _clouds(sources: CheckSources, rig: Rig) -> LidarInputs:
    if sources.clouds:
        return clouds_from_files(sources.clouds, rig)
    if not sources.bags:
        return LidarInputs((), {}, ())
    with progress_bar("reading the LiDARs", 1.0) as advance:
        window_s = sources.start_s, sources.end_s
        return clouds_from_bags(sources.bags, sources.topics, rig, window_s, advance)


def _boards(
    sources: CheckSources, rig: Rig, config: BoardInCloudConfig
) -> tuple[CameraBoards, PairInputs]:
    board, plate_size_m = board_and_plate(sources.board or "", sources.board_size)
    camera = _camera(rig, sources.camera)
    lidar = _lidar(rig, sources.lidar)
    with progress_bar("reading the pairs", 1.0) as advance:
        if sources.bags:
            topics = camera.topic, sources.topics.get(lidar.name, lidar.topic)
            window_s = sources.start_s, sources.end_s
            inputs = shots_from_bags(sources.bags, topics, window_s, advance)
        else:
            inputs = shots_from_files(listed_pairs(sources.pairs, sources.table), advance)
    model = camera.camera()
    found = CameraBoards(
        camera=camera.name,
        lidar=lidar.name,
        model=model,
        pairs=find_board_pairs(inputs.shots, model, board, plate_size_m, config),
        board=board,
        plate_size_m=plate_size_m,
    )
    return found, inputs


def _camera(rig: Rig, given: str | None) -> CameraSensor:
    cameras = rig.cameras()
    name = _only(list(cameras), given, "camera")
    return cameras[name]


def _lidar(rig: Rig, given: str | None) -> LidarSensor:
    lidars = rig.lidars()
    name = _only(list(lidars), given, "lidar")
    return lidars[name]


def _only(names: list[str], given: str | None, kind: str) -> str:
    if given is not None and given not in names:
        raise UsageError(
            f"--{kind} '{given}' is none of the rig's",
            remedy=f"Choose from {', '.join(names)}" if names else f"The rig has no {kind}",
        )
    if given is None and len(names) != 1:
        raise UsageError(
            f"the rig has {len(names)} sensors of the kind {kind}",
            remedy=f"Choose with --{kind}: {', '.join(names)}" if names else "Give another --rig",
        )
    return given or names[0]
