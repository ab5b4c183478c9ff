"""The report of `percept detect`: what was found, where, how fast, and what was left out."""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version

from percept.core.clock import iso_from_ns, seconds_from_ns
from percept.core.results import Verdict
from percept.export.camera_report import CameraReport, camera_sections
from percept.export.camera_summary import CameraSummary
from percept.export.charts import histogram, timeline
from percept.export.detection_summary import DetectionSummary, band_name
from percept.export.report import (
    Block,
    Paragraph,
    ReportContent,
    Section,
    Table,
    svg_picture,
)

__all__ = ["closing_sections", "detection_report", "installed_versions"]

_PACKAGES = (
    "percept-toolkit",
    "numpy",
    "numba",
    "opencv-contrib-python-headless",
    "pyarrow",
    "rosbags",
    "mcap",
    "rerun-sdk",
    "onnxruntime",
)


def detection_report(
    summary: DetectionSummary,
    *,
    title: str,
    verdict: Verdict,
    why: Sequence[str],
    advice: Sequence[str],
    inputs: Sequence[Mapping[str, object]],
    settings: Mapping[str, object],
    losses: Mapping[str, int] | None = None,
    notes: Sequence[str] = (),
    cameras: CameraReport | None = None,
    more: Sequence[Section] = (),
) -> ReportContent:
    """Return the report of a detection run.

    Args:
        summary: What was gathered frame by frame.
        title: What was done, to what.
        verdict: How far the result can be trusted.
        why: Reasons for the verdict.
        advice: What to do about it.
        inputs: The files of `run.json`: `path`, `bytes` and what else is known of them.
        settings: The resolved configuration.
        losses: What reading the log lost, by reason; stands beside what detection left out.
        notes: What else should be known, such as what the 3D view leaves out.
        cameras: What the networks found in images; None where none looked. Images that cannot be
            used are among what was left out. A run of cameras alone says nothing of scans.
        more: Sections about what was made of the detections: tracks, lights and health.
    """
    dropped = Counter(summary.dropped)
    dropped.update(losses or {})
    dropped.update(cameras.summary.failures if cameras is not None else {})
    sections = (
        *(_scan_sections(summary) if summary.frames or cameras is None else ()),
        *(camera_sections(cameras) if cameras is not None else ()),
        *more,
        *closing_sections(dropped=dropped, inputs=inputs, notes=notes, settings=settings),
    )
    return ReportContent(
        title=title,
        verdict=verdict,
        why=tuple(why),
        advice=tuple(advice),
        sections=sections,
        subtitle=_subtitle(summary, cameras),
    )


def closing_sections(
    *,
    dropped: Mapping[str, int],
    inputs: Sequence[Mapping[str, object]],
    notes: Sequence[str],
    settings: Mapping[str, object],
) -> tuple[Section, ...]:
    """Return the sections that every report ends with: what it rests on, and what is missing.

    Args:
        dropped: What was left out, by reason.
        inputs: The files of `run.json`: `path`, `bytes` and what else is known of them.
        notes: What else should be known.
        settings: The resolved configuration.
    """
    return (
        Section("What was left out", (_dropped(dropped),)),
        Section("Inputs", (_inputs(inputs), *(Paragraph(note) for note in notes))),
        Section("Settings", (_pairs(("setting", "value"), _flat(settings)),)),
        Section("Versions", (_pairs(("part", "version"), installed_versions()),)),
    )


def installed_versions() -> dict[str, str]:
    """Return the versions that a result depends on, by name."""
    versions = {"Python": platform.python_version(), "system": platform.platform(terse=True)}
    for package in _PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "not installed"
    return versions


def _scan_sections(summary: DetectionSummary) -> tuple[Section, ...]:
    return (
        Section("Seen from above", (*summary.pictures, *_picture_note(summary))),
        Section("What was found", (*_found(summary),)),
        Section("Time by stage", (*_timing(summary),)),
    )


def _subtitle(summary: DetectionSummary, cameras: CameraReport | None) -> str:
    images = cameras.summary if cameras is not None else None
    seen: list[DetectionSummary | CameraSummary] = [summary, *([images] if images else [])]
    first = [part.first_ns for part in seen if part.first_ns is not None]
    last = [part.last_ns for part in seen if part.last_ns is not None]
    if not first or not last:
        return "no scans" if cameras is None else "no scans and no images"
    what = [f"{summary.frames:,} scans and {summary.objects:,} objects"] if summary.frames else []
    if images is not None:
        what.append(f"{images.images:,} images and {images.boxes:,} boxes")
    seconds = seconds_from_ns(max(last) - min(first))
    return f"{', '.join(what)}, {iso_from_ns(min(first))} and {seconds:,.1f} s on"


