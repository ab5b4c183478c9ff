"""Regions that nobody may recognise: nothing is left in them, and the rest of the image stays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.rig import CameraSensor
from percept.core.samples import CameraImage
from percept.datasets.labelling.images.anonymise import Anonymiser, blur_regions
from percept.datasets.labelling.images.image_files import ImageConfig, ImageWriter

_BOX = (20.0, 30.0, 60.0, 50.0)


def _noise(*shape: int, dtype: Any = np.uint8) -> NDArray[Any]:
    white = np.iinfo(dtype).max
    return np.random.default_rng(3).integers(0, white, shape, endpoint=True, dtype=dtype)


def _fine(pixels: NDArray[Any]) -> float:
    """Return how much pixels differ from their neighbours, on the scale of white."""
    return float(np.abs(np.diff(pixels.astype(float), axis=1)).mean() / np.iinfo(pixels.dtype).max)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(80, 120, 3), (80, 120)])
def test_a_region_is_unreadable_and_the_rest_is_untouched(shape: Any, dtype: Any) -> None:
    pixels = _noise(*shape, dtype=dtype)
    before = pixels.copy()
    blurred = blur_regions(pixels, [_BOX])
    np.testing.assert_array_equal(pixels, before)
    assert (blurred.shape, blurred.dtype) == (pixels.shape, pixels.dtype)
    assert _fine(pixels[30:50, 20:60]) > 0.2
    assert _fine(blurred[30:50, 20:60]) < 0.02
    outside = np.ones(pixels.shape[:2], bool)
    outside[26:54, 13:67] = False  # with a margin of 15 %
    np.testing.assert_array_equal(blurred[outside], pixels[outside])


def test_pictures_that_differ_finely_become_the_same() -> None:
    """What is left cannot tell two plates apart whose mean colours are the same."""
    one = np.full((40, 100, 3), 96, np.uint8)
    other = one.copy()
    one[10:30, 20:80:4] += 40
    other[10:30, 22:82:4] += 40
    box = [(18.0, 8.0, 82.0, 32.0)]
    np.testing.assert_array_equal(blur_regions(one, box), blur_regions(other, box))


def test_regions_at_the_border_and_outside() -> None:
    pixels = _noise(50, 60, 3)
    blurred = blur_regions(pixels, [(-20, -10, 12, 9), (55, 45, 90, 70), (200, 200, 240, 230)])
    assert _fine(blurred[:9, :12]) < 0.03
    assert _fine(blurred[46:, 56:]) < 0.03
    np.testing.assert_array_equal(blurred[20:40, 20:50], pixels[20:40, 20:50])


def test_nothing_found_is_the_image_itself() -> None:
    pixels = _noise(20, 20, 3)
    none = np.zeros((0, 4))
    done = Anonymiser({"faces": lambda _: none, "plates": lambda _: none}).anonymise(pixels)
    assert done.pixels is pixels
    assert done.counts == {"faces": 0, "plates": 0}


def test_all_finders_see_the_image_as_it_was() -> None:
    pixels, seen = _noise(60, 80, 3), []

    def finder(box: tuple[float, ...]) -> Any:
        def find(image: NDArray[Any]) -> NDArray[np.float64]:
            seen.append(image.copy())
            return np.array([box])

        return find

    finders = {"faces": finder((0, 0, 40, 40)), "plates": finder((10, 10, 30, 30))}
    done = Anonymiser(finders).anonymise(pixels)
    assert done.counts == {"faces": 1, "plates": 1}
    for image in seen:
        np.testing.assert_array_equal(image, pixels)


def test_the_image_without_distortion_is_made_of_what_is_left(tmp_path: Path) -> None:
    pixels = _noise(200, 320, 3)
    image = CameraImage(
        topic="/c", stamp_ns=0, log_time_ns=0, frame="c", pixels=pixels, file=b"\xff\xd8 as it was"
    )
    K, bent = (190.0, 190.0, 160.0, 100.0), (-0.2, 0.05, 0.0, 0.0, 0.0)
    sensor = CameraSensor("c", None, "c", (320, 200), "pinhole", K, bent, None)
    everywhere = Anonymiser({"faces": lambda _: np.array([[0.0, 0.0, 320.0, 200.0]])})
    writer = ImageWriter(tmp_path, ImageConfig(), rectified_suffix=".png", anonymiser=everywhere)
    done = writer.write(image, "one", sensor)
    assert done.blurred == {"faces": 1}
    for name in ("images/one.jpg", "rectified/one.png"):
        written = cv2.imread(str(tmp_path / name))
        assert written is not None
        assert _fine(written) < 0.02
    assert len([path for path in tmp_path.rglob("*") if path.is_file()]) == 2


@pytest.mark.parametrize(
    "boxes", [[(0, 0, np.nan, 5)], [(5, 0, 1, 5)], [(0, 0, 5)], [(0, 0, np.inf, 5)]]
)
def test_what_is_no_region_is_refused(boxes: Any) -> None:
    with pytest.raises(GeometryError):
        blur_regions(_noise(20, 20, 3), boxes)
