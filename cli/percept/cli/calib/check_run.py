"""The run behind `percept calib check`: from the data to the run folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import Field

from percept.calib.board_in_cloud.find import BoardInCloudConfig
from percept.calib.check.check import CheckConfig, check_calibration
from percept.calib.check.result import CalibrationCheck
from percept.cli.calib.check_inputs import CheckInputs, CheckSources, read_inputs
from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder, describe_input
from percept.core.rig import Rig, load_rig
from percept.core.settings import load_settings
from percept.export.calibration.check_report import (
    CheckEvidence,
    calibration_check_report,
    found_places,
    in_base,
)
from percept.export.calibration.view import write_calibration_view
from percept.export.report import write_report

__all__ = ["CheckRequest", "CheckRun", "CheckRunConfig", "run_check"]

_OUTPUTS = ("calibration.json", "report.html", "view.rrd")


class CheckRunConfig(CheckConfig):
    """All settings of `percept calib check`.

    Attributes:
        board_in_cloud: How the board is found in the clouds.
    """

    board_in_cloud: BoardInCloudConfig = Field(default_factory=BoardInCloudConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckRequest(CheckSources):
    """What the command line asked for; see the options of `percept calib check`."""

    rig: Path
    reference: str | None
    config: Path | None
    out: Path
    force: bool


@dataclass(frozen=True, slots=True, eq=False)
class CheckRun:
    """What a run came to.

    Attributes:
        result: The check.
        document: `calibration.json`.
        notes: What a user should know beside it.
    """

    result: CalibrationCheck
    document: dict[str, Any]
    notes: tuple[str, ...]


def run_check(request: CheckRequest) -> CheckRun:
    """Check a rig with files or a log, and fill the run folder.

    Raises:
        PerceptError: If the input, a setting or the folder cannot be used.
    """
    config = load_settings(CheckRunConfig, request.config)
    rig = load_rig(request.rig)
    with RunFolder(request.out, force=request.force, outputs=_OUTPUTS) as folder:
        inputs = read_inputs(request, rig, config.board_in_cloud)
        with progress_bar("comparing with the rig", 1.0) as advance:
            result = check_calibration(
                _places(rig),
                scenes=inputs.scenes,
                boards=() if inputs.boards is None else (inputs.boards,),
                reference=request.reference,
                focal_px=_focal_px(rig, inputs),
                config=config,
                progress=advance,
            )
        folder.begin()
        return _write(folder, request, config, rig, inputs, result)


def _places(rig: Rig) -> dict[str, Any]:
    """Return `T_base_sensor` (4, 4) of the sensors that the rig places."""
    return {
        name: sensor.T_base_sensor.matrix
        for name, sensor in rig.sensors.items()
        if sensor.T_base_sensor is not None
    }


def _focal_px(rig: Rig, inputs: CheckInputs) -> float | None:
    """Return the focal length of the camera that is checked, or of the rig's first one."""
    cameras = rig.cameras()
    name = next(iter(cameras), None) if inputs.boards is None else inputs.boards.camera
    return None if name is None else cameras[name].K[0]


def _write(
    folder: RunFolder,
    request: CheckRequest,
    config: CheckRunConfig,
    rig: Rig,
    inputs: CheckInputs,
    result: CalibrationCheck,
) -> CheckRun:
    result = replace(
        result,
        not_checked=inputs.not_checked,
        dropped={**inputs.dropped, **result.dropped},
    )
    document = result.as_json()
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    (folder.path / "calibration.json").write_text(text, encoding="utf-8")
    settings = {**config.model_dump(mode="json"), "rig": str(request.rig)}
    files = (request.rig, *inputs.files)
    notes = (*inputs.notes, *(f"not checked: {n}: {why}" for n, why in inputs.not_checked.items()))
    evidence = CheckEvidence(_places(rig), inputs.scenes, inputs.boards, inputs.shots)
    report = calibration_check_report(
        result,
        evidence,
        inputs=[describe_input(path) for path in files],
        settings=settings,
        notes=notes,
    )
    write_report(folder.path / "report.html", report)
    _write_view(folder.path / "view.rrd", evidence, result)
    folder.finish(
        config=settings,
        inputs=files,
        counts=_counts(inputs, result),
        dropped=result.dropped,
        verdict=result.verdict,
        why=result.why,
    )
    return CheckRun(result, document, notes)


def _write_view(path: Path, evidence: CheckEvidence, result: CalibrationCheck) -> None:
    """Write the clouds of the first scene in the base frame, by the rig and by the new data."""
    scene: Mapping[str, Any] = evidence.scenes[0] if evidence.scenes else {}
    if not scene and evidence.boards is not None and evidence.shots:
        scene = {evidence.boards.lidar: evidence.shots[0].points}
    after = in_base(scene, found_places(result, evidence.T_base_sensor))
    write_calibration_view(path, clouds=after, before=in_base(scene, evidence.T_base_sensor))


def _counts(inputs: CheckInputs, result: CalibrationCheck) -> dict[str, Any]:
    return {
        "scenes": len(inputs.scenes),
        "board_pairs": len(inputs.shots),
        "pairs_of_sensors": len(result.pairs),
        "moved": [moved.sensor for moved in result.moved],
    }
