"""The report of `percept eval lanes`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from percept.evaluation.lane_pixels import PixelLaneScores
from percept.evaluation.lane_scores import BandErrors, RoadLaneScores
from percept.export.detection_report import closing_sections
from percept.export.report import ReportContent, Section, Table

__all__ = ["lane_scores_report"]

_SHARES = {
    "both_sides_share": "images with both lines of the lane",
    "stray_share": "points of lines on no line",
    "type_share": "length with the right type",
    "unknown_type_share": "length of unknown type",
    "colour_share": "length with the right colour",
    "unknown_colour_share": "length of unknown colour",
}


def lane_scores_report(
    scores: RoadLaneScores | PixelLaneScores, *, inputs: Sequence[Mapping[str, object]]
) -> ReportContent:
    """Return the report of a scoring of lanes.

    Args:
        scores: The scores.
        inputs: The files that were read: `path` and `bytes`.
    """
    if isinstance(scores, RoadLaneScores):
        title, images, own = "Lanes against the road", scores.frames, _road_sections(scores)
    else:
        title, images = "Lanes against labels in pixels", len(scores.by_image)
        own = _pixels(scores)
    return ReportContent(
        title=title,
        verdict=scores.verdict,
        why=scores.why,
        advice=(),
        sections=(
            *own,
            *closing_sections(dropped=scores.dropped, inputs=inputs, notes=(), settings={}),
        ),
        subtitle=f"{images:,} images",
    )


def _road_sections(scores: RoadLaneScores) -> tuple[Section, ...]:
    figures = scores.document()
    shares = tuple((text, _number(figures[name])) for name, text in _SHARES.items())
    return (
        Section("Lines", (_bands("across the road", scores.lateral_bands()),)),
        Section("Stop lines", (_bands("along the road", scores.stop_line_bands()),)),
        Section("Shares", (Table(("figure", "share"), shares),)),
    )


def _bands(way: str, bands: Mapping[str, BandErrors]) -> Table:
    names = ("count", "mean_abs_m", "mean_m", "p95_abs_m")
    rows = ((band, *(_number(one.document()[n]) for n in names)) for band, one in bands.items())
    header = ("range, m", "count", "mean size, m", "mean, m", "95 % of the sizes, m")
    return Table(header, tuple(rows), f"Error {way}.")


def _pixels(scores: PixelLaneScores) -> tuple[Section, ...]:
    figures = scores.document()
    rows = [(image, *(_number(v) for v in one)) for image, one in scores.by_image.items()]
    rows.append(("all", *(_number(figures[name]) for name in ("accuracy", "fp", "fn"))))
    return (Section("By image", (Table(("image", "accuracy", "FP", "FN"), tuple(rows)),)),)


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:,}" if isinstance(value, int) else f"{value:.3f}"
