"""The run behind `percept lanes`: from images to the JSON objects and the run folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from itertools import chain, islice
from pathlib import Path
from typing import Any

import pyarrow as pa

from percept.cli.interrupts import deferred_interrupt
from percept.cli.lanes.images import LaneImage, camera_of, lane_images
from percept.cli.lanes.request import LaneRequest, LaneRun
from percept.cli.lanes.show import JsonImages
from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder
from percept.core.lane_markings import LaneDetections
from percept.core.results import Verdict
from percept.core.settings import load_settings
from percept.lanes import LaneConfig, detect_lanes, lane_radius

__all__ = ["run_lanes"]

_OUTPUTS = ("overlays", "lanes.json", "lanes.parquet", "report.html")
_PICTURES = 60
_KEPT = 200
_GUESSED = 0.1

_Found = tuple[LaneImage, LaneDetections, dict[str, Any]]


def run_lanes(
    request: LaneRequest, on_image: Callable[[dict[str, Any]], None] | None = None
) -> LaneRun:
    """Look at all images one by one, and fill the run folder if one was asked for.

    Args:
        request: What was asked for.
        on_image: Is called with the JSON object of each image.

    Raises:
        PerceptError: If an image, the rig, a setting or the folder cannot be used.
    """
    config = load_settings(LaneConfig, request.config, request.flags)
    camera = camera_of(request)
    paint_mask = _paint_mask(request.model)
    dropped: Counter[str] = Counter()
    tally = _Tally(on_image)
    with ExitStack() as stack:
        check = stack.enter_context(deferred_interrupt())
        folder = None
        if request.out is not None:
            folder = stack.enter_context(
                RunFolder(request.out, force=request.force, outputs=_OUTPUTS)
            )
        total, images = stack.enter_context(lane_images(request, camera, dropped))
        advance = stack.enter_context(progress_bar("looking for lanes", total))

        def found() -> Iterator[_Found]:
            for number, image in enumerate(images):
                if folder is not None and number == 0:
                    folder.begin(_inputs(request))
                seen = detect_lanes(image.pixels, camera, config, paint_mask=paint_mask)
                yield image, seen, tally.add(image, seen)
                advance(number + 1)
                check()

        if folder is None:
            for _ in found():
                pass
            return tally.run(dropped)
        writer = _Writer(folder.path)
        writer.images(found())
        run = tally.run(dropped)
        writer.report(run)
        folder.finish(
            config=config.model_dump(mode="json"),
            inputs=[path for path in _inputs(request) if path.is_file()],
            counts=run.counts,
            dropped=run.dropped,
            verdict=run.verdict,
            why=run.why,
        )
    return run


def _inputs(request: LaneRequest) -> tuple[Path, ...]:
    given = [path for path in (request.rig, request.model) if path is not None]
    return (*request.images, *request.bags, *given)


def _paint_mask(model: Path | None) -> Callable[[Any], Any] | None:
    if model is None:
        return None
    from percept.detection.road_lines import RoadLineNetwork

    return RoadLineNetwork(model).mask


class _Tally:
    """Counts what is found, and keeps the first images."""

    def __init__(self, on_image: Callable[[dict[str, Any]], None] | None) -> None:
        self.counts = Counter(
            {"images": 0, "both_lines": 0, "one_line": 0, "no_line": 0, "stop_lines": 0}
        )
        self.first: list[dict[str, Any]] = []
        self._on_image = on_image

    def add(self, image: LaneImage, found: LaneDetections) -> dict[str, Any]:
        """Count an image; return its JSON object, and tell it to who listens."""
        seen = sum(
            line.side in ("left", "right") and line.confidence > _GUESSED for line in found.lines
        )
        self.counts["images"] += 1
        self.counts[("no_line", "one_line", "both_lines")[min(seen, 2)]] += 1
        self.counts["stop_lines"] += len(found.stop_lines)
        document = _document(image, found)
        if len(self.first) < _KEPT:
            self.first.append(document)
        if self._on_image is not None:
            self._on_image(document)
        return document

    def run(self, dropped: Counter[str]) -> LaneRun:
        """Return what was found."""
        verdict, why = _verdict(self.counts)
        return LaneRun(
            images=tuple(self.first),
            counts=dict(self.counts),
            dropped=dict(dropped),
            verdict=verdict,
            why=why,
        )


def _document(image: LaneImage, found: LaneDetections) -> dict[str, Any]:
    from percept.export.lane_document import lane_document

    stamp = {} if image.stamp_ns is None else {"stamp_ns": image.stamp_ns}
    radius = lane_radius(found)
    bend = {"radius_m": None if radius is None else round(radius, 1)}
    return {"image": image.name, **stamp, **lane_document(found), **bend}


def _verdict(counts: Counter[str]) -> tuple[Verdict, tuple[str, ...]]:
    if counts["images"] == 0:
        return Verdict.BAD, ("there is no image",)
    if counts["no_line"] == counts["images"]:
        return Verdict.BAD, ("no line of the lane was found",)
    share = counts["both_lines"] / counts["images"]
    why = (f"both lines in {counts['both_lines']} of {counts['images']} images",)
    return (Verdict.GOOD if share >= 0.8 else Verdict.DOUBTFUL), why


class _Writer:
    """Fills the run folder."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._pictures: list[tuple[str, Path]] = []

    def images(self, found: Iterator[_Found]) -> None:
        """Write what is found in images, each as soon as it is there."""
        from percept.export.lane_document import LANES
        from percept.export.tables import write_parquet

        # With the first image an older run in the folder has gone.
        first = list(islice(found, 1))
        with (self._path / "lanes.json").open("w", encoding="utf-8") as file:
            listed = JsonImages(file.write)
            rows = self._rows(chain(first, found), listed)
            write_parquet(self._path / "lanes.parquet", LANES, rows)
            listed.close()

    def _rows(self, found: Iterable[_Found], listed: JsonImages) -> Iterator[pa.RecordBatch]:
        from percept.export.lane_document import lane_rows

        for number, (image, seen, document) in enumerate(found):
            listed.add(document)
            if number < _PICTURES:
                self._picture(number, image, seen)
            yield lane_rows(image.name, image.stamp_ns, seen)

    def _picture(self, number: int, image: LaneImage, found: LaneDetections) -> None:
        from percept.export.lane_document import lane_overlay
        from percept.export.lane_report import write_png

        folder = self._path / "overlays"
        folder.mkdir(exist_ok=True)
        file = folder / f"{number:06d}.png"
        write_png(file, lane_overlay(image.pixels, found))
        self._pictures.append((image.name, file))

    def report(self, run: LaneRun) -> None:
        """Write the report."""
        from percept.export.lane_report import lane_report
        from percept.export.report import write_report

        report = lane_report(
            run.images, run.counts, self._pictures, verdict=run.verdict, why=run.why
        )
        write_report(self._path / "report.html", report)
