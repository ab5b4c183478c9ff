"""Images as a camera without distortion would have taken them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera, PinholeCamera
from percept.core.errors import GeometryError

__all__ = ["UndistortMaps", "undistort_image", "undistort_maps", "write_undistorted"]


class UndistortMaps(NamedTuple):
    """Where each pixel of the undistorted image comes from.

    Attributes:
        map_x: (H, W) float32 column in the recorded image; -1 where it shows nothing.
        map_y: (H, W) float32 row in the recorded image; -1 where it shows nothing.
        camera: The camera of the undistorted images: a pinhole without distortion.
    """

    map_x: NDArray[np.float32]
    map_y: NDArray[np.float32]
    camera: PinholeCamera


def undistort_maps(camera: Camera) -> UndistortMaps:
    """Return the maps that take the distortion out; K and the image size stay as they are.

    They are those of `cv2.remap`. What the recorded image does not show is marked by -1.
    """
    width, height = camera.image_size
    plain = PinholeCamera(camera.image_size, camera.K, np.zeros(5))
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height))
    places = np.stack([columns.ravel(), rows.ravel()], axis=-1)
    normal = (places - camera.K[:2, 2]) / np.diag(camera.K)[:2]
    pixels, seen = camera.project(np.column_stack([normal, np.ones(len(normal))]))
    source = np.where(seen[:, None], pixels, -1.0).astype(np.float32).reshape(height, width, 2)
    return UndistortMaps(source[..., 0], source[..., 1], plain)


def undistort_image(pixels: NDArray[np.generic], maps: UndistortMaps) -> NDArray[np.generic]:
    """Return an image (H, W) or (H, W, 3) without distortion, black where nothing was seen.

    Raises:
        GeometryError: If the image has another size than the maps.
    """
    if pixels.shape[:2] != maps.map_x.shape:
        height, width = maps.map_x.shape
        raise GeometryError(
            f"the image is {pixels.shape[1]}x{pixels.shape[0]}, the camera's are {width}x{height}"
        )
    black = cv2.BORDER_CONSTANT
    straight = cv2.remap(
        np.asarray(pixels), maps.map_x, maps.map_y, cv2.INTER_LINEAR, borderMode=black
    )
    return np.asarray(straight, dtype=pixels.dtype)


def write_undistorted(
    folder: Path, camera: Camera, images: Iterable[tuple[str, NDArray[np.uint8]]]
) -> None:
    """Write `maps.npz` (map_x, map_y, K) and the images of the camera's size without distortion.

    Args:
        folder: Where to write; the images go into `undistorted/` in it, as PNG.
        camera: The camera that took them.
        images: Names and pixels.
    """
    maps = undistort_maps(camera)
    np.savez_compressed(folder / "maps.npz", map_x=maps.map_x, map_y=maps.map_y, K=maps.camera.K)
    target = folder / "undistorted"
    target.mkdir(exist_ok=True)
    for name, pixels in images:
        if pixels.shape[:2] == maps.map_x.shape:
            straight = np.asarray(undistort_image(pixels, maps), dtype=np.uint8)
            cv2.imwrite(str(target / f"{Path(name).stem}.png"), straight)
