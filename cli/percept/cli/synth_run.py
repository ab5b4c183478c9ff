"""The runs behind `percept synth`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder
from percept.core.results import Verdict
from percept.core.settings import Settings
from percept.datasets.synthetic.calibration.capture import CalibrationConfig
from percept.datasets.synthetic.calibration.log import generate_calibration
from percept.datasets.synthetic.drive import DriveConfig, DriveSummary, generate_drive
from percept.datasets.write import LogFormat

__all__ = ["make_calibration", "make_drive"]

_DRIVE_OUTPUTS = ("drive.mcap", "drive.bag", "drive", "rig.yaml", "map.osm", "truth")
_CALIBRATION_OUTPUTS = ("calib.mcap", "calib.bag", "calib", "rig.yaml", "board.yaml", "truth")


def make_drive(
    out: Path, config: DriveConfig, log_format: LogFormat, *, force: bool
) -> dict[str, Any]:
    """Make a drive in a run folder and return the content of its `run.json`."""
    with RunFolder(out, force=force, outputs=_DRIVE_OUTPUTS) as folder:
        folder.begin()
        with progress_bar("making the drive", 1.0) as advance:
            summary = generate_drive(config, folder.path, log_format, advance)
        return _finished(folder, config, log_format, summary, {})


def make_calibration(
    out: Path, config: CalibrationConfig, log_format: LogFormat, *, force: bool
) -> dict[str, Any]:
    """Make a calibration log in a run folder and return the content of its `run.json`."""
    with RunFolder(out, force=force, outputs=_CALIBRATION_OUTPUTS) as folder:
        folder.begin()
        with progress_bar("making the calibration log", 1.0) as advance:
            summary = generate_calibration(config, folder.path, log_format, advance)
        poses = config.poses * len(config.cameras)
        return _finished(folder, config, log_format, summary, {"poses": poses})


def _finished(
    folder: RunFolder,
    config: Settings,
    log_format: LogFormat,
    summary: DriveSummary,
    counts: Mapping[str, int],
) -> dict[str, Any]:
    return folder.finish(
        config={**config.model_dump(mode="json"), "format": log_format},
        inputs=[],
        counts={"messages": sum(summary.counts.values()), "topics": summary.counts, **counts},
        dropped={},
        verdict=Verdict.GOOD,
        why=["made from the seed"],
    )
