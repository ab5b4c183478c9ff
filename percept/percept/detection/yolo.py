"""A YOLO network in ONNX that finds objects in images, whatever kind of YOLO it is."""

from __future__ import annotations

import copy
import threading
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError, InputError
from percept.core.results import Detections2D
from percept.detection.boxes.found import FoundBoxes
from percept.detection.boxes.selection import Selection
from percept.detection.images.letterbox import Letterbox
from percept.detection.images.pixels import as_bgr8, name_of_pixels
from percept.detection.images.rectangles import rectangle_for, stride_of_rectangles
from percept.detection.images.tiling import join_regions, regions_of
from percept.detection.networks.decode import decode
from percept.detection.networks.identify import identify
from percept.detection.networks.layout import Layout
from percept.detection.networks.network import Device, open_network
from percept.detection.yolo_config import YoloConfig

__all__ = ["YoloConfig", "YoloDetector"]

_BACKGROUND = 0.05


class YoloDetector:
    """One network, ready to look at images; several threads may call it at once.

    Attributes:
        config: Settings.
        layout: How the network is fed and read; its `why` says how that was found.
        network: The network itself.
        dropped: Boxes that were found and left out, by reason, over all images so far.
    """

    def __init__(
        self,
        path: str | Path,
        config: YoloConfig | None = None,
        *,
        class_names: Sequence[str] | None = None,
        device: Device = "auto",
        threads: int = 1,
    ) -> None:
        """Open a network and find out how it is fed and read.

        Args:
            path: An ONNX file.
            config: Settings; the defaults where it is None.
            class_names: Names by class number; the file's own, or COCO's, where it is None.
            device: `auto`, `cpu`, `cuda` or `openvino`.
            threads: Threads that one call may use inside the network.

        Raises:
            InputError: If the file is no network that can be used, or its kind is ambiguous.
            UsageError: If a setting does not fit the network.
            DependencyError: If the device is not there.
        """
        self.config = config or YoloConfig()
        self.network = open_network(Path(path), device=device, threads=threads)
        self.layout = identify(
            self.network,
            layout=self.config.layout,
            class_names=class_names,
            input_size=self.config.input_size,
            pixels=self.config.pixels,
        )
        self._selection = Selection.of(self.config, self.layout.class_names, path)
        self.dropped = Counter[str]()
        self._lock = threading.Lock()
        self._batch = self.network.image.shape[0] or 1
        self._stride, why = stride_of_rectangles(self.network, self.layout, self.config.input_size)
        reasons = [*self.layout.why, why]
        if self._batch > 1:
            reasons.append(f"batch: all {self._batch} places get one image; export it with batch 1")
        self.layout = replace(self.layout, why=tuple(reasons))

    def detect(self, images: Sequence[NDArray[Any]] | NDArray[Any]) -> list[Detections2D]:
        """Find the objects of each image.

        Boxes are in pixels of the image, counted from the outer edge of its top left pixel. They
        are not clipped: where an object is cut by the image's border, a box may lie a little over
        it. The stamps are 0 and the cameras have no name; who knows them fills them in.

        Args:
            images: Each (H, W, 3) or (H, W) uint8, colour in BGR; or one array (N, H, W, 3).

        Raises:
            GeometryError: If one is no image, or an image is given instead of a list.
            InputError: If the network puts out what is no number.
        """
        if isinstance(images, np.ndarray) and images.ndim < 4:
            raise GeometryError(
                f"one array of shape {images.shape} is no list of images",
                remedy="Give a list, such as [image]",
            )
        found = []
        for number, pixels in enumerate(images):
            try:
                found.append(self.detect_one(pixels)[0])
            except GeometryError as error:
                place = f"image {number} of {len(images)}"
                raise GeometryError(error.what, where=place, remedy=error.remedy) from error
        return found

    def detect_one(self, pixels: NDArray[Any]) -> tuple[Detections2D, dict[str, float]]:
        """Find the objects of one image, and say how long each stage took.

        Args:
            pixels: As for `detect`.

        Returns:
            The boxes, most confident first, and milliseconds of `prepare`, `network` and `boxes`.

        Raises:
            GeometryError: If it is no image.
            InputError: If the network puts out what is no number.
        """
        clock = _StageClock()
        image = as_bgr8(pixels, self.config.white_level)
        image_size = (image.shape[1], image.shape[0])
        regions = regions_of(image_size, self.config.tiles, self.config.tile_overlap)
        parts, gains = [], []
        for x1, y1, x2, y2 in regions:
            found, plan = self._look(image[y1:y2, x1:x2], self._selection.lowest_score, clock)
            parts.append(found)
            gains.append(min(plan.gain))
        joined = join_regions(parts, regions, gains, image_size)
        duplicates = self.layout.needs_nms or len(regions) > 1
        chosen, dropped = self._selection.choose(joined, image_size, duplicates=duplicates)
        with self._lock:
            self.dropped += dropped
        detections = self._named(chosen)
        clock.lap("boxes")
        return detections, clock.milliseconds

    def prepare(self, image: NDArray[np.uint8]) -> tuple[NDArray[Any], Letterbox]:
        """Return the network's input tensor for an image (H, W, 3) uint8 BGR, and its plan.

        Raises:
            GeometryError: If the image has no pixels.
        """
        height, width = image.shape[:2]
        input_size = self.layout.input_size
        if self._stride is not None:
            input_size = rectangle_for((width, height), input_size, self._stride)
        plan = Letterbox.plan((width, height), input_size, self.layout.fit, self.layout.pad)
        tensor = plan.tensor(
            image,
            self.layout.pixels,
            channels_last=self.layout.channels_last,
            dtype=self.network.image.dtype,
        )
        return (np.repeat(tensor, self._batch, axis=0) if self._batch > 1 else tensor), plan

    def best_score(self, pixels: NDArray[Any]) -> float:
        """Return the confidence of the surest box in an image, whatever its class.

        Below 0.05 it is 0, for that is what networks say of background.

        Raises:
            GeometryError: If it is no image.
            InputError: If the network puts out what is no number.
        """
        image = as_bgr8(pixels, self.config.white_level)
        found, _ = self._look(image, _BACKGROUND, _StageClock())
        return float(found.scores.max(initial=0.0))

    def with_layout(self, layout: Layout) -> YoloDetector:
        """Return a detector on the same network that is fed and read otherwise."""
        other = copy.copy(self)
        other.layout = layout
        other.dropped = Counter()
        return other

    def describe(self) -> dict[str, Any]:
        """Return all that was resolved, in the types of JSON."""
        layout = self.layout
        return {
            "path": str(self.network.path),
            "layout": layout.name,
            "input_size": list(layout.input_size),
            "rectangles": self._stride is not None,
            "pixels": name_of_pixels(layout.pixels),
            "fit": layout.fit,
            "class_count": len(layout.class_names) if layout.counts_classes else None,
            "class_names": list(layout.class_names) if layout.counts_classes else None,
            "needs_nms": layout.needs_nms,
            "device": self.network.device,
            "device_note": self.network.device_note,
            "why": list(layout.why),
            "config": self.config.model_dump(mode="json"),
        }

    def _look(
        self, image: NDArray[np.uint8], score: float, clock: _StageClock
    ) -> tuple[FoundBoxes, Letterbox]:
        """Run the network on one image, or a part of one."""
        tensor, plan = self.prepare(image)
        clock.lap("prepare")
        outputs = self.network.run(tensor, plan.image_size)
        clock.lap("network")
        layout = replace(self.layout, input_size=plan.input_size)
        try:
            found = decode(layout, outputs, 0, score)
        except InputError as error:
            where = self.network.path
            raise InputError(error.what, where=where, remedy=error.remedy) from error
        if not self.network.takes_image_size:
            found = replace(found, boxes_px=plan.to_image(found.boxes_px))
        clock.lap("boxes")
        return found, plan

    def _named(self, found: FoundBoxes) -> Detections2D:
        names = self.layout.class_names
        labels = tuple(names[number] for number in found.class_ids)
        return Detections2D(0, "", found.boxes_px, labels, found.scores)


@dataclass(slots=True)
class _StageClock:
    """Adds up the milliseconds of stages that take turns."""

    milliseconds: dict[str, float] = field(default_factory=dict)
    _last_s: float = field(default_factory=time.perf_counter)

    def lap(self, stage: str) -> None:
        now_s = time.perf_counter()
        spent_ms = 1e3 * (now_s - self._last_s)
        self.milliseconds[stage] = self.milliseconds.get(stage, 0.0) + spent_ms
        self._last_s = now_s
