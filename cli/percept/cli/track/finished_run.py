"""A finished run of `percept detect`, as `percept track` needs it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, Field, ValidationError

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
_SCANS = ("detections_3d.parquet", "scans_3d.parquet")
_IMAGES = ("detections_2d.parquet", "images_2d.parquet")


class _Poses(BaseModel):
    """What `run.json` says of the poses."""

    source: str
    verdict: Verdict
    why: tuple[str, ...]


class _Config(BaseModel):
    poses: _Poses | None = None
    map: str | None = None


class _Counts(BaseModel):
    frames: int | None = Field(default=None, ge=0)
    images: int | None = Field(default=None, ge=0)


class _Record(BaseModel):
    """What is looked at of `run.json`."""

    config: _Config
    counts: _Counts


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
        images: Images that it looked at.
        map_name: The map that it followed the lights of; empty without one.
    """

    folder: Path
    rig: Rig
    trajectory: Trajectory | None
    poses_file: Path | None
    source: str
    poses_verdict: Verdict
    poses_why: tuple[str, ...]
    scans: int
    images: int
    map_name: str

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of the run that tracks rest on."""
        return tuple(path for name in _FILES if (path := self.folder / name).is_file())


def open_run(folder: Path, poses: Path | None = None) -> FinishedRun:
    """Read what is needed of a finished run.

    Args:
        folder: The run folder.
        poses: A `poses.parquet` to use in place of what the run knows.

    Raises:
        InputError: If the folder holds no finished run of `percept detect`, or a damaged one, or
            the poses are damaged.
    """
    record = _record(folder)
    known = record.config.poses if poses is None else None
    table = folder / "poses.parquet" if known is not None else poses
    _check_files(folder, record)
    if known is None and table is not None:
        known = _Poses(source=table.name, verdict=Verdict.GOOD, why=())
    return FinishedRun(
        folder=folder,
        rig=load_rig(folder / "rig.yaml"),
        trajectory=read_poses(table) if table is not None else None,
        poses_file=table,
        source=known.source if known is not None else "",
        poses_verdict=known.verdict if known is not None else Verdict.GOOD,
        poses_why=known.why if known is not None else (),
        scans=record.counts.frames or 0,
        images=record.counts.images or 0,
        map_name=record.config.map or "",
    )


def _record(folder: Path) -> _Record:
    path = folder / "run.json"
    if not path.is_file():
        raise InputError(
            "holds no finished run",
            where=folder,
            remedy="Give the --out folder of `percept detect`; finish it with --resume",
        )
    try:
        return _Record.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        raise InputError(
            "cannot be read as the record of a run", where=path, remedy="Detect again"
        ) from error


def _check_files(folder: Path, record: _Record) -> None:
    """Refuse a folder that lacks a file of the run."""
    if not any((folder / f"detections_{d}d.parquet").is_file() for d in "23"):
        raise InputError(
            "is no run of `percept detect`", where=folder, remedy="Give the --out folder of one"
        )
    wanted = ["rig.yaml"]
    wanted += _SCANS if record.counts.frames is not None else ()
    wanted += _IMAGES if record.counts.images is not None else ()
    for name in wanted:
        if not (folder / name).is_file():
            raise InputError(
                f"has no {name}",
                where=folder,
                remedy="Detect again with this version of percept",
            )
