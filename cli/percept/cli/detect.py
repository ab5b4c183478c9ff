"""`percept detect`: objects in a log."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from percept.cli.options import (
    BagOption,
    ConfigOption,
    EndOption,
    ForceOption,
    JsonOption,
    OutOption,
    StartOption,
    named_values,
)

__all__ = ["detect"]


def detect(
    *,
    bag: BagOption,
    out: OutOption,
    rig: Annotated[
        Path | None,
        typer.Option("--rig", help="Rig file: sensors and where they sit; wins over tf_static."),
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic",
            metavar="[SENSOR=]TOPIC",
            help="Use this LiDAR topic, under this name. Repeat it for several.",
        ),
    ] = None,
    lidars: Annotated[
        Literal["merge", "separate"] | None,
        typer.Option(
            "--lidars",
            help="Several LiDARs: one merged cloud in the vehicle's frame, or each by itself. "
            "Default: merge where the place of every one is known.",
            show_default=False,
        ),
    ] = None,
    sensor_height: Annotated[
        float | None,
        typer.Option(
            "--sensor-height",
            metavar="METRES",
            help="Height of the sensor over the ground; measured in the scans where not given.",
        ),
    ] = None,
    rules: Annotated[
        Path | None, typer.Option("--rules", help="YAML file with the classification rules.")
    ] = None,
    config: ConfigOption = None,
    start: StartOption = None,
    end: EndOption = None,
    mcap: Annotated[
        bool, typer.Option("--mcap", help="Write overlay.mcap for Foxglove and rviz too.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run in --out.")
    ] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Find objects in a log: ground removal, clusters, classified 3D boxes.

    Writes detections_3d.parquet, view.rrd, report.html and run.json into --out. Nothing has to
    be configured: every topic with point clouds is used, their places come from the log's
    tf_static, and their heights over the ground are measured.

    Example: percept demo --out demo && percept detect --bag demo/drive.mcap --out run
    """
    from percept.cli.detect_run import DetectRequest, run_detection

    flags = {
        "lidars": lidars,
        "lidar": {
            "sensor_height_m": sensor_height,
            "rules": None if rules is None else str(rules),
        },
    }
    request = DetectRequest(
        bags=tuple(bag),
        out=out,
        rig=rig,
        topics=_named_topics(topic or []),
        config=config,
        flags=flags,
        start_s=start,
        end_s=end,
        overlay=mcap,
        resume=resume,
        force=force,
    )
    run = run_detection(request)
    if as_json:
        typer.echo(json.dumps(run, indent=2))
    else:
        _show(run, out)
    raise typer.Exit(run["exit_code"])


def _named_topics(entries: list[str]) -> dict[str, str]:
    """Split `SENSOR=TOPIC`; a bare topic is named after itself."""
    named = [e if "=" in e else f"{e.strip('/').replace('/', '_')}={e}" for e in entries]
    return named_values(named, "--topic")


def _show(run: dict[str, Any], out: Path) -> None:
    counts = run["counts"]
    labels = ", ".join(f"{count} {label}" for label, count in counts["labels"].items())
    ground = counts["ground_points"] / max(counts["points"], 1)
    typer.echo(f"{counts['frames']} scans, {counts['objects']} boxes ({labels or 'none'})")
    for sensor in run["config"]["sensors"]:
        typer.echo(f"{sensor['name']}: {', '.join(sensor['topics'])}; {_mounting(sensor)}")
    typer.echo(f"{ground:.0%} of {counts['points']} points are ground")
    for reason, count in run["dropped"].items():
        typer.echo(f"left out: {count} x {reason}", err=True)
    typer.echo(f"verdict: {run['verdict']}: {'; '.join(run['why'])}")
    typer.echo(f"look at it: {out / 'report.html'}, or `percept view {out}`")


def _mounting(sensor: dict[str, Any]) -> str:
    origin = "the base frame" if sensor["in_base_frame"] else "the sensor"
    text = f"{origin} is {sensor['height_m']:.2f} m over the ground"
    if sensor["found_height_m"] is None:
        return f"{text} as given; no ground plane was found"
    spread = f"+- {sensor['found_height_sd_m']:.2f} m"
    if sensor["height_m"] == sensor["found_height_m"]:
        text += f" ({spread})"
    else:
        text += f" as given; the scans show {sensor['found_height_m']:.2f} {spread}"
    return f"{text}, tilted {sensor['tilt_deg']:.1f} deg"
