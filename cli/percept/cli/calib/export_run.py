"""The run behind `percept calib export`."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

from percept.calib.formats import FIXED_FILES, about_rig, export_rig, import_rig
from percept.cli.run_folder import RunFolder
from percept.core.errors import UsageError
from percept.core.results import Verdict
from percept.core.rig import Rig

__all__ = ["run_export"]

_WHY_CALIBRATED = "this is the verdict of the calibration that the rig comes from"
_WHY_GIVEN = "the numbers are written as they were given; nothing says how they were found"


def run_export(path: Path, rig_format: str, out: Path, *, force: bool) -> dict[str, Any]:
    """Write a rig in a format into a run folder, and return the content of its `run.json`.

    Args:
        path: The rig, in any format that can be read, or the folder of a calibration run.
        rig_format: The format to write.
        out: The run folder.
        force: Whether to write although something is in it.

    Raises:
        PerceptError: If the rig cannot be read, the format can hold nothing of it, or the
            folder cannot be written.
    """
    notes: Counter[str] = Counter()
    rig = import_rig(path, notes)
    about = about_rig(path)
    files = export_rig(rig, rig_format, about=about.lines, notes=notes)
    source = path / "rig.yaml" if path.is_dir() else path
    _refuse_own_source(source, out, files)
    # No folders: one that has the name of a sensor may hold something else.
    outputs = sorted({*FIXED_FILES, *(name for name in files if "/" not in name)})
    with RunFolder(out, force=force, outputs=outputs) as folder:
        folder.begin()
        for name, text in files.items():
            _write(folder.path / name, text)
        run = folder.finish(
            config={"format": rig_format},
            inputs=[source],
            counts=_counts(rig, files),
            dropped=dict(notes),
            verdict=about.verdict or Verdict.GOOD,
            why=[_WHY_GIVEN if about.verdict is None else _WHY_CALIBRATED],
        )
    return {**run, "files": sorted(files)}


def _write(target: Path, text: str) -> None:
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")
    except (FileExistsError, NotADirectoryError, IsADirectoryError) as error:
        raise UsageError(
            f"cannot be written ({error.strerror})", where=target, remedy="Give another --out"
        ) from error


def _refuse_own_source(source: Path, out: Path, files: dict[str, str]) -> None:
    """Refuse to clear or write over the very file that is read, which `--force` would do."""
    names = {*FIXED_FILES, *files}
    if source.resolve().parent == out.resolve() and source.name in names:
        raise UsageError("would be written over", where=source, remedy="Give another --out")


def _counts(rig: Rig, files: dict[str, str]) -> dict[str, int]:
    return {
        "lidars": len(rig.lidars()),
        "cameras": len(rig.cameras()),
        "placed": sum(s.T_base_sensor is not None for s in rig.sensors.values()),
        "files": len(files),
    }
