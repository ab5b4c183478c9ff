"""The end of a run of `percept detect`: its verdict, its report and `run.json`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from percept.cli.detect.lidar_part import LidarPart
from percept.cli.detect.outputs import RunOutputs
from percept.cli.detect.over_time import OverTime
from percept.cli.detect.plan import RunPlan
from percept.cli.detect.poses import describe_poses
from percept.cli.detect.verdict import CameraFacts, RunFacts, judge
from percept.cli.run_folder import RunFolder, describe_input
from percept.cli.track.report import over_time_sections
from percept.datasets.recording import Recording
from percept.detection.cores import available_cores
from percept.export.camera_report import CameraReport
from percept.export.camera_summary import CameraSummary
from percept.export.detection_report import detection_report
from percept.export.detection_summary import DetectionSummary
from percept.export.health import health_as_json
from percept.export.report import write_report

__all__ = ["PassFacts", "conclude"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PassFacts:
    """What the pass over the log knows besides what was found.

    Attributes:
        dropped: What it left out, by reason.
        off_turn: Images at which it was no network's turn.
        wall_s: Seconds that it took in this session.
        notes: What should be known of the files that were written.
    """

    dropped: Mapping[str, int]
    off_turn: int = 0
    wall_s: float
    notes: Sequence[str] = ()


def conclude(
    folder: RunFolder,
    recording: Recording,
    plan: RunPlan,
    outputs: RunOutputs,
    over_time: OverTime | None,
    facts: PassFacts,
) -> dict[str, Any]:
    """Judge a run, and write the report and `run.json`; return the content of the latter."""
    scans, images = outputs.scans, outputs.images
    losses = _losses(recording, plan)
    verdict, why, advice = judge(
        None if plan.lidars is None else _scan_facts(plan.lidars, plan, scans, losses),
        None if plan.cameras is None else _camera_facts(plan, images, losses),
        None if over_time is None else over_time.facts(scans.frames, images.images),
    )
    notes = [*plan.all_notes, *facts.notes]
    left_out = {**losses, **facts.dropped}
    if over_time is not None:
        notes += over_time.followed.notes
        left_out |= over_time.followed.dropped
    if plan.lidars is not None:
        left_out = {**plan.lidars.losses, **left_out}
    content = detection_report(
        scans,
        title=f"Objects in {recording.paths[0].name}",
        verdict=verdict,
        why=why,
        advice=advice,
        inputs=[describe_input(path) for path in plan.files(recording)],
        settings=plan.config.model_dump(mode="json"),
        losses=left_out,
        notes=notes,
        cameras=None if plan.cameras is None else _report_part(plan, images, facts),
        more=()
        if over_time is None
        else over_time_sections(over_time.followed, over_time.trajectory, over_time.health),
    )
    write_report(folder.path / "report.html", content)
    return folder.finish(
        config=_resolved(plan, over_time),
        inputs=plan.files(recording),
        counts=_counts(plan, outputs, over_time, facts),
        dropped={**scans.dropped, **images.failures, **left_out},
        verdict=verdict,
        why=why,
        notes=notes,
        health=None if over_time is None else health_as_json(over_time.health),
    )


def _losses(recording: Recording, plan: RunPlan) -> dict[str, int]:
    """Return what reading the log lost, without the images: each of those is named for itself."""
    topics = () if plan.cameras is None else tuple(plan.cameras.cameras)
    own = tuple(f"{what} {t} that" for what in ("messages on", "files of") for t in topics)
    return {reason: n for reason, n in recording.losses.items() if not reason.startswith(own)}


def _scan_facts(
    lidars: LidarPart, plan: RunPlan, summary: DetectionSummary, losses: Mapping[str, int]
) -> RunFacts:
    mountings = {name: detector.mounting for name, detector in lidars.detectors.items()}
    given = plan.config.lidar.sensor_height_m is not None
    return RunFacts(
        frames=summary.frames,
        objects=summary.objects,
        points=summary.points,
        ground_points=summary.ground_points,
        losses=losses,
        missing=dict(lidars.streams.missing),
        height_spread_m={} if given else {n: m.sd_height_m for n, m in mountings.items()},
        height_errors_m={
            n: m.height_m - m.found_height_m
            for n, m in mountings.items()
            if given and m.clouds_used
        },
    )


def _camera_facts(plan: RunPlan, summary: CameraSummary, losses: Mapping[str, int]) -> CameraFacts:
    boxes = dict.fromkeys(summary.models, 0)
    placeable = plan.cameras.places(plan.lidars) if plan.cameras is not None else {}
    found = dict.fromkeys(placeable, 0)
    placed = dict.fromkeys(placeable, 0)
    for (camera, model), totals in summary.totals.items():
        boxes[model] += totals.boxes
        if camera in placeable:
            found[camera] += totals.boxes
            placed[camera] += sum(n for source, n in totals.sources.items() if source)
    return CameraFacts(
        images={name: totals.images for name, totals in summary.cameras.items()},
        unusable={name: totals.failed for name, totals in summary.cameras.items()},
        boxes=boxes,
        without_places={name: n for name, n in found.items() if n and not placed[name]},
        losses=losses,
    )


def _report_part(plan: RunPlan, summary: CameraSummary, facts: PassFacts) -> CameraReport:
    models = plan.cameras.models if plan.cameras is not None else ()
    return CameraReport(
        summary=summary,
        models={model.name: model.describe() for model in models},
        warnings=[f"{model.name}: {note}" for model in models for note in model.notes],
        wall_s=facts.wall_s,
        workers=available_cores(),
    )


def _resolved(plan: RunPlan, over_time: OverTime | None) -> dict[str, Any]:
    """Return the settings with all that was found out about sensors and networks."""
    config = plan.config.model_dump(mode="json")
    config["sensors"] = plan.lidars.describe() if plan.lidars is not None else []
    if over_time is not None and over_time.poses is not None:
        config["poses"] = describe_poses(over_time.poses)
    if plan.map_file is not None:
        config["map"] = str(plan.map_file)
    if plan.cameras is not None:
        config["cameras"] = plan.cameras.describe()
        config["models"] = {model.name: model.describe() for model in plan.cameras.models}
    return config


def _counts(
    plan: RunPlan, outputs: RunOutputs, over_time: OverTime | None, facts: PassFacts
) -> dict[str, Any]:
    counts: dict[str, Any] = {}
    scans, images = outputs.scans, outputs.images
    if plan.lidars is not None:
        counts |= {
            "frames": scans.frames,
            "objects": scans.objects,
            "labels": dict(scans.labels.most_common()),
            "points": scans.points,
            "ground_points": scans.ground_points,
        }
    if plan.cameras is not None:
        counts |= {
            "images": images.images,
            "images_unusable": images.failed,
            "images_off_turn": facts.off_turn,
            "images_per_s": round(images.judged / max(facts.wall_s, 1e-3), 2),
            "boxes_2d": images.labels(),
            "boxes_2d_placed": _placed(images),
        }
    if over_time is not None:
        counts |= over_time.followed.counts()
    return counts


def _placed(summary: CameraSummary) -> dict[str, int]:
    """Return the boxes whose place is known, by what it rests on."""
    sources: Counter[str] = Counter()
    for totals in summary.totals.values():
        sources.update(totals.sources)
    return {source: count for source, count in sorted(sources.items()) if source}
