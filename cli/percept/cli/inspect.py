"""`percept inspect`: what is in a log, what is wrong with it and what it is good for."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from percept.cli.options import (
    ConfigOption,
    EndOption,
    JsonOption,
    StartOption,
    named_values,
)
from percept.cli.progress import progress_bar
from percept.core.errors import UsageError

if TYPE_CHECKING:
    from percept.datasets.inspection import InspectConfig, Inspection
    from percept.datasets.recover import RecoveryReport

__all__ = ["inspect"]


def inspect(
    bag: Annotated[
        Path,
        typer.Argument(
            help="The log: a ROS 1 .bag, a ROS 2 folder, a bare .db3 or .mcap, or a folder of "
            "scans.",
            show_default=False,
        ),
    ],
    *,
    recover: Annotated[
        Path | None,
        typer.Option("--recover", metavar="OUT", help="Also write a sound copy of the log here."),
    ] = None,
    rate: Annotated[
        list[str] | None,
        typer.Option(
            "--rate",
            metavar="TOPIC=HZ",
            help="Expected rate of a topic, instead of its median rate. Repeat it for several.",
        ),
    ] = None,
    start: StartOption = None,
    end: EndOption = None,
    config: ConfigOption = None,
    force: Annotated[
        bool, typer.Option("--force", help="Let --recover replace a file that exists.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Say what is in a log, what is wrong with it and which jobs it can be used for.

    Shows rates, gaps, dropped messages, the watchdog's table of late streams, header against
    log clock, sensors and frames. Ends with 4 when the log is bad.

    Example: percept demo --out demo && percept inspect demo/drive.mcap
    """
    from percept.core.settings import load_settings
    from percept.datasets.inspection import InspectConfig

    if start is not None and end is not None and end <= start:
        raise UsageError(f"--end {end:g} is not after --start {start:g}")
    given = {"rates_hz": _rates(rate or [])}
    limits = load_settings(InspectConfig, config, given)
    # The copy comes first, so that an output that cannot be written is known at once.
    recovery = None if recover is None else _recover(bag, recover, force=force)
    inspection = _inspect(bag, limits, start, end)
    if as_json:
        document = inspection.to_dict()
        if recovery is not None:
            document["recovery"] = _as_json(recovery)
        typer.echo(json.dumps(document, indent=2, allow_nan=False))
    else:
        from percept.cli.inspect_tables import print_inspection, print_recovery

        print_inspection(bag, inspection)
        if recovery is not None:
            print_recovery(recovery)
    raise typer.Exit(inspection.verdict.exit_code)


def _recover(bag: Path, out: Path, *, force: bool) -> RecoveryReport:
    from percept.datasets.recover import recover

    with progress_bar("writing the sound copy", None):
        return recover(bag, out, overwrite=force)


def _as_json(report: RecoveryReport) -> dict[str, Any]:
    return {
        "outputs": [str(path) for path in report.outputs],
        "kept": report.kept,
        "messages": sum(report.kept.values()),
        "losses": report.losses,
    }


def _inspect(
    bag: Path, limits: InspectConfig, start_s: float | None, end_s: float | None
) -> Inspection:
    from percept.cli.window import log_window_ns
    from percept.datasets import open_recording
    from percept.datasets.inspection import inspect_recording

    with open_recording(bag) as recording:
        total = sum(topic.count for topic in recording.topics())
        start_ns, end_ns = log_window_ns(recording, start_s, end_s)
        with progress_bar("inspecting", total) as advance:
            return inspect_recording(
                recording,
                limits,
                start_ns=start_ns,
                end_ns=end_ns,
                on_progress=advance,
            )


def _rates(entries: list[str]) -> dict[str, float]:
    rates = {}
    for topic, text in named_values(entries, "--rate").items():
        try:
            rates[topic] = float(text)
        except ValueError as error:
            raise UsageError(f"--rate {topic}={text} is not a number of Hz") from error
    return rates
