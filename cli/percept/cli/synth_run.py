"""The run behind `percept synth drive`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder
from percept.core.results import Verdict
from percept.datasets.synthetic.drive import DriveConfig, generate_drive
from percept.datasets.write import LogFormat

__all__ = ["make_drive"]

_OUTPUTS = ("drive.mcap", "drive.bag", "drive", "rig.yaml", "map.osm", "truth")


def make_drive(
    out: Path,
    config: DriveConfig,
    log_format: LogFormat,
    *,
    force: bool,
) -> dict[str, Any]:
    """Make a drive in a run folder and return the content of its `run.json`."""
    with RunFolder(out, force=force, outputs=_OUTPUTS) as folder:
        folder.begin()
        with progress_bar("making the drive", 1.0) as advance:
            summary = generate_drive(config, folder.path, log_format, advance)
        return folder.finish(
            config={**config.model_dump(mode="json"), "format": log_format},
            inputs=[],
            counts={"messages": sum(summary.counts.values()), "topics": summary.counts},
            dropped={},
            verdict=Verdict.GOOD,
            why=["made from the seed"],
        )
