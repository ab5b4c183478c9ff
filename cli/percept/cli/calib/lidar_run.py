"""The run behind `percept calib lidar`: from clouds to the run folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from percept.calib.lidars.calibrate import calibrate_lidars
from percept.calib.lidars.pair import LidarCalibrationConfig
from percept.calib.lidars.result import LidarCalibration, Pose
from percept.cli.calib.lidar_inputs import LidarInputs, clouds_from_bags, clouds_from_files
from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder, describe_input
from percept.core.errors import UsageError
from percept.core.results import Verdict
from percept.core.rig import LidarSensor, Rig, load_rig, rig_as_yaml
from percept.core.settings import load_settings
from percept.core.transform import Transform
from percept.export.calibration.lidar_report import clouds_in_reference, lidar_calibration_report
from percept.export.calibration.view import write_calibration_view
from percept.export.report import write_report

__all__ = ["LidarRequest", "LidarRun", "run_lidar_calibration"]

_OUTPUTS = ("calibration.json", "report.html", "view.rrd", "rig.yaml")


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarRequest:
    """What the command line asked for; see the options of `percept calib lidar`."""

    clouds: tuple[str, ...]
    bags: tuple[Path, ...]
    topics: Mapping[str, str]
    reference: str | None
    initial: Path | None
    config: Path | None
    start_s: float | None
    end_s: float | None
    out: Path
    force: bool


@dataclass(frozen=True, slots=True, eq=False)
class LidarRun:
    """What a run came to.

    Attributes:
        result: The calibration.
        document: `calibration.json`.
        notes: What a user should know beside it.
    """

    result: LidarCalibration
    document: dict[str, Any]
    notes: tuple[str, ...]


def run_lidar_calibration(request: LidarRequest) -> LidarRun:
    """Calibrate the LiDARs of files or a log, and fill the run folder.

    Raises:
        PerceptError: If the input, a setting or the folder cannot be used.
    """
    _check_sources(request)
    config = load_settings(LidarCalibrationConfig, request.config)
    rig = load_rig(request.initial) if request.initial is not None else None
    with RunFolder(request.out, force=request.force, outputs=_OUTPUTS) as folder:
        inputs = _read(request, rig)
        reference, chosen_how = _reference(request, inputs)
        start = _places(inputs, reference)
        if request.initial is not None and len(start) < 2:
            raise UsageError(
                f"has no place of '{reference}' and of another LiDAR that is given",
                where=request.initial,
                remedy="Leave --initial out, or name the LiDARs as the rig does",
            )
        with progress_bar("calibrating", 1.0) as advance:
            result = calibrate_lidars(inputs.scenes, reference, config, start, advance)
        folder.begin()
        notes = (f"reference: {reference} ({chosen_how})", *inputs.notes, *_kept_out(result))
        return _write(folder, inputs, config, rig, result, notes)


def _check_sources(request: LidarRequest) -> None:
    if bool(request.clouds) == bool(request.bags):
        raise UsageError(
            "one of --cloud and --bag is needed",
            remedy="Give --cloud NAME=PATH for every LiDAR and scene, or --bag LOG",
        )
    if request.clouds and request.topics:
        raise UsageError("--topic goes with --bag", remedy="Leave it out, or give --bag")
    if request.clouds and (request.start_s is not None or request.end_s is not None):
        raise UsageError("--start and --end go with --bag", remedy="Leave them out")


def _read(request: LidarRequest, rig: Rig | None) -> LidarInputs:
    if request.clouds:
        return clouds_from_files(request.clouds, rig)
    with progress_bar("reading the log", 1.0) as advance:
        window_s = request.start_s, request.end_s
        return clouds_from_bags(request.bags, request.topics, rig, window_s, advance)


def _reference(request: LidarRequest, inputs: LidarInputs) -> tuple[str, str]:
    """Return the name of the reference, and why it is this one."""
    if request.reference is not None:
        if request.reference not in inputs.sensors:
            raise UsageError(
                f"--reference '{request.reference}' is none of the LiDARs",
                remedy=f"Choose from {', '.join(inputs.sensors)}",
            )
        return request.reference, "as asked for"
    if request.clouds or request.topics:
        return next(iter(inputs.sensors)), "the first one that was named"
    return inputs.most_points(), "the one with the most points"


def _places(inputs: LidarInputs, reference: str) -> dict[str, Pose]:
    """Return `T_reference_sensor` of the LiDARs whose places are known."""
    root = inputs.sensors[reference].T_base_sensor
    if root is None:
        return {}
    return {
        name: (root.inverse() @ sensor.T_base_sensor).matrix
        for name, sensor in inputs.sensors.items()
        if sensor.T_base_sensor is not None and sensor.T_base_sensor.target == root.target
    }


def _kept_out(result: LidarCalibration) -> list[str]:
    return [f"left out: {count} x {reason}" for reason, count in result.dropped.items()]


def _write(
    folder: RunFolder,
    inputs: LidarInputs,
    config: LidarCalibrationConfig,
    rig: Rig | None,
    result: LidarCalibration,
    notes: tuple[str, ...],
) -> LidarRun:
    document = result.as_json()
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    (folder.path / "calibration.json").write_text(text, encoding="utf-8")
    if result.verdict in (Verdict.GOOD, Verdict.DOUBTFUL):
        updated = updated_rig(rig, inputs.sensors, result)
        (folder.path / "rig.yaml").write_text(rig_as_yaml(updated), encoding="utf-8")
    settings = {**config.model_dump(mode="json"), "reference": result.reference}
    report = lidar_calibration_report(
        result,
        inputs.scenes,
        inputs=[describe_input(path) for path in inputs.files],
        settings=settings,
        notes=notes,
    )
    write_report(folder.path / "report.html", report)
    before, after = clouds_in_reference(result, inputs.scenes[0])
    write_calibration_view(folder.path / "view.rrd", clouds=after, before=before)
    folder.finish(
        config=settings,
        inputs=inputs.files,
        counts={"scenes": result.scenes, "sensors": len(inputs.sensors)},
        dropped={**(inputs.dropped or {}), **result.dropped},
        verdict=result.verdict,
        why=result.why,
    )
    return LidarRun(result, document, notes)


def updated_rig(
    rig: Rig | None, sensors: Mapping[str, LidarSensor], result: LidarCalibration
) -> Rig:
    """Return the rig that was given with the new places, or a new one.

    The reference keeps its place in the base frame. Without one, its frame is the base frame.

    Args:
        rig: The rig that was given, or None.
        sensors: The LiDARs that were calibrated, by name.
        result: Their places.
    """
    own = sensors[result.reference]
    T_base_reference = own.T_base_sensor or Transform.identity(own.frame, own.frame)
    base_frame = T_base_reference.target
    placed = dict(rig.sensors) if rig is not None else {}
    for name, T_reference_sensor in result.transforms().items():
        sensor = sensors[name]
        step = Transform(own.frame, sensor.frame, T_reference_sensor)
        placed[name] = replace(sensor, T_base_sensor=T_base_reference @ step)
    return Rig(base_frame, placed)
