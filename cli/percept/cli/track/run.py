"""The run behind `percept track`."""

from __future__ import annotations

from pathlib import Path
from shutil import copyfile
from typing import Any

from percept.cli.run_folder import RunFolder, describe_input
from percept.cli.track.finished_run import FinishedRun, open_run
from percept.cli.track.follow import Followed, follow
from percept.cli.track.maps import load_wanted_map
from percept.cli.track.outputs import TABLES, add_to_overlay, add_to_view, write_tables
from percept.cli.track.report import over_time_sections
from percept.cli.track.request import TrackConfig, TrackRequest
from percept.cli.track.verdict import TrackFacts, judge_tracks
from percept.core.errors import UsageError
from percept.core.settings import load_settings
from percept.core.trajectory import Trajectory
from percept.export.detection_report import closing_sections
from percept.export.health import health_as_json, run_health
from percept.export.overlay import OverlayWriter
from percept.export.report import ReportContent, write_report
from percept.export.run_events import run_events
from percept.export.scan_table import read_scans
from percept.export.view import ViewWriter

__all__ = ["run_tracking"]

_OUTPUTS = (*TABLES, "view.rrd", "report.html", "overlay.mcap")


def run_tracking(request: TrackRequest) -> dict[str, Any]:
    """Track a finished run again and fill the run folder; return the content of `run.json`.

    Raises:
        PerceptError: If the run, the map, a setting or the folder cannot be used.
    """
    if request.out.resolve() == request.run.resolve():
        raise UsageError("--out is the run itself", where=request.out, remedy="Give a new folder")
    config = load_settings(TrackConfig, request.config)
    run = open_run(request.run, request.poses)
    hd_map = load_wanted_map(request.map_file, request.origin)
    with RunFolder(request.out, force=request.force, outputs=_OUTPUTS) as folder:
        followed = follow(
            run.folder, rig=run.rig, poses=run.trajectory, hd_map=hd_map, config=config
        )
        folder.begin(_given(request))
        return _fill(folder, run, request, config, followed)


def _fill(
    folder: RunFolder,
    run: FinishedRun,
    request: TrackRequest,
    config: TrackConfig,
    followed: Followed,
) -> dict[str, Any]:
    """Write all files of the run."""
    poses = run.trajectory
    inputs = [*run.files, *_given(request)]
    notes = list(followed.notes)
    if run.map_name and run.images and request.map_file is None:
        notes.append(f"The run followed the lights of {run.map_name}: give it with --map, too.")
    health = run_health(run_events(run.folder))
    if run.poses_file is not None:
        copyfile(run.poses_file, folder.path / "poses.parquet")
    write_tables(folder.path, followed)
    run_id = f"{folder.path.resolve()}"
    with ViewWriter(folder.path / "view.rrd", run_id=run_id, frames_expected=run.scans) as view:
        add_to_view(view, poses, followed)
        view.add_health(health)
    if request.overlay:
        _write_overlay(folder, run, poses, followed)
    verdict, why, advice = judge_tracks(
        TrackFacts(
            scans=run.scans,
            tracks=sum(followed.labels.values()),
            images=run.images,
            why_no_map=followed.why_no_map,
            poseless=followed.poseless,
            source=run.source,
            poses_verdict=run.poses_verdict,
            poses_why=run.poses_why,
        )
    )
    settings = config.model_dump(mode="json")
    content = ReportContent(
        title=f"Tracks of {run.folder.name}",
        verdict=verdict,
        why=why,
        advice=advice,
        sections=(
            *over_time_sections(followed, poses, health),
            *closing_sections(
                dropped=followed.dropped,
                inputs=[describe_input(path) for path in inputs],
                notes=notes,
                settings=settings,
            ),
        ),
    )
    write_report(folder.path / "report.html", content)
    return folder.finish(
        config=settings,
        inputs=inputs,
        counts=followed.counts(),
        dropped=followed.dropped,
        verdict=verdict,
        why=why,
        notes=notes,
        health=health_as_json(health),
    )


def _given(request: TrackRequest) -> list[Path]:
    """Return the files besides the run that were given."""
    return [p for p in (request.map_file, request.poses, request.config) if p is not None]


def _write_overlay(
    folder: RunFolder, run: FinishedRun, poses: Trajectory | None, followed: Followed
) -> None:
    scans = run.folder / "scans_3d.parquet"
    log_times_ns = {
        scan.stamp_ns: scan.log_time_ns for scan, _ in (read_scans(scans) if run.scans else ())
    }
    with OverlayWriter(folder.path / "overlay.mcap") as overlay:
        add_to_overlay(overlay, poses, followed, log_times_ns)
