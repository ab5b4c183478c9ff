"""The end of the pass: where the vehicle was, and what its objects and lights did over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import typer

from percept.cli.detect.plan import RunPlan
from percept.cli.detect.poses import find_poses
from percept.cli.detect.used_rig import used_rig
from percept.cli.interrupts import prompt_interrupt
from percept.cli.odometry.found import FoundPoses
from percept.cli.odometry.request import Source
from percept.cli.track.follow import Followed, follow
from percept.cli.track.verdict import TrackFacts
from percept.core.health import StreamHealth
from percept.core.results import Verdict
from percept.core.trajectory import Trajectory
from percept.datasets.recording import Recording
from percept.export.health import run_health
from percept.export.pose_table import POSES, pose_rows, read_poses
from percept.export.run_events import run_events
from percept.export.tables import write_parquet

__all__ = ["OverTime", "look_over_time"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OverTime:
    """What became of the detections of a run.

    Attributes:
        poses: Where the vehicle was; None where nothing tells, or where it is of no use.
        followed: Tracks and lights.
        health: When sensors and detectors were late, by name.
    """

    poses: FoundPoses | None
    followed: Followed
    health: Mapping[str, StreamHealth]

    @property
    def trajectory(self) -> Trajectory | None:
        """The poses that tracks and lights rest on."""
        return None if self.poses is None else self.poses.trajectory

    def facts(self, scans: int, images: int) -> TrackFacts:
        """Return what the verdict on tracks rests on.

        Args:
            scans: Scans of the run.
            images: Images of the run.
        """
        poses, followed = self.poses, self.followed
        return TrackFacts(
            scans=scans,
            tracks=sum(followed.labels.values()),
            images=images,
            why_no_map=followed.why_no_map,
            poseless=followed.poseless,
            source=poses.source if poses is not None else "",
            poses_verdict=poses.verdict if poses is not None else Verdict.GOOD,
            poses_why=poses.why if poses is not None else (),
        )


def look_over_time(
    recording: Recording,
    plan: RunPlan,
    folder: Path,
    *,
    wanted: Source,
    check_interrupt: Callable[[], None],
) -> OverTime:
    """Find the poses, write them, and track objects and lights.

    Args:
        recording: The log.
        plan: What was settled.
        folder: The run folder, with the tables of detections; takes that of the poses.
        wanted: What poses are to be made from.
        check_interrupt: Raises `KeyboardInterrupt` if Ctrl-C was pressed.

    Raises:
        PerceptError: If the one source of poses that was asked for gives none.
    """
    poses, notes = find_poses(recording, plan, wanted, check_interrupt)
    if poses is not None:
        poses = replace(poses, trajectory=_as_written(folder, poses.trajectory))
        notes += [f"Poses from {poses.source}: {note.rstrip('.')}." for note in poses.notes]
    check_interrupt()
    with prompt_interrupt():
        followed = follow(
            folder,
            rig=used_rig(plan),
            poses=None if poses is None else poses.trajectory,
            hd_map=plan.hd_map,
            config=plan.config,
        )
    notes += followed.notes
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    return OverTime(
        poses=poses,
        followed=replace(followed, notes=tuple(notes)),
        health=run_health(run_events(folder)),
    )


def _as_written(folder: Path, trajectory: Trajectory) -> Trajectory:
    """Write the poses, and return what `percept track` will read.

    A turn that went through its quaternion has other last digits: tracks rest on those of the
    table, so that the same settings give the same tracks again.
    """
    table = folder / "poses.parquet"
    write_parquet(table, POSES, [pose_rows(trajectory)])
    return read_poses(table)
