"""The report of `percept lanes`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from percept.core.errors import UsageError
from percept.core.results import Verdict
from percept.export.canvas import Image, resized
from percept.export.pictures import png_data_uri
from percept.export.report import Picture, ReportContent, Section, Table

__all__ = ["lane_report", "write_png"]

_SHOWN = 12
_WIDTH_PX = 640


def write_png(path: Path, image: Image) -> None:
    """Write an image as PNG.

    Raises:
        UsageError: If it cannot be written.
    """
    if not cv2.imwrite(str(path), image):
        raise UsageError("cannot be written", where=path, remedy="Give another --out")


def lane_report(
    images: Sequence[Mapping[str, Any]],
    counts: Mapping[str, int],
    overlays: Sequence[tuple[str, Path]],
    *,
    verdict: Verdict,
    why: tuple[str, ...],
) -> ReportContent:
    """Return the report of a run.

    Args:
        images: The JSON object of each image.
        counts: What was found, in numbers.
        overlays: Name and file of the overlays.
        verdict: How far the result can be trusted.
        why: Reasons for the verdict.
    """
    step = max(1, len(overlays) // _SHOWN)
    pictures = tuple(_picture(name, file) for name, file in overlays[::step][:_SHOWN])
    rows = tuple((name.replace("_", " "), str(count)) for name, count in counts.items())
    lines = tuple(_row(image, line) for image in images[:200] for line in image["lines"])
    header = ("image", "side", "type", "colour", "confidence", "offset m", "sd m")
    advice = () if verdict is Verdict.GOOD else ("Look at the pictures and the notes",)
    return ReportContent(
        title="Lines of the lane",
        verdict=verdict,
        why=why,
        advice=advice,
        sections=(
            Section("Pictures", pictures),
            Section("Counts", (Table(("what", "count"), rows),)),
            Section("Lines", (Table(header, lines, "of the first 200 images"),)),
        ),
    )


def _picture(name: str, file: Path) -> Picture:
    image = cv2.imread(str(file))
    if image is None:
        raise UsageError("cannot be read again", where=file)
    small = resized(np.asarray(image, dtype=np.uint8), _WIDTH_PX / image.shape[1])
    return Picture(png_data_uri(small), f"lines in {name}", name)


def _row(image: Mapping[str, Any], line: Mapping[str, Any]) -> tuple[str, ...]:
    offset = f"{line['points_m'][0][1]:.2f}" if line["points_m"] else ""
    spread = f"{line['sd_m'][0]:.3f}" if line["sd_m"] else ""
    confidence = f"{line['confidence']:.2f}"
    return (
        str(image["image"]), line["side"], line["type"], line["colour"], confidence, offset, spread,
    )  # fmt: skip
