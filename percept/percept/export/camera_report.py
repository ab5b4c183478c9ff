"""The part of a detection report that is about cameras and networks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from percept.export.camera_summary import CameraSummary, ModelTotals
from percept.export.charts import histogram
from percept.export.detection_summary import band_name
from percept.export.report import Block, Paragraph, Section, Table, svg_picture

__all__ = ["CameraReport", "camera_sections"]

_ROWS = 100
_BARS = 8
_STAGES = ("prepare", "network", "boxes", "total")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraReport:
    """What a report says about cameras.

    Attributes:
        summary: What was gathered image by image.
        models: By network, how it is read, as `YoloDetector.describe` says it, and `every`: it
            looks at one image of a camera in so many.
        warnings: What a look at the first images of each camera gave cause for.
        wall_s: Seconds that this session took for its images.
        workers: Images that were worked on at once.
    """

    summary: CameraSummary
    models: Mapping[str, Mapping[str, object]]
    warnings: Sequence[str] = ()
    wall_s: float
    workers: int


def camera_sections(part: CameraReport) -> tuple[Section, ...]:
    """Return the sections of a report that are about cameras."""
    summary = part.summary
    return (
        Section("Seen by the cameras", (*_pictures(summary),)),
        Section("Found in the images", (*_found(summary),)),
        Section("Speed of the networks", (*_speed(part),)),
        Section("How the networks are read", (*_reading(part),)),
    )


def _pictures(summary: CameraSummary) -> list[Block]:
    if not summary.pictures:
        return [Paragraph("No image of this session could be drawn.")]
    legend = Paragraph(
        "A thin box without a text is an object that another network found with more confidence."
    )
    return [*summary.pictures, legend] if len(summary.models) > 1 else [*summary.pictures]


def _found(summary: CameraSummary) -> list[Block]:
    blocks: list[Block] = [_ranges(summary)] if summary.ranges else []
    if summary.boxes:
        blocks += [*_classes(summary), _positions(summary)]
    else:
        blocks.append(Paragraph("No network found anything."))
    return [*blocks, _cameras(summary)]


def _ranges(summary: CameraSummary) -> Block:
    bands = range(max(band for counts in summary.ranges.values() for band in counts) + 1)
    totals = {label: counts.total() for label, counts in summary.ranges.items()}
    labels = sorted(totals, key=lambda label: (-totals[label], label))
    counts = {label: [summary.ranges[label][b] for b in bands] for label in labels[:_BARS]}
    if others := labels[_BARS:]:
        counts["others"] = [sum(summary.ranges[label][b] for label in others) for b in bands]
    names = [band_name(band) for band in bands]
    chart = histogram("Objects in the images by range", "range", names, counts)
    return svg_picture(chart, "Bars of objects in the images by range and class")


def _classes(summary: CameraSummary) -> list[Block]:
    cameras = sorted(summary.cameras)
    rows = []
    for model in summary.models:
        by_camera = {camera: _totals(summary, camera, model).labels for camera in cameras}
        labels = sorted({label for counts in by_camera.values() for label in counts})
        sums = {label: sum(by_camera[camera][label] for camera in cameras) for label in labels}
        for label in sorted(labels, key=lambda label: -sums[label]):
            each = (f"{by_camera[camera][label]:,}" for camera in cameras)
            rows.append((model, label, f"{sums[label]:,}", *each))
    table = Table(
        ("network", "class", "boxes", *cameras),
        tuple(rows[:_ROWS]),
        "Boxes by class and camera; an object counts in each image that shows it.",
    )
    more = len(rows) - _ROWS
    return [table, Paragraph(f"And {more:,} more classes.")] if more > 0 else [table]


def _positions(summary: CameraSummary) -> Block:
    rows = []
    for model in summary.models:
        parts = [totals for (_, name), totals in summary.totals.items() if name == model]
        boxes = sum(totals.boxes for totals in parts)
        shares = (
            _share(sum(totals.sources[source] for totals in parts), boxes)
            for source in ("cluster", "depth", "")
        )
        duplicates = sum(totals.duplicates for totals in parts)
        rows.append((model, f"{boxes:,}", *shares, _share(duplicates, boxes)))
    return Table(
        ("network", "boxes", "by LiDAR", "by depth image", "no position", "duplicates"),
        tuple(rows),
        "Where the position of the object in a box is from. A duplicate is a box of an object "
        "that another network found in the same image with more confidence.",
    )


def _cameras(summary: CameraSummary) -> Block:
    rows = tuple(
        (
            name,
            f"{totals.images:,}",
            f"{totals.failed:,}",
            ", ".join(size for size, _ in totals.sizes.most_common()),
            f"{sum(_totals(summary, name, model).boxes for model in summary.models):,}",
        )
        for name, totals in sorted(summary.cameras.items())
    )
    return Table(("camera", "images", "cannot be used", "pixels", "boxes"), rows)


def _speed(part: CameraReport) -> list[Block]:
    summary = part.summary
    rows = tuple(
        _speed_row(part, model, camera)
        for model in summary.models
        for camera in sorted(summary.cameras)
        if (camera, model) in summary.totals
    )
    header = ("network", "camera", "images", "every", "input", "decode ms")
    table = Table(
        (*header, *(f"{stage} ms" for stage in _STAGES), "images/s"),
        rows,
        "Milliseconds an image: the median, and behind the stroke what 95 % do not exceed. The "
        "last column is what one worker can do with this network alone.",
    )
    if not part.wall_s > 0:
        return [table]
    text = (
        f"{summary.judged:,} images in {part.wall_s:,.1f} s with {part.workers} at a time: "
        f"{summary.judged / part.wall_s:,.1f} images/s with all networks on this computer."
    )
    return [Paragraph(text), table]


def _speed_row(part: CameraReport, model: str, camera: str) -> tuple[str, ...]:
    totals = part.summary.totals[camera, model]
    total_ms = totals.stages["total"].total_ms if "total" in totals.stages else 0.0
    decode = part.summary.cameras[camera].decode
    return (
        model,
        camera,
        f"{totals.images:,}",
        str(part.models.get(model, {}).get("every", 1)),
        _size(part.models.get(model, {})),
        f"{decode.quantile_ms(0.5):.1f} / {decode.quantile_ms(0.95):.1f}",
        *(_milliseconds(totals, stage) for stage in _STAGES),
        f"{1000 * totals.images / total_ms:.1f}" if total_ms > 0 else "",
    )


def _reading(part: CameraReport) -> list[Block]:
    names = ("layout", "pixels", "fit", "class_count", "device")
    models = tuple(
        (
            model,
            str(found.get("path", "")),
            _size(found),
            *(str(found.get(name) or "") for name in names),
        )
        for model, found in part.models.items()
    )
    reasons = tuple(
        (model, str(reason))
        for model, found in part.models.items()
        for reason in (*_texts(found.get("why")), *_texts(found.get("device_note")))
    )
    return [
        *(Paragraph(f"Warning: {warning}") for warning in part.warnings),
        Table(("network", "file", "input", "layout", "pixels", "fit", "classes", "device"), models),
        *([Table(("network", "why"), reasons)] if reasons else []),
    ]


def _size(found: Mapping[str, object]) -> str:
    size = found.get("input_size")
    if not isinstance(size, Sequence):
        return ""
    text = "x".join(str(side) for side in size)
    return f"up to {text}" if found.get("rectangles") else text


def _texts(value: object) -> list[str]:
    if isinstance(value, str):
        return [value] if value else []
    return [str(item) for item in value] if isinstance(value, Sequence) else []


def _milliseconds(totals: ModelTotals, stage: str) -> str:
    times = totals.stages.get(stage)
    if times is None:
        return ""
    return f"{times.quantile_ms(0.5):.1f} / {times.quantile_ms(0.95):.1f}"


def _totals(summary: CameraSummary, camera: str, model: str) -> ModelTotals:
    return summary.totals.get((camera, model), ModelTotals())


def _share(part: int, whole: int) -> str:
    return f"{part / whole:.0%}" if whole else ""
