"""The run behind `percept calib camera-lidar`: from pairs to the run folder."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from percept.calib.board_in_cloud.find import BoardInCloudConfig
from percept.calib.boards.definitions import Board
from percept.calib.camera_lidar.calibrate import (
    BoardPair,
    CameraLidarCalibrationConfig,
    calibrate_camera_lidar,
)
from percept.calib.camera_lidar.result import CameraLidarCalibration
from percept.cli.calib.board_pairs import board_and_plate, find_board_pairs
from percept.cli.calib.camera_lidar_inputs import (
    PairInputs,
    listed_pairs,
    shots_from_bags,
    shots_from_files,
)
from percept.cli.calib.camera_lidar_rig import (
    SensorPair,
    choose_sensors,
    initial_transform,
    updated_rig,
)
from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder, describe_input
from percept.core.errors import UsageError
from percept.core.results import Verdict
from percept.core.rig import Rig, load_rig, rig_as_yaml
from percept.core.settings import Settings, load_settings
from percept.core.transform import Transform
from percept.export.calibration.camera_lidar_report import (
    ShownPair,
    camera_lidar_report,
    write_camera_lidar_view,
)
from percept.export.report import write_report

__all__ = ["CameraLidarRequest", "CameraLidarRun", "CameraLidarRunConfig", "run_camera_lidar"]

_OUTPUTS = ("calibration.json", "report.html", "view.rrd", "rig.yaml")


class CameraLidarRunConfig(Settings):
    """All settings of `percept calib camera-lidar`.

    Attributes:
        board_in_cloud: How the board is found in the clouds.
        calibration: How the transform is solved for.
    """

    board_in_cloud: BoardInCloudConfig = Field(default_factory=BoardInCloudConfig)
    calibration: CameraLidarCalibrationConfig = Field(default_factory=CameraLidarCalibrationConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraLidarRequest:
    """What the command line asked for; see the options of `percept calib camera-lidar`."""

    pairs: tuple[str, ...]
    table: Path | None
    bags: tuple[Path, ...]
    image_topic: str | None
    cloud_topic: str | None
    intrinsics: Path | None
    board: str
    board_size: str | None
    initial: Path | None
    camera: str | None
    lidar: str | None
    config: Path | None
    start_s: float | None
    end_s: float | None
    out: Path
    force: bool


@dataclass(frozen=True, slots=True, eq=False)
class CameraLidarRun:
    """What a run came to.

    Attributes:
        result: The calibration.
        document: `calibration.json`.
        notes: What a user should know beside it.
    """

    result: CameraLidarCalibration
    document: dict[str, Any]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """What is settled before the first image is read."""

    config: CameraLidarRunConfig
    board: Board
    plate_size_m: tuple[float, float]
    rig: Rig | None


def run_camera_lidar(request: CameraLidarRequest) -> CameraLidarRun:
    """Calibrate a camera and a LiDAR from files or a log, and fill the run folder.

    Raises:
        PerceptError: If the input, a setting or the folder cannot be used.
    """
    _check_sources(request)
    board, plate_size_m = board_and_plate(request.board, request.board_size)
    task = _Task(
        config=load_settings(CameraLidarRunConfig, request.config),
        board=board,
        plate_size_m=plate_size_m,
        rig=None if request.initial is None else load_rig(request.initial),
    )
    with RunFolder(request.out, force=request.force, outputs=_OUTPUTS) as folder:
        with progress_bar("reading", 1.0) as advance:
            inputs = _read(request, task.rig, advance)
        sensors = choose_sensors(
            inputs, task.rig, request.intrinsics, request.camera, request.lidar
        )
        camera = sensors.camera.camera()
        pairs = find_board_pairs(
            inputs.shots, camera, task.board, task.plate_size_m, task.config.board_in_cloud
        )
        initial = initial_transform(task.rig, sensors)
        result = calibrate_camera_lidar(
            pairs,
            camera,
            task.board,
            task.plate_size_m,
            task.config.calibration,
            None if initial is None else initial.matrix,
        )
        folder.begin()
        return _write(folder, task, inputs, sensors, pairs, result)


def _check_sources(request: CameraLidarRequest) -> None:
    listed = bool(request.pairs) or request.table is not None
    if listed == bool(request.bags):
        raise UsageError(
            "one of --pair, --pairs and --bag is needed",
            remedy="Give --pair IMAGE=CLOUD for every pose, --pairs TABLE.csv, or --bag LOG",
        )
    topics = request.image_topic is not None or request.cloud_topic is not None
    window = request.start_s is not None or request.end_s is not None
    if listed and (topics or window):
        raise UsageError(
            "--image-topic, --cloud-topic, --start and --end go with --bag",
            remedy="Leave them out",
        )


def _read(
    request: CameraLidarRequest, rig: Rig | None, advance: Callable[[float], None]
) -> PairInputs:
    if not request.bags:
        return shots_from_files(listed_pairs(request.pairs, request.table), advance)
    camera = None if rig is None else rig.cameras().get(request.camera or "")
    lidar = None if rig is None else rig.lidars().get(request.lidar or "")
    topics = (
        request.image_topic or (None if camera is None else camera.topic),
        request.cloud_topic or (None if lidar is None else lidar.topic),
    )
    return shots_from_bags(request.bags, topics, (request.start_s, request.end_s), advance)


def _write(
    folder: RunFolder,
    task: _Task,
    inputs: PairInputs,
    sensors: SensorPair,
    pairs: Sequence[BoardPair],
    result: CameraLidarCalibration,
) -> CameraLidarRun:
    rig = None
    if result.verdict in (Verdict.GOOD, Verdict.DOUBTFUL) and result.T_camera_lidar is not None:
        frames = sensors.camera.frame, sensors.lidar.frame
        rig = updated_rig(task.rig, sensors, Transform(*frames, result.T_camera_lidar))
    document = result.as_json()
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    (folder.path / "calibration.json").write_text(text, encoding="utf-8")
    if rig is not None:
        (folder.path / "rig.yaml").write_text(rig_as_yaml(rig), encoding="utf-8")
    settings = {
        **task.config.model_dump(mode="json"),
        "board": task.board.describe(),
        "board_size_m": list(task.plate_size_m),
        "camera": sensors.camera.name,
        "lidar": sensors.lidar.name,
    }
    shown = [
        ShownPair(shot.read_image, shot.points, pair.view, pair.board)
        for shot, pair in zip(inputs.shots, pairs, strict=True)
    ]
    notes = (*sensors.notes, *inputs.notes)
    report = camera_lidar_report(
        result,
        shown,
        sensors.camera,
        sensors.lidar,
        task.plate_size_m,
        inputs=[describe_input(path) for path in inputs.files],
        settings=settings,
        notes=notes,
    )
    write_report(folder.path / "report.html", report)
    write_camera_lidar_view(
        folder.path / "view.rrd",
        result,
        shown,
        sensors.camera,
        sensors.lidar,
        plate_size_m=task.plate_size_m,
    )
    folder.finish(
        config=settings,
        inputs=inputs.files,
        counts={"pairs": len(pairs), "used": sum(p.used for p in result.pairs)},
        dropped=_dropped(inputs, result),
        verdict=result.verdict,
        why=result.why,
    )
    return CameraLidarRun(result, document, notes)


def _dropped(inputs: PairInputs, result: CameraLidarCalibration) -> dict[str, int]:
    reasons = Counter(f"pair: {p.reason}" for p in result.pairs if not p.used)
    return {**(inputs.dropped or {}), **reasons}
