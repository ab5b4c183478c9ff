"""Every image encoding against pixels that are known."""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import DecodeError
from percept.datasets.decoding.images import pixels_of_compressed, pixels_of_image

RNG = np.random.default_rng(5)
GREY = RNG.integers(0, 255, (6, 8), dtype=np.uint8)
BGR = RNG.integers(0, 255, (6, 8, 3), dtype=np.uint8)
GREY16 = RNG.integers(0, 65535, (6, 8), dtype=np.uint16)
BGR16 = RNG.integers(0, 65535, (6, 8, 3), dtype=np.uint16)
DEPTH = RNG.normal(size=(6, 8)).astype(np.float32)


def with_alpha(image: NDArray[Any]) -> NDArray[Any]:
    return np.dstack([image, np.full(image.shape[:2], 7, image.dtype)])


def make_message(
    pixels: NDArray[Any],
    encoding: str,
    *,
    padding: int = 0,
    big_endian: bool = False,
    height: int | None = None,
) -> SimpleNamespace:
    rows = pixels.astype(pixels.dtype.newbyteorder(">" if big_endian else "<"))
    data = b"".join(row.tobytes() + b"\xcc" * padding for row in rows)
    return SimpleNamespace(
        height=height or pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=int(big_endian),
        step=len(data) // len(rows),
        data=np.frombuffer(data, np.uint8),
    )


@pytest.mark.parametrize(
    ("encoding", "sent", "expected"),
    [
        ("mono8", GREY, GREY),
        ("8UC1", GREY, GREY),
        ("mono16", GREY16, GREY16),
        ("16UC1", GREY16, GREY16),
        ("32FC1", DEPTH, DEPTH),
        ("bgr8", BGR, BGR),
        ("8UC3", BGR, BGR),
        ("rgb8", BGR[:, :, ::-1], BGR),
        ("rgba8", with_alpha(BGR[:, :, ::-1]), BGR),
        ("bgra8", with_alpha(BGR), BGR),
        ("8UC4", with_alpha(BGR), BGR),
        ("bgr16", BGR16, BGR16),
        ("rgb16", BGR16[:, :, ::-1], BGR16),
        ("rgba16", with_alpha(BGR16[:, :, ::-1]), BGR16),
        ("bgra16", with_alpha(BGR16), BGR16),
    ],
)
@pytest.mark.parametrize("padding", [0, 6])
@pytest.mark.parametrize("big_endian", [False, True])
def test_plain_encodings(
    encoding: str, sent: NDArray[Any], expected: NDArray[Any], padding: int, *, big_endian: bool
) -> None:
    message = make_message(sent, encoding, padding=padding, big_endian=big_endian)
    pixels = pixels_of_image(message, "/camera")
    np.testing.assert_array_equal(pixels, expected)
    assert pixels.dtype == expected.dtype
    assert pixels.dtype.isnative


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_patterns_put_each_colour_where_it_was(pattern: str, bits: int) -> None:
    colour = dict(zip("bgr", (10, 90, 200), strict=True))
    dtype = np.uint8 if bits == 8 else np.uint16
    tile = np.array([colour[letter] for letter in pattern], dtype).reshape(2, 2)
    message = make_message(np.tile(tile, (5, 6)), f"bayer_{pattern}{bits}", padding=2)
    pixels = pixels_of_image(message, "/camera")
    assert pixels.dtype == dtype
    # A flat field: every pixel has the colour of the whole, whatever the interpolation.
    np.testing.assert_array_equal(pixels[2:-2, 2:-2], np.full((6, 8, 3), (10, 90, 200)))


def bgr_of_yuv(y: int, u: int, v: int) -> NDArray[np.float64]:
    """ITU-R BT.601, video range."""
    luma, blue, red = 1.164 * (y - 16), u - 128, v - 128
    return np.array([luma + 2.018 * blue, luma - 0.391 * blue - 0.813 * red, luma + 1.596 * red])


