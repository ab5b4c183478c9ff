"""The tables of `percept inspect`, readable in 100 columns, on a terminal and in a pipe."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from textwrap import wrap

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from percept.datasets.inspection import Inspection
from percept.datasets.inspection.clock import ClockHealth
from percept.datasets.inspection.kinds import SENSOR_KINDS
from percept.datasets.inspection.sensors import (
    CameraSummary,
    GnssSummary,
    ImuSummary,
    LidarSummary,
    SensorSummary,
)
from percept.datasets.inspection.topics import TopicReport
from percept.datasets.inspection.verdict import seconds_as_text
from percept.datasets.recover import RecoveryReport

__all__ = ["print_inspection", "print_recovery"]

_WIDTH = 100
_GAPS_SHOWN = 3
_LATE_SHOWN = 4
_COLOURS = {"good": "green", "doubtful": "yellow", "bad": "red"}


class _Console(Console):
    """A console that leaves a closed pipe to the command line's own catcher."""

    def on_broken_pipe(self) -> None:
        """Let the error through; the base class would end with exit code 1."""
        raise BrokenPipeError


def print_inspection(bag: Path, inspection: Inspection) -> None:
    """Print the inspection of a log on stdout, the most important first."""
    console = _Console(highlight=False)
    if not console.is_terminal:
        console = _Console(highlight=False, width=_WIDTH)
    _print_head(console, bag, inspection)
    start_ns = inspection.start_ns or 0
    tables = (
        _uses(inspection),
        _topics(inspection),
        _sensors(inspection),
        _watchdog(inspection, start_ns),
        _late(inspection, start_ns),
        _gaps(inspection, start_ns),
        _clocks(inspection),
    )
    for table in tables:
        if table.row_count:
            console.print()
            console.print(table)
    if inspection.frames.tree:
        console.print("\n[bold]Frames[/bold]")
        for line in inspection.frames.tree.splitlines():
            console.print(f"  {escape(line)}")


def print_recovery(report: RecoveryReport) -> None:
    """Print on stdout what a recovery has kept and lost."""
    kept, lost = sum(report.kept.values()), sum(report.losses.values())
    console = _Console(highlight=False)
    console.print("\n[bold]Sound copy[/bold]")
    console.print(f"  kept {kept:,} messages on {len(report.kept)} topics")
    for reason, count in sorted(report.losses.items()):
        _print_hanging(console, "  lost: ", f"{reason} ({count:,})")
    if not lost:
        console.print("  nothing was lost")
    for path in report.outputs:
        console.print(f"  {escape(str(path))}", soft_wrap=True)


def _print_head(console: Console, bag: Path, inspection: Inspection) -> None:
    size = sum(file.bytes for file in inspection.files)
    files = f", {len(inspection.files):,} files" if len(inspection.files) > 1 else ""
    console.print(f"[bold]{escape(str(bag))}[/bold]", soft_wrap=True)
    console.print(
        f"{inspection.format}{files}, {_bytes(size)}, {inspection.messages:,} messages on "
        f"{len(inspection.topics)} topics{_span(inspection)}"
    )
    colour = _COLOURS[inspection.verdict]
    console.print(f"\nverdict: [bold {colour}]{inspection.verdict}[/bold {colour}]")
    for reason in inspection.why:
        _print_hanging(console, "  - ", reason)
    for note in inspection.notes:
        _print_hanging(console, "  note: ", note)


def _print_hanging(console: Console, label: str, text: str) -> None:
    lines = wrap(text, console.width - len(label), break_long_words=False, break_on_hyphens=False)
    for index, line in enumerate(lines):
        start = label if index == 0 else " " * len(label)
        console.print(f"{start}{escape(line)}", soft_wrap=True)


def _span(inspection: Inspection) -> str:
    if inspection.start_ns is None:
        return ""
    start = datetime.fromtimestamp(inspection.start_ns / 1e9, UTC)
    return f", {seconds_as_text(inspection.duration_s)} from {start:%Y-%m-%d %H:%M:%S} UTC"


