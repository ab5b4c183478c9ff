"""PCD files (ascii, binary, binary_compressed) as structured arrays.

Format: pointclouds.org/documentation/tutorials/pcd_file_format.html. What files in the wild
also have is read, too: padding fields named `_` and bytes behind the last point. A COUNT of
zero comes from writers that computed the padding wrongly: the fields behind it are not where the
header puts them, so that they are left out, and counted.
"""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass
from itertools import takewhile
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import DecodeError
from percept.datasets.decoding.point_records import POINT_FIELDS

__all__ = ["read_pcd"]

_LONGEST_HEADER = 1 << 16
_LARGEST_LZF_RATIO = 300
_LONGEST_POINT_BYTES = 1 << 20
_KINDS = {"F": "f", "I": "i", "U": "u"}
_SIZES = {"f": (4, 8), "i": (1, 2, 4, 8), "u": (1, 2, 4, 8)}


@dataclass(frozen=True, slots=True)
class _Field:
    name: str
    kind: str
    size: int
    count: int

    @property
    def bytes(self) -> int:
        return self.size * self.count


class _Header(NamedTuple):
    fields: tuple[_Field, ...]
    points: int
    encoding: str
    data_start: int


def read_pcd(path: Path, notes: Counter[str]) -> NDArray[np.void]:
    """Return the points (N,) with the fields that percept reads.

    Args:
        path: The file.
        notes: Counts fields that had to be left out.

    Raises:
        DecodeError: If the header or the data is not that of a PCD file, or is cut off.
    """
    content = path.read_bytes()
    header = _parse_header(content, path)
    if any(field.count == 0 for field in header.fields):
        notes["PCD fields behind one with COUNT 0 left out, their place is unknown"] += 1
    body = memoryview(content)[header.data_start :]
    if header.encoding == "ascii":
        return _read_ascii(body, header, path)
    if header.encoding == "binary":
        return _read_binary(body, header, path)
    if header.encoding == "binary_compressed":
        return _read_compressed(body, header, path)
    raise DecodeError(f"PCD data is not '{header.encoding}'", where=path)


def _parse_header(content: bytes, path: Path) -> _Header:
    lines: dict[str, list[str]] = {}
    position = 0
    while "DATA" not in lines:
        end = content.find(b"\n", position, _LONGEST_HEADER)
        if end < 0:
            raise DecodeError("no PCD header", where=path)
        words = content[position:end].decode("latin-1").split()
        position = end + 1
        if words and not words[0].startswith("#"):
            lines[words[0].upper()] = words[1:]
    try:
        fields = _parse_fields(lines)
        points = (
            int(lines["POINTS"][0])
            if "POINTS" in lines
            else int(lines["WIDTH"][0]) * int(lines["HEIGHT"][0])
        )
        encoding = lines["DATA"][0].lower()
    except (KeyError, IndexError, ValueError) as error:
        raise DecodeError(f"the PCD header cannot be used ({error})", where=path) from error
    if points < 0 or not 0 < sum(field.bytes for field in fields) <= _LONGEST_POINT_BYTES:
        raise DecodeError("the PCD header cannot be used (points without a size)", where=path)
    return _Header(fields, points, encoding, position)


def _parse_fields(lines: dict[str, list[str]]) -> tuple[_Field, ...]:
    names = lines["FIELDS"]
    sizes = [int(word) for word in lines["SIZE"]]
    kinds = [_KINDS[word.upper()] for word in lines["TYPE"]]
    counts = [int(word) for word in lines.get("COUNT", ["1"] * len(names))]
    fields = tuple(
        _Field(*field)
        for field in zip((n.lower() for n in names), kinds, sizes, counts, strict=True)
    )
    for field in fields:
        if field.count < 0 or field.size < 0:
            raise ValueError(f"the size of '{field.name}' is negative")
        if field.name in POINT_FIELDS and field.size not in _SIZES[field.kind]:
            raise ValueError(f"'{field.name}' has {field.size} bytes")
    wanted = [field.name for field in fields if field.name in POINT_FIELDS]
    if len(set(wanted)) < len(wanted):
        raise ValueError("a field is given twice")
    return fields


def _columns(header: _Header) -> list[tuple[_Field, int]]:
    """Return the fields that are read, with their offsets in a point."""
    found, offset = [], 0
    for field in takewhile(attrgetter("count"), header.fields):
        if field.name in POINT_FIELDS and field.count == 1:
            found.append((field, offset))
        offset += field.bytes
    return found


def _point_bytes(header: _Header) -> int:
    return sum(field.bytes for field in header.fields)


def _empty_records(header: _Header, count: int) -> NDArray[np.void]:
    return np.empty(count, dtype=[(f.name, f"<{f.kind}{f.size}") for f, _ in _columns(header)])


def _read_ascii(body: memoryview, header: _Header, path: Path) -> NDArray[np.void]:
    width = sum(field.count for field in header.fields)
    words = bytes(body).split()
    if len(words) < width * header.points:
        raise DecodeError(
            f"{header.points} points of {width} numbers are declared, there are {len(words)}",
            where=path,
        )
    records = _empty_records(header, header.points)
    table = np.array(words[: width * header.points], dtype=object).reshape(header.points, width)
    column = 0
    for field in header.fields:
        if field.name in (records.dtype.names or ()):
            try:
                # By float64 for all: some writers print integers as "3.0".
                records[field.name] = table[:, column].astype(np.float64)
            except ValueError as error:
                raise DecodeError(
                    f"'{field.name}' is not a number ({error})", where=path
                ) from error
        column += field.count
    return records


def _read_binary(body: memoryview, header: _Header, path: Path) -> NDArray[np.void]:
    step = _point_bytes(header)
    if len(body) < step * header.points:
        raise DecodeError(
            f"{header.points} points of {step} bytes are declared, {len(body)} bytes are there",
            where=path,
        )
    columns = _columns(header)
    dtype = np.dtype(
        {
            "names": [field.name for field, _ in columns],
            "formats": [f"<{field.kind}{field.size}" for field, _ in columns],
            "offsets": [offset for _, offset in columns],
            "itemsize": step,
        }
    )
    return np.frombuffer(body, dtype, count=header.points)


def _read_compressed(body: memoryview, header: _Header, path: Path) -> NDArray[np.void]:
    """Unpack LZF; the fields stand one after the other, each with all its points."""
    from percept.datasets.files.lzf import decompress_lzf

    if len(body) < 8:
        raise DecodeError("the compressed points are cut off", where=path)
    packed_size, size = struct.unpack_from("<II", body)
    packed = np.frombuffer(body, np.uint8)[8 : 8 + packed_size]
    if len(packed) < packed_size or size < _point_bytes(header) * header.points:
        raise DecodeError("the compressed points are cut off", where=path)
    if size > _LARGEST_LZF_RATIO * packed_size:
        raise DecodeError(f"{packed_size} bytes cannot be {size} bytes packed", where=path)
    unpacked = decompress_lzf(packed, size)
    if len(unpacked) != size:
        raise DecodeError("the compressed points are damaged", where=path)
    records = _empty_records(header, header.points)
    for field, offset in _columns(header):
        start = offset * header.points
        records[field.name] = np.frombuffer(
            unpacked, f"<{field.kind}{field.size}", header.points, start
        )
    return records