@pytest.mark.parametrize(
    ("encoding", "pair"),
    [
        ("yuv422", (100, 120, 160, 120)),
        ("uyvy", (100, 120, 160, 120)),
        ("yuv422_yuy2", (120, 100, 120, 160)),
        ("yuyv", (120, 100, 120, 160)),
    ],
)
def test_packed_yuv(encoding: str, pair: tuple[int, ...]) -> None:
    sent = np.tile(np.array(pair, np.uint8).reshape(1, 2, 2), (6, 4, 1))
    pixels = pixels_of_image(make_message(sent, encoding, padding=4), "/camera")
    assert pixels.shape == (6, 8, 3)
    np.testing.assert_allclose(pixels[3, 3], bgr_of_yuv(120, 100, 160), atol=2)


@pytest.mark.parametrize(("encoding", "chroma"), [("nv12", (100, 160)), ("nv21", (160, 100))])
def test_planar_yuv(encoding: str, chroma: tuple[int, int]) -> None:
    sent = np.vstack([np.full((6, 8), 120, np.uint8), np.tile(np.array(chroma, np.uint8), (3, 4))])
    pixels = pixels_of_image(make_message(sent, encoding, padding=8, height=6), "/camera")
    assert pixels.shape == (6, 8, 3)
    np.testing.assert_allclose(pixels[3, 3], bgr_of_yuv(120, 100, 160), atol=2)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"encoding": "rgb12"}, "rgb12"),
        ({"encoding": "8UC2"}, "8UC2"),
        ({"encoding": ""}, "''"),
        ({"encoding": "h264"}, "video"),
        ({"width": 2**32 - 1}, "need rows"),
        ({"height": 2**32 - 1}, "need rows"),
        ({"height": 0}, "empty"),
        ({"step": 3}, "need rows"),
        ({"data": np.zeros(10, np.uint8)}, "10"),
        ({"data": np.frombuffer(b"\0\0\0\1\x67\x42\0\x1f", np.uint8)}, "video"),
    ],
)
def test_images_that_cannot_be_are_refused(change: dict[str, Any], reason: str) -> None:
    message = make_message(BGR, "bgr8")
    vars(message).update(change)
    with pytest.raises(DecodeError, match=reason):
        pixels_of_image(message, "/camera")


def test_a_width_that_yuv_cannot_have_is_refused() -> None:
    sent = np.zeros((6, 7, 2), np.uint8)
    with pytest.raises(DecodeError, match="uyvy"):
        pixels_of_image(make_message(sent, "uyvy"), "/camera")


def compressed(image: NDArray[Any], suffix: str) -> NDArray[np.uint8]:
    return np.asarray(cv2.imencode(suffix, image)[1], dtype=np.uint8).reshape(-1)


@pytest.mark.parametrize("image", [GREY, BGR, GREY16, BGR16])
def test_png_keeps_all_bits(image: NDArray[Any]) -> None:
    pixels, file_format = pixels_of_compressed(compressed(image, ".png"), "png", "/camera")
    np.testing.assert_array_equal(pixels, image)
    assert (pixels.dtype, file_format) == (image.dtype, "png")


@pytest.mark.parametrize("description", ["jpeg", "rgb8; jpeg compressed bgr8", "png", ""])
def test_jpeg_is_known_by_its_bytes(description: str) -> None:
    smooth = np.full((16, 16, 3), (200, 60, 20), np.uint8)
    pixels, file_format = pixels_of_compressed(compressed(smooth, ".jpg"), description, "/camera")
    np.testing.assert_allclose(pixels, smooth, atol=3)
    assert file_format == "jpeg"


def test_an_encoder_that_was_given_rgb_is_undone() -> None:
    description = "rgb8; png compressed rgb8"
    pixels, _ = pixels_of_compressed(compressed(BGR, ".png"), description, "/camera")
    np.testing.assert_array_equal(pixels, BGR[:, :, ::-1])


def test_a_compressed_mosaic_gets_its_colours() -> None:
    tile = np.array([[200, 90], [90, 10]], np.uint8)
    data = compressed(np.tile(tile, (5, 6)), ".png")
    pixels, _ = pixels_of_compressed(data, "bayer_rggb8; png compressed", "/camera")
    np.testing.assert_array_equal(pixels[2:-2, 2:-2], np.full((6, 8, 3), (10, 90, 200)))