def _table(title: str, columns: Iterable[str], *, right: Iterable[str] = ()) -> Table:
    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    numeric = set(right)
    for column in columns:
        table.add_column(column, justify="right" if column in numeric else "left", overflow="fold")
    return table


def _uses(inspection: Inspection) -> Table:
    table = _table("Can be used for", ("job", "", "with, or why not"))
    for use in inspection.uses:
        mark = "[green]yes[/green]" if use.usable else "[red]no[/red]"
        table.add_row(use.job, mark, escape(use.why))
    return table


def _topics(inspection: Inspection) -> Table:
    numeric = ("messages", "size", "Hz", "jitter", "gaps", "dropped")
    table = _table("Topics", ("topic", "type", *numeric, "verdict"), right=numeric)
    for topic in inspection.topics:
        timing = topic.timing
        rate = "-" if timing.rate_hz is None else f"{timing.rate_hz:.4g}"
        jitter = "-" if timing.jitter_s is None else seconds_as_text(timing.jitter_s)
        table.add_row(
            escape(topic.topic),
            escape(topic.type.rpartition("/")[2]),
            f"{topic.count:,}",
            _bytes(topic.bytes),
            rate if timing.periodic or timing.rate_hz is None else f"~{rate}",
            jitter,
            f"{timing.gap_count:,}" if timing.periodic else "-",
            f"{timing.dropped_estimate:,}" if timing.periodic else "-",
            _verdict(topic),
        )
    return table


def _verdict(topic: TopicReport) -> str:
    if topic.undecodable is not None:
        return "undecodable"
    if topic.kind not in SENSOR_KINDS:
        return "-"
    colour = _COLOURS[topic.verdict]
    return f"[{colour}]{topic.verdict}[/{colour}]"


def _sensors(inspection: Inspection) -> Table:
    table = _table("Sensors", ("topic", "kind", "frame", "delivers"))
    for topic in inspection.topics:
        if topic.sensor is not None:
            table.add_row(
                escape(topic.topic),
                topic.kind,
                escape(topic.frame),
                escape(_delivers(topic.sensor)),
            )
    return table


def _delivers(sensor: SensorSummary) -> str:
    if isinstance(sensor, LidarSummary):
        return _lidar(sensor)
    if isinstance(sensor, CameraSummary):
        return _camera(sensor)
    if isinstance(sensor, ImuSummary):
        orientation = "with" if sensor.orientation else "no"
        return f"|acceleration| {sensor.acceleration_mps2:.2f} m/s^2, {orientation} orientation"
    return _gnss(sensor)


def _lidar(sensor: LidarSummary) -> str:
    parts = [f"{sensor.points:,} points"]
    if sensor.nonfinite_share:
        parts.append(f"{sensor.nonfinite_share:.1%} not finite")
    if sensor.range_m is not None and sensor.elevation_deg is not None:
        low, high = sensor.elevation_deg
        parts.append(f"to {sensor.range_m[1]:.0f} m")
        parts.append(f"{sensor.azimuth_deg} x {low:+.0f}..{high:+.0f} deg")
    if sensor.rings is not None:
        parts.append(f"{sensor.rings} ring{'s' if sensor.rings != 1 else ''}")
    if sensor.intensity is not None:
        parts.append(f"intensity {sensor.intensity[0]:.3g}..{sensor.intensity[1]:.3g}")
    if sensor.scan_s is not None:
        parts.append(f"point times over {seconds_as_text(sensor.scan_s)}")
    fields = (
        ("rings", sensor.rings),
        ("intensity", sensor.intensity),
        ("point times", sensor.scan_s),
    )
    lacking = [name for name, value in fields if value is None]
    return ", ".join(parts) + (f"; no {', '.join(lacking)}" if lacking else "")


def _camera(sensor: CameraSummary) -> str:
    text = f"{sensor.width_px}x{sensor.height_px} {sensor.encoding}, "
    if sensor.info_topic is None:
        return text + "no CameraInfo"
    return text + (f"CameraInfo {sensor.info_problem or 'plausible'}")


