"""The run behind `percept calib camera`: from images to the run folder."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import Field

from percept.calib.boards.definitions import Board, load_board
from percept.calib.boards.detection import BoardView, NoBoard, detect_boards
from percept.calib.boards.selection import select_views
from percept.calib.intrinsics.calibrate import CameraCalibrationConfig, calibrate_camera
from percept.calib.intrinsics.result import CameraCalibration
from percept.calib.intrinsics.undistort import write_undistorted
from percept.cli.calib.camera_images import CameraInputs, images_of_bags, images_of_files
from percept.cli.interrupts import deferred_interrupt
from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder, describe_input
from percept.core.cameras import Camera
from percept.core.errors import InputError, UsageError
from percept.core.rig import CameraSensor, Rig, load_rig, rig_as_yaml
from percept.core.settings import load_settings
from percept.export.calibration.camera_report import (
    camera_calibration_report,
    shown_views,
    write_camera_view,
)
from percept.export.report import write_report

__all__ = ["CameraRequest", "CameraRun", "CameraRunConfig", "run_camera_calibration"]

_OUTPUTS = (
    "calibration.json", "rig.yaml", "report.html", "view.rrd", "undistorted", "maps.npz",
)  # fmt: skip


class CameraRunConfig(CameraCalibrationConfig):
    """Settings of `percept calib camera`.

    Attributes:
        most_images: Of a log, the most images in which the board is looked for.
    """

    most_images: int = Field(default=150, ge=1, le=2000)


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraRequest:
    """What the command line asked for; see the options of `percept calib camera`."""

    images: tuple[str, ...]
    bags: tuple[Path, ...]
    topic: str | None
    board: str
    name: str | None
    initial: Path | None
    config: Path | None
    flags: Mapping[str, Any]
    undistort: bool
    start_s: float | None
    end_s: float | None
    out: Path
    force: bool


@dataclass(frozen=True, slots=True, eq=False)
class CameraRun:
    """A finished run: the result, its document, and what was looked at."""

    result: CameraCalibration
    document: dict[str, Any]
    looked_at: int
    searched: int


def run_camera_calibration(request: CameraRequest) -> CameraRun:
    """Calibrate a camera and fill the run folder.

    Raises:
        PerceptError: If the input, a setting or the folder cannot be used.
    """
    config = load_settings(CameraRunConfig, request.config, dict(request.flags))
    board = load_board(request.board).board
    rig = load_rig(request.initial) if request.initial is not None else None
    name = _camera_name(request, rig)
    with (
        deferred_interrupt() as check,
        RunFolder(request.out, force=request.force, outputs=_OUTPUTS) as folder,
    ):
        inputs = _inputs(request, config, rig, name)
        check()
        folder.begin()
        views, missing = _detected(inputs, board)
        result = calibrate_camera(views, board, _solver_config(config), name, missing)
        check()
        return _fill(folder, request, config, board, inputs, result, rig)


def _camera_name(request: CameraRequest, rig: Rig | None) -> str:
    cameras = {} if rig is None else rig.cameras()
    if request.name is not None:
        if rig is not None and request.name in rig.lidars():
            raise UsageError(f"--camera '{request.name}' is a LiDAR", where=request.initial)
        return request.name
    return next(iter(cameras)) if len(cameras) == 1 else "camera"


def _inputs(
    request: CameraRequest, config: CameraRunConfig, rig: Rig | None, name: str
) -> CameraInputs:
    if bool(request.images) == bool(request.bags):
        raise UsageError("give either --images or --bag", remedy="See percept calib camera --help")
    if request.images:
        if request.topic is not None or request.start_s is not None or request.end_s is not None:
            raise UsageError("--topic, --start and --end belong to --bag")
        return images_of_files(request.images)
    known = None if rig is None else rig.cameras().get(name)
    topic = request.topic or (None if known is None else known.topic)
    return images_of_bags(request.bags, topic, config.most_images, request.start_s, request.end_s)


def _solver_config(config: CameraRunConfig) -> CameraCalibrationConfig:
    return CameraCalibrationConfig(**config.model_dump(exclude={"most_images"}))


def _detected(inputs: CameraInputs, board: Board) -> tuple[list[BoardView], list[NoBoard]]:
    """Look for the board in every image, and leave out views that say the same as others."""
    images = ((name, partial(inputs.image, name)) for name in inputs.encoded)
    with progress_bar("looking for the board", len(inputs.encoded)) as advance:
        views, missing = detect_boards(images, board, advance)
    kept, dropped = select_views(views)
    return kept, [*missing, *dropped]


def _fill(
    folder: RunFolder,
    request: CameraRequest,
    config: CameraRunConfig,
    board: Board,
    inputs: CameraInputs,
    result: CameraCalibration,
    rig: Rig | None,
) -> CameraRun:
    document = result.as_dict()
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    (folder.path / "calibration.json").write_text(text)
    usable = result.camera is not None and result.verdict.exit_code == 0
    if result.camera is not None and usable:
        sensor = _sensor(result.name, result.camera, inputs, rig)
        (folder.path / "rig.yaml").write_text(rig_as_yaml(_with_camera(rig, sensor)))
        if request.undistort:
            images = _readable(inputs, inputs.encoded)
            write_undistorted(folder.path, result.camera, images)
    pictures = dict(_readable(inputs, shown_views(result)))
    settings = {**config.model_dump(mode="json"), "board": request.board}
    content = camera_calibration_report(
        result,
        pictures,
        inputs=[describe_input(path) for path in inputs.files],
        settings=settings,
    )
    write_report(folder.path / "report.html", content)
    write_camera_view(folder.path / "view.rrd", result, board.corners_board(), pictures)
    folder.finish(
        config=settings,
        inputs=inputs.files,
        counts={
            "images": inputs.looked_at,
            "searched": len(inputs.encoded),
            "boards": sum(len(view.corners_px) > 0 for view in result.views),
            "used": sum(view.used for view in result.views),
        },
        dropped={**Counter(_kind(v.reason) for v in result.views if v.reason), **inputs.dropped},
        verdict=result.verdict,
        why=result.why,
    )
    return CameraRun(result, document, inputs.looked_at, len(inputs.encoded))


def _readable(inputs: CameraInputs, names: Iterable[str]) -> Iterator[tuple[str, Any]]:
    """Yield the images that can be decoded; the others are among the views, with the reason."""
    for name in names:
        try:
            yield name, inputs.image(name)
        except InputError:
            continue


def _kind(reason: str) -> str:
    """Return a reason without the figures of one view, so that alike ones are counted together."""
    return reason.split(":")[0].split("(")[0].strip()


def _sensor(name: str, camera: Camera, inputs: CameraInputs, rig: Rig | None) -> CameraSensor:
    K = camera.K
    known = None if rig is None else rig.cameras().get(name)
    sensor = CameraSensor(
        name=name,
        topic=inputs.topic,
        frame=inputs.frame or name,
        image_size=camera.image_size,
        model=camera.model,
        K=(float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])),
        distortion=tuple(map(float, camera.distortion)),
        T_base_sensor=None,
    )
    if known is None:
        return sensor
    return replace(sensor, topic=known.topic, frame=known.frame, T_base_sensor=known.T_base_sensor)


def _with_camera(rig: Rig | None, sensor: CameraSensor) -> Rig:
    if rig is None:
        return Rig("base_link", {sensor.name: sensor})
    return Rig(rig.base_frame, {**rig.sensors, sensor.name: sensor})
