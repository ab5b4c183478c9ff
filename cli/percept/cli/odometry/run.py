"""The run behind `percept odometry`: from a log to the run folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from percept.cli.interrupts import deferred_interrupt
from percept.cli.odometry.compare import Compared, compare, drift_row
from percept.cli.odometry.found import FoundPoses
from percept.cli.odometry.quality import break_times, failed_scans, over_time, quality_columns
from percept.cli.odometry.request import OdometryConfig, OdometryRequest
from percept.cli.odometry.sources import PoseFinder
from percept.cli.run_folder import RunFolder, describe_input
from percept.cli.window import log_window_ns
from percept.core.clock import NS_PER_S
from percept.core.results import Verdict
from percept.core.rig import load_rig
from percept.core.settings import load_settings
from percept.core.trajectory import Trajectory
from percept.datasets import open_recording
from percept.export.odometry_report import OdometryEvidence, odometry_report
from percept.export.odometry_table import POSE_QUALITY, pose_quality_rows
from percept.export.pose_table import POSES, pose_rows, read_poses
from percept.export.report import write_report
from percept.export.tables import write_parquet
from percept.odometry.drift import align_poses
from percept.odometry.files import read_tum, write_kitti_poses, write_tum

__all__ = ["run_odometry"]

_OUTPUTS = (
    "poses.parquet", "quality.parquet", "trajectory.tum", "trajectory.kitti", "report.html",
)  # fmt: skip
_TABLE = ".parquet"


def run_odometry(request: OdometryRequest) -> dict[str, Any]:
    """Find the poses of a log and fill the run folder; return the content of `run.json`.

    Raises:
        PerceptError: If the input, a setting or the folder cannot be used.
    """
    config = load_settings(OdometryConfig, request.config)
    rig = load_rig(request.rig) if request.rig is not None else None
    reference = None if request.reference is None else _read_reference(request.reference)
    with (
        deferred_interrupt() as check,
        RunFolder(request.out, force=request.force, outputs=_OUTPUTS) as folder,
        open_recording(list(request.bags)) as recording,
    ):
        window_ns = log_window_ns(recording, request.start_s, request.end_s)
        finder = PoseFinder(
            recording,
            rig,
            config,
            source=request.source,
            topics=request.topics,
            window_ns=window_ns,
            check_interrupt=check,
        )
        found = finder.find()
        others = finder.others(found)
        compared = [
            *compare(found, {str(request.reference): reference} if reference else {}, own=True),
            *compare(found, {other.source: other.trajectory for other in others}),
        ]
        folder.begin()
        given = [path for path in (request.rig, request.reference) if path is not None]
        return _write(folder, found, others, compared, config, (*recording.paths, *given))


def _read_reference(path: Path) -> Trajectory:
    return read_poses(path) if path.suffix == _TABLE else read_tum(path)


def _write(
    folder: RunFolder,
    found: FoundPoses,
    others: Sequence[FoundPoses],
    compared: Sequence[Compared],
    config: OdometryConfig,
    inputs: Sequence[Path],
) -> dict[str, Any]:
    poses, path = found.trajectory, folder.path
    write_parquet(path / "poses.parquet", POSES, [pose_rows(poses)])
    quality = pose_quality_rows(quality_columns(found))
    write_parquet(path / "quality.parquet", POSE_QUALITY, [quality])
    write_tum(path / "trajectory.tum", poses)
    write_kitti_poses(path / "trajectory.kitti", poses)
    counts = _counts(found, compared)
    seconds, curves = over_time(found)
    evidence = OdometryEvidence(
        source=found.source,
        ways={found.source: poses, **_laid_over(found, others)},
        facts=_facts(counts),
        seconds=seconds,
        over_time=curves,
        drift=[drift_row(one) for one in compared],
        gaps=break_times(found),
        failures=failed_scans(found),
        dropped=found.dropped,
        notes=found.notes,
        inputs=[describe_input(file) for file in inputs],
    )
    advice = _advice(found)
    report = odometry_report(evidence, verdict=found.verdict, why=found.why, advice=advice)
    write_report(path / "report.html", report)
    return folder.finish(
        config={**config.model_dump(mode="json"), "source": found.source},
        inputs=inputs,
        counts=counts,
        dropped=found.dropped,
        verdict=found.verdict,
        why=found.why,
        notes=found.notes,
    )


def _laid_over(found: FoundPoses, others: Sequence[FoundPoses]) -> dict[str, Trajectory]:
    """Return other ways, moved so that they lie best over the one that was found."""
    laid = {}
    for other in others:
        way = other.trajectory
        true, known = found.trajectory.poses_at(way.stamps_ns)
        if known.sum() < 2:
            continue
        moved = align_poses(true[known], way.matrices[known], "se3")
        target, stamps_ns = found.trajectory.target, way.stamps_ns[known]
        laid[other.source] = Trajectory(target, way.source, stamps_ns, moved)
    return laid


def _counts(found: FoundPoses, compared: Sequence[Compared]) -> dict[str, Any]:
    poses = found.trajectory
    steps_m = ((poses.matrices[1:, :3, 3] - poses.matrices[:-1, :3, 3]) ** 2).sum(axis=1) ** 0.5
    sd_m = float(found.known.sd_position_m[-1])
    return {
        "source": found.source,
        "frame_id": poses.target,
        "child_frame_id": poses.source,
        "poses": len(poses),
        "seconds": round(int(poses.stamps_ns[-1] - poses.stamps_ns[0]) / NS_PER_S, 3),
        "way_m": round(float(steps_m.sum()), 3),
        "gaps": len(break_times(found)) - found.jumps,
        "jumps": found.jumps,
        "sd_position_end_m": round(sd_m, 4) if sd_m == sd_m else None,
        "drift": [one.as_json() for one in compared],
    }


def _facts(counts: dict[str, Any]) -> dict[str, str]:
    sd_m = counts["sd_position_end_m"]
    return {
        "source": counts["source"],
        "frames": f"{counts['child_frame_id']} in {counts['frame_id']}",
        "poses": f"{counts['poses']} over {counts['seconds']:.1f} s",
        "way": f"{counts['way_m']:.1f} m",
        "gaps": str(counts["gaps"]),
        "jumps": str(counts["jumps"]),
        "standard deviation of the last position": "not known" if sd_m is None else f"{sd_m:.2f} m",
    }


def _advice(found: FoundPoses) -> list[str]:
    advice = []
    if found.verdict not in (Verdict.GOOD, Verdict.DOUBTFUL):
        advice.append("Do not use poses across the gaps: what lies behind one has no relation")
    if found.source == "lidar" and failed_scans(found):
        advice.append("Try another LiDAR with --topic, or a smaller lidar.voxel_m in --config")
    if found.source != "lidar" and found.verdict is not Verdict.GOOD:
        advice.append("Compare with --source lidar, which needs no fixes")
    return advice