def _gnss(sensor: GnssSummary) -> str:
    if sensor.latitude_deg is None or sensor.longitude_deg is None:
        return "no fix"
    text = f"fix at {sensor.latitude_deg:.5f}, {sensor.longitude_deg:.5f}"
    if sensor.horizontal_sd_m is not None:
        text += f" +-{sensor.horizontal_sd_m:.2g} m"
    return text + ("" if sensor.fix_share == 1 else f", {sensor.fix_share:.0%} of the samples")


def _watchdog(inspection: Inspection, start_ns: int) -> Table:
    numeric = ("expected every", "timeout", "late", "times", "longest", "at")
    table = _table("Watchdog", ("topic", *numeric), right=numeric)
    for topic in inspection.topics:
        late = topic.lateness
        if late is None:
            continue
        at = late.longest_start_ns
        table.add_row(
            escape(topic.topic),
            seconds_as_text(late.nominal_s),
            seconds_as_text(late.timeout_s),
            f"{late.late_share:.1%}",
            f"{late.late_spans:,}",
            seconds_as_text(late.longest_s) if late.late_spans else "-",
            "-" if at is None else f"{(at - start_ns) / 1e9:.1f} s",
        )
    return table


def _late(inspection: Inspection, start_ns: int) -> Table:
    table = _table("Late", ("topic", "from, to, and why"))
    for topic in inspection.topics:
        late = topic.lateness
        if late is None or not late.spans:
            continue
        longest = sorted(late.spans, key=lambda span: span.start_ns - span.end_ns)[:_LATE_SHOWN]
        texts = [
            f"{(span.start_ns - start_ns) / 1e9:.1f}..{(span.end_ns - start_ns) / 1e9:.1f} s"
            f" {span.reason}"
            for span in sorted(longest, key=lambda span: span.start_ns)
        ]
        more = late.late_spans - len(texts)
        rest = f" and {more:,} more" if more else ""
        table.add_row(escape(topic.topic), ", ".join(texts) + rest)
    return table


def _gaps(inspection: Inspection, start_ns: int) -> Table:
    table = _table("Gaps", ("topic", "longest (messages that would have fitted in)"))
    for topic in inspection.topics:
        texts = [
            f"{seconds_as_text(gap.length_s)} at {(gap.start_ns - start_ns) / 1e9:.1f} s"
            f" ({gap.dropped:,})"
            for gap in topic.timing.gaps[:_GAPS_SHOWN]
        ]
        more = topic.timing.gap_count - len(texts)
        if texts:
            table.add_row(
                escape(topic.topic), ", ".join(texts) + (f" and {more:,} more" if more else "")
            )
    return table


def _clocks(inspection: Inspection) -> Table:
    numeric = ("log - header", "spread", "drift ppm", "jumps", "disorder", "repeated", "zero")
    table = _table("Header stamps", ("topic", *numeric), right=numeric)
    if inspection.format == "folder":
        # Files have one time each, so that there is nothing to compare.
        return table
    for topic in inspection.topics:
        clock, order = topic.clock, topic.order
        # The stamps of tf are those of several senders, and mean nothing as one stream.
        if topic.kind == "tf" or (clock is None and not order.zero_stamps):
            continue
        table.add_row(
            escape(topic.topic),
            "-" if clock is None else seconds_as_text(clock.offset_s),
            "-" if clock is None else seconds_as_text(clock.spread_s),
            "-" if clock is None else _drift(clock),
            "-" if clock is None else f"{clock.jump_count:,}",
            *(
                _share(count, topic.count)
                for count in (order.header_disorder, order.duplicate_stamps, order.zero_stamps)
            ),
        )
    return table


def _drift(clock: ClockHealth) -> str:
    if clock.drift_ppm is None or clock.drift_sd_ppm is None:
        return "-"
    return f"{clock.drift_ppm:+.1f} ±{clock.drift_sd_ppm:.1f}"


def _share(count: int, of: int) -> str:
    return f"{count / of:.1%}" if count else "0"


def _bytes(size: int) -> str:
    for limit, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= limit:
            return f"{size / limit:.1f} {unit}"
    return f"{size} B"
