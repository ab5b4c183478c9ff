"""What crops of lights show: drawn heads, hostile crops, and the file of the model."""

from __future__ import annotations

import io
import zipfile
from importlib import resources
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.lights.colours import UNKNOWN, classify_light_crops, light_crops
from percept.lights.crop_features import FEATURES, crop_features

LAMPS = {"red": (60, 40, 250), "yellow": (40, 190, 250), "green": (170, 230, 60)}
UNLIT = {"red": (15, 15, 40), "yellow": (15, 35, 40), "green": (35, 40, 12)}


def head(lit: str | None, height: int = 60, housing: int = 45) -> NDArray[np.uint8]:
    """A drawn head before a grey sky, of which at most one lamp shines."""
    picture = np.full((120, 52, 3), 190, np.uint8)
    cv2.rectangle(picture, (7, 4), (44, 115), (housing,) * 3, -1)
    for number, colour in enumerate(LAMPS):
        shown = LAMPS[colour] if colour == lit else UNLIT[colour]
        cv2.circle(picture, (26, 24 + 36 * number), 14, shown, -1)
    blurred = cv2.GaussianBlur(picture, (0, 0), 1.5)
    small = cv2.resize(
        blurred, (max(round(52 * height / 120), 2), height), interpolation=cv2.INTER_AREA
    )
    return np.asarray(small, dtype=np.uint8)


@pytest.mark.parametrize("height", [8, 12, 24, 60, 240])
def test_drawn_heads_are_read(height: int) -> None:
    crops = [head(lit, height) for lit in (*LAMPS, None)]
    answers = classify_light_crops(crops)
    assert [state for state, _ in answers] == ["red", "yellow", "green", "off"]
    assert all(0.6 <= probability <= 1 for _, probability in answers)


def test_nothing_red_is_called_green_while_it_fades() -> None:
    """From a bright red head to grey: red, then nothing, never green."""
    red = head("red").astype(np.float64)
    grey = np.full_like(red, red.mean())
    shares = np.linspace(0, 1, 41)[:, None, None, None]
    fading = ((1 - shares) * red + shares * grey).astype(np.uint8)
    states = [state for state, _ in classify_light_crops(list(fading))]
    assert states[0] == "red"
    assert "green" not in states
    assert states[-1] == UNKNOWN


@pytest.mark.parametrize("colour", [(235, 206, 135), (120, 120, 120), (255, 255, 255)])
def test_a_crop_in_which_nothing_stands_out_is_unknown(colour: tuple[int, int, int]) -> None:
    crop = np.full((30, 12, 3), colour, np.uint8)
    assert classify_light_crops([crop]) == [(UNKNOWN, 0.0)]


def test_crops_without_pixels_are_unknown_and_tiny_ones_are_answered() -> None:
    empty = np.zeros((0, 5, 3), np.uint8)
    tiny = np.full((1, 1, 3), 9, np.uint8)
    assert classify_light_crops([empty]) == [(UNKNOWN, 0.0)]
    assert len(classify_light_crops([tiny, head("red")])) == 2
    assert classify_light_crops([]) == []


@pytest.mark.parametrize(
    "crop", [np.zeros((9, 9), np.uint8), np.zeros((9, 9, 4), np.uint8), np.zeros((9, 9, 3))]
)
def test_what_is_no_picture_is_refused(crop: NDArray[Any]) -> None:
    with pytest.raises(GeometryError, match="a crop is"):
        classify_light_crops([crop])


def test_crops_are_what_boxes_cover() -> None:
    image = np.arange(40 * 60 * 3, dtype=np.uint32).astype(np.uint8).reshape(40, 60, 3)
    boxes = np.array([[10.4, 5.0, 12.6, 9.0], [-5, -5, 3, 2], [58.5, 38, 90, 90], [70, 50, 80, 60]])
    crops = light_crops(image, boxes)
    assert [crop.shape[:2] for crop in crops] == [(4, 3), (2, 3), (2, 2), (0, 0)]
    np.testing.assert_array_equal(crops[0], image[5:9, 10:13])
    assert light_crops(image, np.zeros((0, 4))) == []


def test_features_are_numbers_of_about_one() -> None:
    for crop in (head("green"), np.zeros((3, 400, 3), np.uint8), head(None, 8)):
        features = crop_features(crop)
        assert features.shape == (FEATURES,)
        assert np.abs(features).max() <= 2


def test_the_model_is_plain_arrays() -> None:
    raw = (resources.files("percept.lights") / "light_colours.npz").read_bytes()
    with np.load(io.BytesIO(raw), allow_pickle=False) as stored:
        assert stored["states"].tolist() == ["red", "yellow", "green", "off"]
        assert stored["weights"].shape == (4, FEATURES)
        assert stored["least"].argmax() == 2  # green asks for the most
        assert 0 < stored["most_red"] <= 0.05
        assert all(stored[name].dtype != object for name in stored.files)
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        assert {name.removesuffix(".npy") for name in archive.namelist()} == {
            "states", "weights", "bias", "least", "most_red",
        }  # fmt: skip
    assert len(raw) < 20_000
