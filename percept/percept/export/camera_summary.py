"""What the networks found in the images of a run, gathered in memory that does not grow."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from percept.core.clock import iso_from_ns
from percept.detection.result import ImageResult, Positions
from percept.export.camera_pictures import boxes_on_image, jpeg_data_uri
from percept.export.detection_summary import band_of
from percept.export.finished import FinishedImage, finished_image
from percept.export.palette import model_colours
from percept.export.report import Picture
from percept.export.running import EvenSample, MillisecondQuantiles

__all__ = ["CameraSummary", "CameraTotals", "ModelTotals"]

_PICTURES = 6
_KINDS = 50


@dataclass(slots=True)
class CameraTotals:
    """Sums over the images of one camera.

    Attributes:
        images: Images, with those that cannot be used.
        failed: Images that cannot be used, by one of the networks or at all.
        sizes: Images by width and height in pixels, such as `1920x1080`.
        decode: Milliseconds for decoding an image.
    """

    images: int = 0
    failed: int = 0
    sizes: Counter[str] = field(default_factory=Counter)
    decode: MillisecondQuantiles = field(default_factory=MillisecondQuantiles)


@dataclass(slots=True)
class ModelTotals:
    """Sums over the images of one camera that one network looked at.

    Attributes:
        images: Images that it looked at.
        boxes: Boxes.
        duplicates: Boxes of objects that another network found with more confidence.
        labels: Boxes by class.
        sources: Boxes by what their position rests on: `cluster`, `depth` or empty.
        stages: Milliseconds by stage, and of all stages as `total`.
    """

    images: int = 0
    boxes: int = 0
    duplicates: int = 0
    labels: Counter[str] = field(default_factory=Counter)
    sources: Counter[str] = field(default_factory=Counter)
    stages: dict[str, MillisecondQuantiles] = field(default_factory=dict)


class CameraSummary:
    """Gathers the images of a run for its report.

    Args:
        models: Names of all networks, in the order of their colours.

    Attributes:
        models: Names of all networks.
        cameras: Totals by camera.
        totals: Totals by camera and network.
        ranges: Objects whose position is known, by class and by band of range, named by
            `band_name`; one that several networks found counts once.
        failures: Images that cannot be used, by camera and reason, for `dropped` in `run.json`.
        judged: Images that were judged in this session.
        first_ns: Stamp of the earliest image, or None.
        last_ns: Stamp of the latest image, or None.
    """

    def __init__(self, models: Sequence[str]) -> None:
        self.models = tuple(models)
        self.cameras: dict[str, CameraTotals] = {}
        self.totals: dict[tuple[str, str], ModelTotals] = {}
        self.ranges: dict[str, Counter[int]] = {}
        self.failures: Counter[str] = Counter()
        self.judged = 0
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self._colours = model_colours(models)
        # By camera, and of images that most networks looked at: these say most.
        self._pictures: dict[str, EvenSample[Picture]] = {}
        self._most_models: dict[str, int] = {}

    @property
    def images(self) -> int:
        """Images, with those that cannot be used."""
        return sum(totals.images for totals in self.cameras.values())

    @property
    def failed(self) -> int:
        """Images that cannot be used, by one of the networks or at all."""
        return sum(totals.failed for totals in self.cameras.values())

    @property
    def boxes(self) -> int:
        """Boxes of all networks."""
        return sum(totals.boxes for totals in self.totals.values())

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """A few images with their boxes, evenly over those of each camera, at least one of each."""
        most = max(1, _PICTURES // max(1, len(self._pictures)))
        return tuple(picture for s in self._pictures.values() for picture in s.chosen(most))

    def labels(self) -> dict[str, dict[str, dict[str, int]]]:
        """Return the boxes by network, camera and class, for `run.json`."""
        counts: dict[str, dict[str, dict[str, int]]] = {model: {} for model in self.models}
        for (camera, model), totals in self.totals.items():
            counts[model][camera] = dict(totals.labels.most_common())
        return counts

    def add(self, result: ImageResult) -> None:
        """Add an image that was judged in this session."""
        self.add_finished(finished_image(result), result)
        self.judged += 1
        if result.image is None or (result.failure is not None and not result.boxes):
            return
        most = self._most_models.get(result.camera, 0)
        if len(result.boxes) >= most:
            self._most_models[result.camera] = len(result.boxes)
            sample = self._pictures.setdefault(result.camera, EvenSample(_PICTURES))
            sample.offer(lambda: self._picture(result))

    def add_finished(self, finished: FinishedImage, result: ImageResult) -> None:
        """Add an image of which the pixels are gone: one from the journal of a resumed run.

        Args:
            finished: The image.
            result: Its boxes, as `image_of` gives them.
        """
        camera = self.cameras.setdefault(finished.camera, CameraTotals())
        camera.images += 1
        stamp_ns = finished.stamp_ns
        self.first_ns = stamp_ns if self.first_ns is None else min(self.first_ns, stamp_ns)
        self.last_ns = stamp_ns if self.last_ns is None else max(self.last_ns, stamp_ns)
        if finished.failure is not None:
            camera.failed += 1
            _count(self.failures, f"image of {finished.camera}: {finished.failure}")
        if finished.width_px > 0:
            _count(camera.sizes, f"{finished.width_px}x{finished.height_px}")
            camera.decode.add(finished.decode_ms)
        for model in result.boxes:  # a failure of one network leaves the boxes of the others
            self._add_model(finished, result, model)

    def _add_model(self, finished: FinishedImage, result: ImageResult, model: str) -> None:
        found = result.boxes[model]
        primary = result.primary.get(model, np.ones(len(found), dtype=bool))
        positions = result.positions.get(model) or Positions.unknown(len(found))
        totals = self.totals.setdefault((finished.camera, model), ModelTotals())
        totals.images += 1
        totals.boxes += len(found)
        totals.duplicates += int(np.count_nonzero(~primary))
        totals.labels.update(found.labels)
        totals.sources.update(positions.sources)
        for row in np.flatnonzero(primary & np.isfinite(positions.range_m)).tolist():
            label, range_m = found.labels[row], float(positions.range_m[row])
            self.ranges.setdefault(label, Counter())[band_of(range_m)] += 1
        timings_ms = finished.timings_ms.get(model, {})
        for stage, duration_ms in (*timings_ms.items(), ("total", sum(timings_ms.values()))):
            totals.stages.setdefault(stage, MillisecondQuantiles()).add(duration_ms)

    def _picture(self, result: ImageResult) -> Picture:
        count = sum(len(found) for found in result.boxes.values())
        when = iso_from_ns(result.stamp_ns)
        return Picture(
            jpeg_data_uri(boxes_on_image(result, self._colours)),
            alt=f"Image {result.frame} of {result.camera} with {count} boxes",
            caption=f"Image {result.frame} of {result.camera}, {when}: {count} boxes",
        )


def _count(counts: Counter[str], what: str) -> None:
    """Count something of which a strange log might have ever new kinds."""
    counts[what if what in counts or len(counts) < _KINDS else "others"] += 1
