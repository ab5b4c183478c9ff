"""ROS images, raw and compressed, as arrays: grey (H, W) or colour (H, W, 3) in BGR order.

Encodings are those of `sensor_msgs/image_encodings.hpp` and of the `image_transport` plugins
`compressed` and `compressedDepth`.
"""

from __future__ import annotations

import re
import struct
from typing import Any

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from percept.core.errors import DecodeError
from percept.datasets.messages import RosMessage

__all__ = [
    "ENCODED_FORMATS",
    "pixels_of_compressed",
    "pixels_of_file_bytes",
    "pixels_of_image",
    "recorded_file",
]

ENCODED_FORMATS = {b"\xff\xd8\xff": "jpeg", b"\x89PNG\r\n\x1a\n": "png"}
"""First bytes of the image files that are read."""

_OPENCV_TYPES = {"8U": "u1", "16U": "u2", "32F": "f4"}
_COLOUR_CODES = {
    "rgb": cv2.COLOR_RGB2BGR,
    "rgba": cv2.COLOR_RGBA2BGR,
    "bgra": cv2.COLOR_BGRA2BGR,
    "bayer_rggb": cv2.COLOR_BayerRGGB2BGR,
    "bayer_bggr": cv2.COLOR_BayerBGGR2BGR,
    "bayer_gbrg": cv2.COLOR_BayerGBRG2BGR,
    "bayer_grbg": cv2.COLOR_BayerGRBG2BGR,
    "uyvy": cv2.COLOR_YUV2BGR_UYVY,
    "yuy2": cv2.COLOR_YUV2BGR_YUY2,
    "nv12": cv2.COLOR_YUV2BGR_NV12,
    "nv21": cv2.COLOR_YUV2BGR_NV21,
}
_CHANNELS = {"mono": 1, "rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4, "uyvy": 2, "yuy2": 2}
_YUV_NAMES = {
    "yuv422": "uyvy",
    "uyvy": "uyvy",
    "yuv422_yuy2": "yuy2",
    "yuy2": "yuy2",
    "yuyv": "yuy2",
    "nv12": "nv12",
    "nv21": "nv21",
}
_VIDEO_NAMES = ("h264", "h265", "hevc", "avc", "av1", "vp9")
_DEPTH_HEADER_BYTES = 12
_PNG_SIGNATURE_BYTES = 8
# Length, type and checksum around the data of a chunk.
_PNG_CHUNK_FRAME_BYTES = 12
# Deflate packs at most 1030 to 1, a JPEG block of 64 pixels takes at least a bit.
_MOST_PIXELS_A_BYTE = 2000
# Colours of a JPEG file, and what they are decoded to.
_JPEG_COLOURS = {"Gray": "GRAY", "YCbCr": "BGR", "RGB": "BGR"}
_EXTRA_BYTES = re.compile(r"(\d+) extraneous bytes before marker")
_MOST_EXTRA_BYTES = 16


def pixels_of_image(message: RosMessage, topic: str) -> NDArray[Any]:
    """Return the pixels of a `sensor_msgs/Image`.

    Args:
        message: The decoded message.
        topic: Where it comes from, for errors.

    Returns:
        (H, W) or (H, W, 3) BGR; uint8, uint16 or float32 as the encoding says.

    Raises:
        DecodeError: If the encoding is not known, or the data is shorter than the sizes say.
    """
    encoding = str(message.encoding).strip()
    if _is_video(message):
        raise DecodeError(
            "the image message holds video, which is decoded frame by frame nowhere here",
            where=topic,
            remedy="Convert the topic to images, e.g. with ffmpeg_image_transport",
        )
    colours, code, channels = _layout(encoding, topic)
    height = int(message.height)
    if colours in ("nv12", "nv21"):
        if height % 2:
            raise DecodeError(f"a {encoding} image of {height} rows", where=topic)
        height += height // 2
    dtype = np.dtype((">" if message.is_bigendian else "<") + code)
    rows = _rows(message, height, channels, dtype, topic)
    return _as_bgr(rows, colours, topic)


def _is_video(message: RosMessage) -> bool:
    if str(message.encoding).lower().startswith(_VIDEO_NAMES):
        return True
    # Some drivers label H.264 as rgb8: Annex B start code, then an access unit, SPS or IDR slice.
    start = bytes(message.data[:5])
    too_short = len(message.data) < message.height * message.width
    return too_short and start[:4] == b"\0\0\0\1" and start[-1] & 0x1F in (5, 7, 9)


def _layout(encoding: str, topic: str) -> tuple[str, str, int]:
    """Return colour layout, numpy type code and channels of an encoding."""
    name = encoding.lower()
    if name in _YUV_NAMES:
        colours = _YUV_NAMES[name]
        return colours, "u1", _CHANNELS.get(colours, 1)
    for suffix, code in (("16", "u2"), ("8", "u1")):
        colours = name.removesuffix(suffix)
        if name != colours and (colours in _CHANNELS or colours in _COLOUR_CODES):
            return colours, code, _CHANNELS.get(colours, 1)
    kind, _, channels = encoding.upper().partition("C")
    by_channels = {"": "mono", "1": "mono", "3": "bgr", "4": "bgra"}
    if kind in _OPENCV_TYPES and channels in by_channels:
        return by_channels[channels], _OPENCV_TYPES[kind], int(channels or 1)
    raise DecodeError(f"images in the encoding '{encoding}' are not read", where=topic)


def _rows(
    message: RosMessage, height: int, channels: int, dtype: np.dtype[Any], topic: str
) -> NDArray[Any]:
    """Return native-endian rows (H, W) or (H, W, C) without the padding of `step`."""
    width = int(message.width)
    row_bytes = width * channels * dtype.itemsize
    step = int(message.step) or row_bytes
    needed = (height - 1) * step + row_bytes
    if not height or not width:
        raise DecodeError("the image is empty", where=topic)
    if step < row_bytes or len(message.data) < needed:
        raise DecodeError(
            f"{width} x {message.height} pixels in '{message.encoding}' need rows of {row_bytes} "
            f"and {needed} bytes; the message has step {message.step} and {len(message.data)}",
            where=topic,
        )
    data = np.ascontiguousarray(message.data, dtype=np.uint8)
    strides = (step, channels * dtype.itemsize, dtype.itemsize)
    view: NDArray[Any] = np.ndarray((height, width, channels), dtype, data, strides=strides)
    rows = view.astype(dtype.newbyteorder("="))
    return rows[:, :, 0] if channels == 1 else rows


def _as_bgr(rows: NDArray[Any], colours: str, topic: str) -> NDArray[Any]:
    code = _COLOUR_CODES.get(colours)
    if code is None:
        return rows
    try:
        return cv2.cvtColor(rows, code)
    except cv2.error as error:
        raise DecodeError(
            f"{rows.shape[1]} x {rows.shape[0]} pixels cannot be '{colours}' ({error.err})",
            where=topic,
        ) from error


def pixels_of_compressed(
    data: NDArray[np.uint8], description: str, topic: str
) -> tuple[NDArray[Any], str]:
    """Return pixels and file format of a `sensor_msgs/CompressedImage`.

    Args:
        data: (N,) uint8, JPEG or PNG; for `compressedDepth` behind its header of 12 bytes.
        description: The message's format, such as `jpeg`, `rgb8; jpeg compressed bgr8` or
            `16UC1; compressedDepth png`.
        topic: Where it comes from, for errors.

    Raises:
        DecodeError: If it is neither, is cut off, or is declared absurdly large.
    """
    if description.lower().startswith(_VIDEO_NAMES):
        raise DecodeError(f"video ('{description}') is not decoded", where=topic)
    content = bytes(data)
    if "compresseddepth" in description.lower() and content[1:4] != b"PNG":
        return _depth_pixels(content, description, topic), "png"
    pixels, file_format = pixels_of_file_bytes(content, topic)
    # image_transport says behind "compressed" which order the encoder was given.
    encoder_order = description.partition("compressed")[2]
    if "rgb" in encoder_order and pixels.ndim == 3:
        pixels = np.ascontiguousarray(pixels[:, :, ::-1])
    # A mosaic is compressed as the grey image that it looks like.
    colours = description.partition(";")[0].strip().lower().rstrip("0123456789")
    if colours.startswith("bayer_") and pixels.ndim == 2:
        pixels = _as_bgr(pixels, colours, topic)
    return pixels, file_format


def recorded_file(data: NDArray[np.uint8], description: str) -> bytes | None:
    """Return the file in a `sensor_msgs/CompressedImage`, or None where others read it otherwise.

    Colours in another order than files have, mosaics and depths are nothing for image viewers.

    Args:
        data: (N,) uint8 as in `pixels_of_compressed`, which has read it.
        description: The message's format.
    """
    said = description.lower()
    as_it_looks = "rgb" not in said.partition("compressed")[2] and not said.startswith("bayer_")
    return bytes(data) if as_it_looks and "compresseddepth" not in said else None


def _depth_pixels(content: bytes, description: str, topic: str) -> NDArray[Any]:
    """Undo the inverse-depth quantisation that compressedDepth applies to float images."""
    if len(content) < _DEPTH_HEADER_BYTES:
        raise DecodeError("the depth image is cut off", where=topic)
    _, scale, shift = struct.unpack_from("<iff", content)
    pixels, _ = pixels_of_file_bytes(content[_DEPTH_HEADER_BYTES:], topic)
    if not description.upper().startswith("32FC1"):
        return pixels
    depth = np.full(pixels.shape, np.nan, dtype=np.float32)
    known = pixels > 0
    with np.errstate(divide="ignore"):
        depth[known] = scale / (pixels[known].astype(np.float32) - shift)
    return depth


def pixels_of_file_bytes(content: bytes, where: str) -> tuple[NDArray[Any], str]:
    """Return pixels and format (`jpeg` or `png`) of an image file; 16 bits are kept.

    Raises:
        DecodeError: If it is neither, is cut off, or is declared absurdly large.
    """
    file_format = next(
        (name for magic, name in ENCODED_FORMATS.items() if content.startswith(magic)), None
    )
    if file_format is None:
        raise DecodeError("neither JPEG nor PNG", where=where)
    if not _is_complete(content, file_format):
        raise DecodeError(f"the {file_format} image is cut off", where=where)
    width, height = _declared_size(content, file_format)
    if width * height > _MOST_PIXELS_A_BYTE * len(content):
        raise DecodeError(
            f"{len(content)} bytes cannot hold the {width} x {height} pixels that are declared",
            where=where,
        )
    if file_format == "jpeg":
        return _jpeg_pixels(content, where), file_format
    return _opencv_pixels(content, file_format, where), file_format


def _jpeg_pixels(content: bytes, where: str) -> NDArray[Any]:
    """Decode a JPEG with libjpeg-turbo: the bits of OpenCV's decoder in half its time.

    What the library only warns of is refused, because it goes on with made-up pixels; a few
    bytes too many, as webcams write them, change none.
    """
    try:
        _, _, colours, _ = simplejpeg.decode_jpeg_header(content)
        if colours not in _JPEG_COLOURS:
            return _opencv_pixels(content, "jpeg", where)
        wanted = _JPEG_COLOURS[colours]
        try:
            pixels = simplejpeg.decode_jpeg(content, wanted)
        except ValueError as error:
            extra = _EXTRA_BYTES.search(str(error))
            if extra is None or int(extra.group(1)) > _MOST_EXTRA_BYTES:
                raise
            pixels = simplejpeg.decode_jpeg(content, wanted, strict=False)
    except ValueError as error:
        raise DecodeError(f"the jpeg image is damaged ({error})", where=where) from error
    decoded: NDArray[Any] = pixels[:, :, 0] if wanted == "GRAY" else pixels
    return decoded


def _opencv_pixels(content: bytes, file_format: str, where: str) -> NDArray[Any]:
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DecodeError(
            f"the {file_format} image is damaged ({error.err})", where=where
        ) from error
    if pixels is None:
        raise DecodeError(f"the {file_format} image is damaged", where=where)
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        pixels = cv2.cvtColor(pixels, cv2.COLOR_BGRA2BGR)
    return pixels


def _is_complete(content: bytes, file_format: str) -> bool:
    """Look for the end mark: decoders fill what is missing with grey, which passes for a picture.

    In a JPEG it must come behind the last scan, because a thumbnail has an end of its own. In a
    PNG the chunks must lead to it; OpenCV would believe any length that a chunk declares.
    """
    if file_format == "jpeg":
        end = content.rfind(b"\xff\xd9")
        return end >= 0 and content.find(b"\xff\xda", end) < 0
    position = _PNG_SIGNATURE_BYTES
    while position + _PNG_CHUNK_FRAME_BYTES <= len(content):
        kind = content[position + 4 : position + 8]
        position += _PNG_CHUNK_FRAME_BYTES + int.from_bytes(content[position : position + 4])
        if kind == b"IEND":
            return position <= len(content)
    return False


def _declared_size(content: bytes, file_format: str) -> tuple[int, int]:
    """Read (width, height) from the PNG IHDR or the JPEG start-of-frame segment (0, 0: none)."""
    if file_format == "png":
        width, height = struct.unpack_from(">II", content.ljust(24, b"\0"), 16)
        return int(width), int(height)
    position = 2
    while position + 9 <= len(content) and content[position] == 0xFF:
        marker, length = content[position + 1], int.from_bytes(content[position + 2 : position + 4])
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", content, position + 5)
            return int(width), int(height)
        position += 2 + length
    return 0, 0
