"""A finished run of `percept detect`, as `percept track` needs it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from percept.core.errors import InputError
from percept.core.results import Verdict
from percept.core.rig import Rig, load_rig
from percept.core.trajectory import Trajectory
from percept.export.pose_table import read_poses

__all__ = ["FinishedRun", "open_run"]

_FILES = (
    "run.json",
    "rig.yaml",
    "scans_3d.parquet",
    "detections_3d.parquet",
    "images_2d.parquet",
    "detections_2d.parquet",
    "poses.parquet",
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FinishedRun:
    """What a run left behind.

    Attributes:
        folder: The run folder.
        rig: The sensors that it used.
        trajectory: Where the vehicle was; None where the run does not know.
        poses_file: Where that is written; None where the run does not know.
        source: What the poses were made from; empty where there are none.
        poses_verdict: How far they can be trusted.
        poses_why: Why.
        scans: Scans that it judged.
    """

    folder: Path
    rig: Rig
    trajectory: Trajectory | None
    poses_file: Path | None
    source: str
    poses_verdict: Verdict
    poses_why: tuple[str, ...]
    scans: int

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of the run that tracks rest on."""
        return tuple(path for name in _FILES if (path := self.folder / name).is_file())


def open_run(folder: Path) -> FinishedRun:
    """Read what is needed of a finished run.

    Raises:
        InputError: If the folder holds no finished run of `percept detect`, or a damaged one.
    """
    content = _content(folder)
    poses = content["config"].get("poses") or {}
    table = folder / "poses.parquet"
    known = table.is_file()
    return FinishedRun(
        folder=folder,
        rig=load_rig(folder / "rig.yaml"),
        trajectory=read_poses(table) if known else None,
        poses_file=table if known else None,
        source=str(poses.get("source", "")),
        poses_verdict=Verdict(poses.get("verdict", Verdict.GOOD)),
        poses_why=tuple(str(why) for why in poses.get("why", ())),
        scans=int(content["counts"].get("frames", 0)),
    )


def _content(folder: Path) -> dict[str, Any]:
    """Return `run.json`, as far as it is looked at."""
    path = folder / "run.json"
    if not path.is_file():
        raise InputError(
            "holds no finished run",
            where=folder,
            remedy="Give the --out folder of `percept detect`; finish it with --resume",
        )
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        known = isinstance(content["config"], dict) and isinstance(content["counts"], dict)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError("cannot be read as the record of a run", where=path) from error
    if not known or not any((folder / f"detections_{d}d.parquet").is_file() for d in "23"):
        raise InputError(
            "is no run of `percept detect`", where=folder, remedy="Give the --out folder of one"
        )
    if not (folder / "rig.yaml").is_file():
        raise InputError(
            "has no rig.yaml", where=folder, remedy="Detect again with this version of percept"
        )
    return dict(content)
