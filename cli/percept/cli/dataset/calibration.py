"""Which calibration a log is used with, and what is known of how good it is."""

from __future__ import annotations

import json
from pathlib import Path

from percept.cli.dataset.drives import DrivePlan
from percept.cli.run_folder import describe_input

__all__ = ["calibration_of"]

_MOST_BYTES = 16 << 20


def calibration_of(plan: DrivePlan, rig: Path | None) -> str:
    """Return version and verdict of a log's calibration, as a clause for the data card.

    The version is the digest of the rig file. The verdict is that of the calibration beside it:
    the commands of `percept calib` write both into one folder.

    Args:
        plan: The log.
        rig: The rig that was given; None where lenses and places are from the run or the log.
    """
    run = plan.source.run
    path = rig if rig is not None or run is None else run.folder / "rig.yaml"
    if path is None:
        known = any(lens.T_base_sensor is not None for lens in plan.lenses.values())
        return "what the log itself says; nobody checked it" if known else "none"
    version = f"{path.name} {describe_input(path)['sha256_head'][:12]}"
    return f"{version}, {_verdict(path.with_name('calibration.json'))}"


def _verdict(path: Path) -> str:
    unknown = "verdict not known: check it with `percept calib check`"
    if not path.is_file() or path.stat().st_size > _MOST_BYTES:
        return unknown
    try:
        found = json.loads(path.read_bytes())
    except ValueError:
        return unknown
    verdict = found.get("verdict") if isinstance(found, dict) else None
    return f"verdict {verdict}" if isinstance(verdict, str) else unknown
