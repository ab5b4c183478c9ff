"""The part of a report that is about tracks."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from percept.core.clock import seconds_from_ns
from percept.core.trajectory import Trajectory
from percept.export.charts import histogram, timeline
from percept.export.pictures import png_data_uri
from percept.export.report import Block, Paragraph, Picture, Section, Table, svg_picture
from percept.export.track_pictures import trails_from_above
from percept.export.tracking_summary import TrackingSummary, TrackLife

__all__ = ["TrackingReport", "tracking_sections"]

_TRAILS = 300
_PATH_POINTS = 2_000
_LIFE_EDGES_S = (1, 2, 5, 10, 20, 60)
_SPEED_EDGES_MPS = (0.5, 2, 5, 10, 15, 20, 30)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingReport:
    """What a report says about tracks.

    Attributes:
        summary: What was gathered moment by moment.
        poses: Where the vehicle was, in the frame of the tracks, where that is known.
        dropped: What the tracker left out, by reason.
        counts: What else it did, by name, such as how many tracks were joined over a gap.
    """

    summary: TrackingSummary
    poses: Trajectory | None = None
    dropped: Mapping[str, int] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)


def tracking_sections(part: TrackingReport) -> tuple[Section, ...]:
    """Return the sections of a report that are about tracks."""
    lives = [*part.summary.full()]
    if not lives:
        return (Section("Tracks", (Paragraph("Nothing was tracked."), _counts(part))),)
    return (
        Section("Tracks from above", (_picture(part, lives),)),
        Section("Tracks", (*_charts(part.summary, lives), _classes(lives), _counts(part))),
    )


def _picture(part: TrackingReport, lives: list[TrackLife]) -> Block:
    # What has no class is left out first, and lies below the rest.
    drawn = sorted(lives, key=lambda life: (life.label == "unknown", -life.full))[:_TRAILS]
    trails = [(life.label, np.array(life.trail_m.chosen())) for life in reversed(drawn)]
    path = None
    if part.poses is not None and part.poses.target == part.summary.frame_id:
        step = max(1, -(-len(part.poses) // _PATH_POINTS))
        path = part.poses.matrices[::step, :2, 3]
    frame = part.summary.frame_id or "unnamed"
    left_out = f" of {len(lives):,} full tracks, the longest" if len(drawn) < len(lives) else ""
    return Picture(
        png_data_uri(trails_from_above(trails, path)),
        alt=f"{len(drawn)} tracks from above, and the path of the vehicle",
        caption=f"{len(drawn):,} trails{left_out} in frame {frame}; a dot is where one ended.",
    )


def _charts(summary: TrackingSummary, lives: list[TrackLife]) -> list[Block]:
    speeds = _bins("Mean speed of full tracks", "speed, m/s", _SPEED_EDGES_MPS, lives, _mean_mps)
    ages = _bins("Life of full tracks", "life, s", _LIFE_EDGES_S, lives, _life_s)
    points = summary.timeline
    series = {"full tracks": [float(point.full) for point in points]}
    if any(point.trial for point in points):  # with hindsight no track is on trial
        series["tracks on trial"] = [float(point.trial) for point in points]
    chart = timeline(
        "Tracks over time",
        [seconds_from_ns(point.stamp_ns - (summary.first_ns or 0)) for point in points],
        series,
    )
    return [ages, speeds, svg_picture(chart, "Number of full and trial tracks over time")]


def _bins(
    title: str,
    x_label: str,
    edges: tuple[float, ...],
    lives: list[TrackLife],
    value: Callable[[TrackLife], float],
) -> Block:
    """Return bars of tracks by class and by a value between edges."""
    names = [
        f"under {edges[0]:g}",
        *(f"{low:g}-{high:g}" for low, high in pairwise(edges)),
        f"over {edges[-1]:g}",
    ]
    counts: dict[str, list[int]] = {}
    for life in lives:
        row = counts.setdefault(life.label, [0] * len(names))
        row[bisect_right(edges, value(life))] += 1
    stacked = sorted(counts.items(), key=lambda item: (item[0] == "unknown", item[0]))
    chart = histogram(title, x_label, names, dict(stacked))
    return svg_picture(chart, f"Bars of {title.lower()} by class")


def _classes(lives: list[TrackLife]) -> Block:
    rows = []
    for label in sorted({life.label for life in lives}):
        own = [life for life in lives if life.label == label]
        ages = [life.life_s for life in own]
        moments = sum(life.moments for life in own)
        rows.append(
            (
                label,
                f"{len(own):,}",
                f"{float(np.median(ages)):.1f}",
                f"{max(ages):.1f}",
                f"{float(np.median([life.mean_mps for life in own])):.1f}",
                f"{max(life.top_mps for life in own):.1f}",
                f"{sum(life.observed for life in own) / moments:.0%}",
                f"{sum(len(life.labels) > 1 for life in own):,}",
            )
        )
    return Table(
        (
            "class", "full tracks", "median life s", "longest s", "median speed m/s",
            "top speed m/s", "observed", "of several classes",
        ),
        tuple(rows),
        "Full tracks by the class that each had for longest. Observed is the share of moments with "
        "a detection in it; of several classes are tracks whose most probable class changed.",
    )  # fmt: skip


def _counts(part: TrackingReport) -> Block:
    summary = part.summary
    rows = [
        ("moments", summary.moments),
        ("full tracks", sum(1 for _ in summary.full())),
        ("tracks on trial that never became full", summary.never_full),
        *part.counts.items(),
        *((f"left out: {reason}", count) for reason, count in sorted(part.dropped.items())),
    ]
    rows = [(name, count) for name, count in rows if count or name in ("moments", "full tracks")]
    return Table(("what", "count"), tuple((name, f"{count:,}") for name, count in rows))


def _life_s(life: TrackLife) -> float:
    return life.life_s


def _mean_mps(life: TrackLife) -> float:
    return life.mean_mps