def test_compressed_depth_of_millimetres() -> None:
    data = np.concatenate([np.zeros(12, np.uint8), compressed(GREY16, ".png")])
    pixels, file_format = pixels_of_compressed(data, "16UC1; compressedDepth png", "/depth")
    np.testing.assert_array_equal(pixels, GREY16)
    assert file_format == "png"


def test_compressed_depth_of_metres_is_inverse_quantised() -> None:
    scale, shift = 100.0, 1.0
    depth = np.array([[1.0, 2.0], [4.0, np.nan]], np.float32)
    levels = np.nan_to_num(scale / depth + shift).astype(np.uint16)
    header = np.frombuffer(struct.pack("<iff", 0, scale, shift), np.uint8)
    data = np.concatenate([header, compressed(levels, ".png")])
    pixels, _ = pixels_of_compressed(data, "32FC1; compressedDepth", "/depth")
    np.testing.assert_allclose(pixels, depth, rtol=1e-6)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_cut_image_is_no_picture_with_a_grey_rest(suffix: str) -> None:
    data = compressed(RNG.integers(0, 255, (64, 64, 3), dtype=np.uint8), suffix)
    for size in (0, 3, 30, len(data) // 2, len(data) - 13):
        with pytest.raises(DecodeError):
            pixels_of_compressed(data[:size], "jpeg", "/camera")


def test_an_absurd_declared_size_is_refused_before_it_is_allocated() -> None:
    data = compressed(BGR, ".png").copy()
    data[16:24] = np.frombuffer(struct.pack(">II", 60000, 60000), np.uint8)
    with pytest.raises(DecodeError, match="60000 x 60000"):
        pixels_of_compressed(data, "png", "/camera")


def test_a_png_chunk_of_an_absurd_length_is_not_believed() -> None:
    for kind in (b"IDAT", b"IEND"):
        data = compressed(GREY, ".png").copy()
        start = data.tobytes().index(kind) - 4
        data[start : start + 4] = (0x7F, 0xFF, 0xFF, 0xFF)
        with pytest.raises(DecodeError, match="cut off"):
            pixels_of_compressed(data, "png", "/camera")


def test_video_and_unknown_bytes_are_refused() -> None:
    with pytest.raises(DecodeError, match="video"):
        pixels_of_compressed(np.zeros(100, np.uint8), "h264", "/camera")
    with pytest.raises(DecodeError, match="neither"):
        pixels_of_compressed(np.zeros(100, np.uint8), "jpeg", "/camera")


def _street() -> NDArray[Any]:
    rng = np.random.default_rng(3)
    return cv2.resize(rng.integers(0, 255, (24, 41, 3), dtype=np.uint8), (327, 189))


@pytest.mark.parametrize("sampling", [0x411111, 0x420000, 0x221111, 0x211111, 0x111111])
@pytest.mark.parametrize("quality", [40, 92])
def test_jpeg_pixels_are_those_of_opencv(sampling: int, quality: int) -> None:
    for picture in (_street(), cv2.cvtColor(_street(), cv2.COLOR_BGR2GRAY)):
        flags = [cv2.IMWRITE_JPEG_QUALITY, quality]
        if picture.ndim == 3 and sampling != 0x420000:
            flags += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
        data = cv2.imencode(".jpg", picture, flags)[1]
        pixels, _ = pixels_of_compressed(data, "jpeg", "/camera")
        np.testing.assert_array_equal(pixels, cv2.imdecode(data, cv2.IMREAD_UNCHANGED))


def test_a_jpeg_with_a_broken_stream_is_no_picture() -> None:
    whole = cv2.imencode(".jpg", _street())[1]
    middle = len(whole) // 2
    broken = np.concatenate([whole[:middle], np.full(400, 0x5A, np.uint8), whole[middle:]])
    with pytest.raises(DecodeError, match="damaged"):
        pixels_of_compressed(broken, "jpeg", "/camera")


def test_a_few_bytes_too_many_change_nothing() -> None:
    whole = cv2.imencode(".jpg", _street())[1]
    longer = np.concatenate([whole[:-2], np.array([1, 2, 3], np.uint8), whole[-2:]])
    pixels, _ = pixels_of_compressed(longer, "jpeg", "/camera")
    np.testing.assert_array_equal(pixels, cv2.imdecode(whole, cv2.IMREAD_COLOR))
