"""The report of `percept dataset prepare`: what was chosen, what was not, and what is in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from percept.core.results import Verdict
from percept.datasets.labelling.dropped import DroppedFrame, drop_counts
from percept.datasets.labelling.labelled_set import SPLITS, LabelledSet
from percept.export.camera_pictures import jpeg_data_uri
from percept.export.charts import histogram
from percept.export.dataset_pictures import Grid, chosen_pictures, dropped_pictures
from percept.export.detection_report import closing_sections
from percept.export.report import (
    Block,
    Paragraph,
    Picture,
    ReportContent,
    Section,
    Table,
    svg_picture,
)
from percept.export.split_map import split_maps

__all__ = ["dataset_report"]

_MOST_BARS = 10
_RANGES_M = (10, 20, 30, 40, 50, 60, 80, 100)
_HEIGHTS_PX = (10, 20, 40, 80, 160, 320)
_OTHERS = "others"


def dataset_report(
    labelled: LabelledSet,
    dropped: Sequence[DroppedFrame],
    *,
    verdict: Verdict,
    why: Sequence[str],
    advice: Sequence[str] = (),
    losses: Mapping[str, Sequence[str]] | None = None,
    others: Mapping[str, int] | None = None,
    inputs: Sequence[Mapping[str, object]] = (),
    settings: Mapping[str, object] | None = None,
    notes: Sequence[str] = (),
) -> ReportContent:
    """Return the report of a data set that was prepared.

    Images of the set and pictures of what was dropped are read from their files, a few dozen.

    Args:
        labelled: The set, with its files in its folder.
        dropped: Images that were left out; their pictures are shown while they are there.
        verdict: How far the set can be used.
        why: Reasons for the verdict.
        advice: What to do about it.
        losses: By format that was written, what it cannot hold, as from `export`.
        others: What else was left out, by reason, such as messages that could not be decoded.
        inputs: The files of `run.json`: `path`, `bytes` and what else is known of them.
        settings: The resolved configuration.
        notes: What else a user should know.
    """
    left_out = dict(Counter(drop_counts(dropped)) + Counter(others or {}))
    sections = (
        Section("What is in it", tuple(_contents(labelled))),
        Section("Where the images are from", tuple(_maps(labelled, dropped))),
        Section("Classes", tuple(_classes(labelled))),
        Section("Distances and sizes", tuple(_sizes(labelled))),
        Section("Chosen images", tuple(_chosen(labelled))),
        Section("Images that were left out", tuple(_dropped(dropped, labelled))),
        Section("Formats", tuple(_formats(losses or {}))),
        *closing_sections(dropped=left_out, inputs=inputs, notes=notes, settings=settings or {}),
    )
    return ReportContent(
        title=f"Data set {labelled.name}",
        verdict=verdict,
        why=tuple(why),
        advice=tuple(advice),
        sections=tuple(section for section in sections if section.blocks),
        subtitle=_subtitle(labelled, len(dropped)),
    )


def _subtitle(labelled: LabelledSet, dropped: int) -> str:
    images = sum(len(one.frames) for one in labelled.keyframes)
    return (
        f"{images:,} images at {len(labelled.keyframes):,} moments of {len(labelled.drives)} "
        f"drives, {dropped:,} images left out; {labelled.created}"
    )


def _contents(labelled: LabelledSet) -> Iterator[Block]:
    counts = {name: Counter[str]() for name in ("moments", "images", "boxes", "3D boxes")}
    for one in labelled.keyframes:
        counts["moments"][one.split] += 1
        counts["images"][one.split] += len(one.frames)
        counts["boxes"][one.split] += sum(len(frame.boxes) for frame in one.frames)
        counts["3D boxes"][one.split] += len(one.solids)
    yield _by_split("", counts)
    rows = Counter((one.drive, one.split) for one in labelled.keyframes)
    moments: dict[str, dict[str, int]] = {
        name: {split: rows[name, split] for split in SPLITS} for name in labelled.drives
    }
    yield _by_split("drive", moments, caption="Moments of each drive")
    reasons = Counter(one.reason for one in labelled.keyframes)
    yield Table(
        ("reason", "moments"),
        tuple((reason, f"{count:,}") for reason, count in reasons.most_common()),
        "Why moments were chosen",
    )


def _by_split(name: str, rows: Mapping[str, Mapping[str, int]], *, caption: str = "") -> Table:
    cells = (
        (row, *(f"{counts.get(split, 0):,}" for split in SPLITS), f"{sum(counts.values()):,}")
        for row, counts in rows.items()
    )
    return Table((name, *SPLITS, "all"), tuple(cells), caption)


def _maps(labelled: LabelledSet, dropped: Sequence[DroppedFrame]) -> Iterator[Block]:
    places: dict[str, list[tuple[float, float]]] = {name: [] for name in ("left out", *SPLITS)}
    for one in labelled.keyframes:
        places[one.split].append((one.latitude, one.longitude))
    places["left out"] = [(one.latitude, one.longitude) for one in dropped]
    known = {name: _finite(spots) for name, spots in places.items()}
    drawn = split_maps(known)
    for svg in drawn:
        yield svg_picture(svg, "Places of the images, coloured by split", "A dot is a moment.")
    unknown = sum(len(places[name]) - len(known[name]) for name in SPLITS)
    if unknown:
        yield Paragraph(f"Of {unknown:,} moments it is not known where they are.")


def _finite(
    spots: Sequence[tuple[float, float]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    places = np.array(spots, dtype=np.float64).reshape(-1, 2)
    return places[np.isfinite(places).all(axis=1)]


def _classes(labelled: LabelledSet) -> Iterator[Block]:
    flat: dict[str, Counter[str]] = {label: Counter() for label in labelled.categories}
    solid: dict[str, Counter[str]] = {label: Counter() for label in labelled.categories}
    for one in labelled.keyframes:
        for frame in one.frames:
            for label in frame.boxes.labels:
                flat[label][one.split] += 1
        for label in one.solids.labels:
            solid[label][one.split] += 1
    for title, counts in (("Boxes in images", flat), ("3D boxes", solid)):
        if any(counts.values()):
            yield svg_picture(_class_chart(title, counts), f"{title} by class and split")
            yield _by_split("class", counts, caption=title)


def _class_chart(title: str, counts: Mapping[str, Counter[str]]) -> str:
    order = sorted(counts, key=lambda label: -counts[label].total())
    shown = {label: counts[label] for label in order[:_MOST_BARS]}
    if order[_MOST_BARS:]:
        shown[_OTHERS] = sum((counts[label] for label in order[_MOST_BARS:]), Counter())
    bins = [label if len(label) <= 9 else f"{label[:8]}\u2026" for label in shown]
    stacks: dict[str, list[int]] = {
        split: [row[split] for row in shown.values()] for split in SPLITS
    }
    return histogram(title, "class", bins, stacks)


def _sizes(labelled: LabelledSet) -> Iterator[Block]:
    ranges: dict[str, list[float]] = {split: [] for split in SPLITS}
    heights: dict[str, list[float]] = {split: [] for split in SPLITS}
    for one in labelled.keyframes:
        ranges[one.split] += np.hypot(*one.solids.boxes_m[:, :2].T).tolist()
        for frame in one.frames:
            heights[one.split] += np.diff(frame.boxes.boxes_px[:, 1::2])[:, 0].tolist()
    if any(ranges.values()):
        svg = _stacked("Distance of 3D boxes", "distance from the vehicle, m", ranges, _RANGES_M)
        yield svg_picture(svg, "How far the 3D boxes are, by split")
    if any(heights.values()):
        svg = _stacked("Height of boxes in images", "height, pixels", heights, _HEIGHTS_PX)
        yield svg_picture(svg, "How high the boxes are, by split")


def _stacked(
    title: str, x_label: str, values: Mapping[str, Sequence[float]], edges: Sequence[int]
) -> str:
    """Return a chart of values from 0, from each edge to the next, and from the last on."""
    bins = [f"{low}-{high}" for low, high in zip((0, *edges), edges, strict=False)]
    counts = {
        name: np.histogram(row, [0, *edges, np.inf])[0].tolist() for name, row in values.items()
    }
    return histogram(title, x_label, [*bins, f"{edges[-1]}+"], counts)


def _chosen(labelled: LabelledSet) -> Iterator[Block]:
    for split, grid in chosen_pictures(labelled).items():
        yield _grid(grid, split, f"Images of {split} with their boxes")


def _dropped(dropped: Sequence[DroppedFrame], labelled: LabelledSet) -> Iterator[Block]:
    if not dropped:
        return
    counts = drop_counts(dropped)
    by_drive = {
        name: Counter(one.reason for one in dropped if one.drive == name)
        for name in labelled.drives
    }
    yield Table(
        ("drive", *counts, "all"),
        tuple(
            (name, *(f"{row[reason]:,}" for reason in counts), f"{row.total():,}")
            for name, row in by_drive.items()
        ),
        "Images that were left out, by reason; dropped.parquet names all",
    )
    for reason, grid in dropped_pictures(dropped, labelled.folder).items():
        yield _grid(grid, reason, f"Images left out as {reason}")


def _grid(grid: Grid, name: str, alt: str) -> Picture:
    caption = f"{name}: {grid.shown} of {grid.count:,} images, spread evenly"
    return Picture(jpeg_data_uri(grid.picture), alt, caption)


def _formats(losses: Mapping[str, Sequence[str]]) -> Iterator[Block]:
    if losses:
        cells = ((name, " ".join(lost) or "Nothing is lost.") for name, lost in losses.items())
        yield Table(("format", "what it cannot hold"), tuple(cells))