def _picture_note(summary: DetectionSummary) -> list[Block]:
    if not summary.frames:
        return [Paragraph("There were no scans to draw.")]
    if not summary.pictures:
        return [Paragraph("All scans were finished before the run was resumed: none is drawn.")]
    return []


def _found(summary: DetectionSummary) -> list[Block]:
    bands = sorted({band for counts in summary.ranges.values() for band in counts})
    classes = Table(
        ("class", "objects", *(band_name(band) for band in bands)),
        tuple(
            (label, f"{count:,}", *(f"{summary.ranges[label][band]:,}" for band in bands))
            for label, count in _by_count(summary.labels)
        ),
        "Boxes by class and distance from the sensor; an object counts in each scan that sees it.",
    )
    sensors = Table(
        ("sensor", "frame", "scans", "objects", "points a scan", "ground"),
        tuple(
            (
                name,
                ", ".join(totals.frame_ids),
                f"{totals.frames:,}",
                f"{totals.objects:,}",
                f"{totals.points / totals.frames:,.0f}",
                f"{totals.ground_points / max(totals.points, 1):.0%}",
            )
            for name, totals in sorted(summary.sensors.items())
        ),
    )
    if not summary.objects:
        return [Paragraph("No objects."), sensors]
    return [*_charts(summary), classes, sensors]


def _charts(summary: DetectionSummary) -> list[Block]:
    """Return the objects by distance and class, and over time for each sensor."""
    last = max(band for counts in summary.ranges.values() for band in counts)
    bands = range(last + 1)
    labels = [label for label, _ in _by_count(summary.labels)]
    labels.sort(key=lambda label: label == "unknown")  # what is known stands on the ground line
    by_class = {label: [summary.ranges[label][band] for band in bands] for label in labels}
    distances = histogram("Objects by distance", "distance", [*map(band_name, bands)], by_class)
    pictures = [svg_picture(distances, "Bars of objects by distance and class")]
    for sensor, points in summary.timelines.items():
        seconds = [seconds_from_ns(point.stamp_ns - (summary.first_ns or 0)) for point in points]
        series = {
            "objects a scan": [float(point.objects) for point in points],
            "milliseconds a scan": [point.total_ms for point in points],
        }
        chart = timeline(f"{sensor} over time", seconds, series)
        pictures.append(svg_picture(chart, f"Objects and milliseconds of {sensor} over time"))
    return [*pictures]


def _timing(summary: DetectionSummary) -> list[Block]:
    rows = tuple(
        (
            stage,
            f"{times.quantile_ms(0.5):.1f}",
            f"{times.quantile_ms(0.95):.1f}",
            f"{times.quantile_ms(1.0):.1f}",
            f"{times.total_ms / 1000:,.1f}",
        )
        for stage, times in sorted(summary.stages.items(), key=lambda item: item[0] == "total")
    )
    header = ("stage", "median ms", "95 % ms", "slowest ms", "all s")
    return [Table(header, rows, "Milliseconds a scan, to 1 %.")]


def _dropped(dropped: Mapping[str, int]) -> Block:
    if not any(dropped.values()):
        return Paragraph("Nothing was left out.")
    rows = tuple((reason, f"{count:,}") for reason, count in _by_count(dropped) if count)
    return Table(("reason", "count"), rows)


def _inputs(inputs: Sequence[Mapping[str, object]]) -> Block:
    names = tuple(dict.fromkeys(name for entry in inputs for name in entry))
    rows = tuple(tuple(_text(entry.get(name, "")) for name in names) for entry in inputs)
    return Table(names, rows) if rows else Paragraph("No files.")


def _pairs(header: tuple[str, str], pairs: Mapping[str, str]) -> Block:
    return Table(header, tuple(pairs.items())) if pairs else Paragraph("None.")


def _flat(settings: Mapping[str, object], prefix: str = "") -> dict[str, str]:
    """Return nested settings as dotted names and texts."""
    flat: dict[str, str] = {}
    for name, value in settings.items():
        if isinstance(value, Mapping):
            flat.update(_flat(value, f"{prefix}{name}."))
        else:
            flat[f"{prefix}{name}"] = _text(value)
    return flat


def _text(value: object) -> str:
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)


def _by_count(counts: Mapping[str, int]) -> list[tuple[str, int]]:
    """Return the pairs with the largest counts first, by name where they are equal."""
    return sorted(counts.items(), key=lambda pair: (-pair[1], pair[0]))
