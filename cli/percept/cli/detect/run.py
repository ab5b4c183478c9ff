"""The run behind `percept detect`: from a log to the run folder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import typer

from percept.cli.detect.conclude import conclude
from percept.cli.detect.outputs import OUTPUTS, RunOutputs
from percept.cli.detect.over_time import look_over_time
from percept.cli.detect.plan import RunPlan, plan_run
from percept.cli.detect.request import DetectConfig, DetectRequest
from percept.cli.detect.used_rig import used_rig
from percept.cli.detect.work import work_through
from percept.cli.interrupts import deferred_interrupt
from percept.cli.run_folder import RunFolder, describe_input
from percept.core.rig import load_rig, rig_as_yaml
from percept.core.settings import load_settings
from percept.core.transform import Transform
from percept.datasets import open_recording
from percept.datasets.recording import Recording

__all__ = ["run_detection"]


def run_detection(request: DetectRequest) -> dict[str, Any]:
    """Detect objects in a log and fill the run folder; return the content of `run.json`.

    Raises:
        PerceptError: If the input, a setting or the folder cannot be used.
    """
    config = load_settings(DetectConfig, request.config, dict(request.flags))
    rig = load_rig(request.rig) if request.rig is not None else None
    with (
        deferred_interrupt() as check,
        RunFolder(
            request.out, force=request.force, resume=request.resume, outputs=OUTPUTS
        ) as folder,
        open_recording(list(request.bags)) as recording,
    ):
        plan = plan_run(recording, rig, config, request)
        for note in plan.all_notes:
            typer.echo(f"note: {note}", err=True)
        check()
        folder.begin(
            [*plan.files(recording), *(p for p in (request.rig, request.config) if p is not None)]
        )
        return _fill(folder, recording, plan, request, check)


def _fill(
    folder: RunFolder,
    recording: Recording,
    plan: RunPlan,
    request: DetectRequest,
    check_interrupt: Callable[[], None],
) -> dict[str, Any]:
    fingerprint = _fingerprint(recording, plan, request)
    with RunOutputs(
        folder.path, fingerprint, plan.lidars, plan.cameras, resume=request.resume
    ) as outputs:
        facts = work_through(recording, plan, outputs, check_interrupt)
        outputs.write_detections()
        (folder.path / "rig.yaml").write_text(rig_as_yaml(used_rig(plan)), encoding="utf-8")
        over_time = (
            look_over_time(
                recording,
                plan,
                folder.path,
                wanted=request.poses,
                check_interrupt=check_interrupt,
            )
            if request.track
            else None
        )
        notes = outputs.write_rest(over_time, overlay=request.overlay)
        facts = replace(facts, notes=(*facts.notes, *notes))
        run = conclude(folder, recording, plan, outputs, over_time, facts)
        outputs.remove_journals()
    return run


def _fingerprint(recording: Recording, plan: RunPlan, request: DetectRequest) -> str:
    """Return a text that stands for the version, the inputs, the settings and the sensors."""
    lidars = plan.lidars.streams.sensors if plan.lidars is not None else ()
    facts = {
        "percept": version("percept-toolkit"),
        "inputs": [describe_input(path) for path in plan.files(recording)],
        "config": plan.config.model_dump(mode="json"),
        "window": plan.window_ns,
        "track": request.track,
        "poses": request.poses,
        "origin": request.origin,
        "sensors": [[s.name, s.topic, _numbers(s.T_base_sensor)] for s in lidars],
        "cameras": [] if plan.cameras is None else plan.cameras.describe(),
        "models": [] if plan.cameras is None else [m.describe() for m in plan.cameras.models],
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:32]


def _numbers(transform: Transform | None) -> list[list[float]] | None:
    return None if transform is None else transform.matrix.tolist()
