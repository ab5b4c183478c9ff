"""PointCloud2 in every layout, against points that are known."""

from __future__ import annotations

import itertools
from collections import Counter
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import DecodeError
from percept.core.samples import PointCloud
from percept.datasets.decoding.cloud_layout import CloudLayout, packed_points
from percept.datasets.decoding.point_cloud2 import (
    DATATYPES,
    records_of_livox,
    records_of_point_cloud2,
)
from percept.datasets.decoding.point_records import cloud_from_records

STAMP_NS = 1_700_000_000_000_000_000
CODES = {code: number for number, code in DATATYPES.items()}


def make_message(
    columns: dict[str, tuple[NDArray[Any], str]],
    *,
    height: int = 1,
    big_endian: bool = False,
    point_padding: int = 0,
    row_padding: int = 0,
) -> SimpleNamespace:
    """Lay points out one by one with struct-like slowness: the reference for the fast way."""
    order = ">" if big_endian else "<"
    count = len(next(iter(columns.values()))[0])
    width = count // height
    fields, offset = [], 0
    for name, (_, code) in columns.items():
        fields.append(SimpleNamespace(name=name, offset=offset, datatype=CODES[code], count=1))
        offset += np.dtype(code).itemsize
    data = bytearray()
    for row in range(height):
        for point in range(row * width, (row + 1) * width):
            for values, code in columns.values():
                data += np.asarray(values[point]).astype(order + code).tobytes()
            data += b"\xaa" * point_padding
        data += b"\xbb" * row_padding
    return SimpleNamespace(
        height=height,
        width=width,
        fields=fields,
        is_bigendian=big_endian,
        point_step=offset + point_padding,
        row_step=width * (offset + point_padding) + row_padding,
        data=np.frombuffer(bytes(data), np.uint8),
    )


def decode(message: Any, notes: Counter[str] | None = None) -> PointCloud:
    return cloud_from_records(
        records_of_point_cloud2(message, "/points"),
        Counter() if notes is None else notes,
        topic="/points",
        stamp_ns=STAMP_NS,
        log_time_ns=STAMP_NS,
        frame="lidar",
    )


def make_columns(xyz_code: str = "f4", intensity_code: str = "f4") -> dict[str, Any]:
    rng = np.random.default_rng(3)
    xyz = rng.normal(size=(24, 3)).astype("f4")
    return {
        "x": (xyz[:, 0], xyz_code),
        "y": (xyz[:, 1], xyz_code),
        "z": (xyz[:, 2], xyz_code),
        "intensity": (rng.integers(0, 255, 24).astype("f4"), intensity_code),
        "ring": (np.arange(24) % 4, "u2"),
        "t": (np.arange(24) * 4_000_000, "u4"),
    }


@pytest.mark.parametrize(
    ("xyz", "intensity", "height", "big_endian", "padding"),
    [
        *itertools.product(("f4", "f8"), ("u1", "u2", "f4", "f8"), (1, 4), (False, True), (0, 7)),
    ],
)
def test_every_layout_gives_the_same_cloud(
    xyz: str, intensity: str, height: int, padding: int, *, big_endian: bool
) -> None:
    columns = make_columns(xyz, intensity)
    order = list(columns)
    shuffled = {name: columns[name] for name in order[height:] + order[:height]}
    message = make_message(
        shuffled,
        height=height,
        big_endian=big_endian,
        point_padding=padding,
        row_padding=padding * 3,
    )
    cloud = decode(message)
    expected = np.stack([columns[name][0] for name in "xyz"], axis=1)
    np.testing.assert_array_equal(cloud.points_xyz, expected)
    assert cloud.intensity is not None
    np.testing.assert_array_equal(cloud.intensity, columns["intensity"][0])
    assert cloud.ring is not None
    np.testing.assert_array_equal(cloud.ring, columns["ring"][0])
    assert cloud.offset_ns is not None
    np.testing.assert_array_equal(cloud.offset_ns, columns["t"][0])
    assert (cloud.dropped_nonfinite, cloud.frame, cloud.stamp_ns) == (0, "lidar", STAMP_NS)


@pytest.mark.parametrize("name", ["intensities", "i", "reflectivity", "Intensity"])
def test_names_of_intensity(name: str) -> None:
    columns = make_columns()
    columns[name] = columns.pop("intensity")
    cloud = decode(make_message(columns))
    assert cloud.intensity is not None
    np.testing.assert_array_equal(cloud.intensity, columns[name][0])


@pytest.mark.parametrize("name", ["channel", "line", "laser_id"])
def test_names_of_rings(name: str) -> None:
    columns = make_columns()
    columns[name] = columns.pop("ring")
    cloud = decode(make_message(columns))
    assert cloud.ring is not None
    np.testing.assert_array_equal(cloud.ring, columns[name][0])


def test_points_that_are_not_finite_go_with_all_their_fields() -> None:
    columns = make_columns("f8")
    x = columns["x"][0].astype("f8")
    # The last is finite as a double and infinite as a float.
    x[[1, 5, 9]] = np.nan, np.inf, 1e300
    columns["x"] = (x, "f8")
    columns["t"][0][1] = 4_000_000_000
    keep = np.setdiff1d(np.arange(24), [1, 5, 9])
    cloud = decode(make_message(columns, height=4))
    assert cloud.dropped_nonfinite == 3
    np.testing.assert_array_equal(cloud.points_xyz[:, 1], columns["y"][0][keep])
    assert cloud.ring is not None
    assert cloud.offset_ns is not None
    np.testing.assert_array_equal(cloud.ring, columns["ring"][0][keep])
    np.testing.assert_array_equal(cloud.offset_ns, keep * 4_000_000)


def test_times_that_make_no_sense_are_left_out_and_counted() -> None:
    columns = make_columns()
    columns["timestamp"] = (np.full(24, 5.5e5), "f8")
    del columns["t"]
    notes: Counter[str] = Counter()
    assert decode(make_message(columns), notes).offset_ns is None
    assert decode(make_message(columns), notes).offset_ns is None
    assert list(notes.values()) == [2]
    assert "/points" in next(iter(notes))


def test_seconds_and_nanoseconds_in_two_fields() -> None:
    columns = make_columns()
    del columns["t"]
    columns["time_sec"] = (np.full(24, STAMP_NS // 10**9 - 1), "u4")
    columns["time_nsec"] = (np.full(24, 900_000_000), "u4")
    offsets = decode(make_message(columns)).offset_ns
    assert offsets is not None
    assert set(offsets.tolist()) == {-100_000_000}


def test_strange_fields_that_nobody_reads_do_no_harm() -> None:
    message = make_message(make_columns())
    message.fields += [
        SimpleNamespace(name="", offset=0, datatype=2, count=1),
        SimpleNamespace(name="", offset=1, datatype=2, count=1),
        SimpleNamespace(name="normals", offset=9999, datatype=77, count=3),
    ]
    assert len(decode(message)) == 24


def test_a_count_of_zero_means_one() -> None:
    message = make_message(make_columns())
    message.fields[0].count = 0
    assert len(decode(message)) == 24


def test_row_step_does_not_matter_in_a_single_row() -> None:
    message = make_message(make_columns())
    message.row_step = 3
    assert len(decode(message)) == 24


@pytest.mark.parametrize(("height", "width"), [(0, 0), (1, 0), (0, 10)])
def test_an_empty_cloud(height: int, width: int) -> None:
    message = make_message(make_columns())
    message.height, message.width, message.data = height, width, np.zeros(0, np.uint8)
    cloud = decode(message)
    assert len(cloud) == 0
    assert cloud.ring is not None


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"data": np.zeros(100, np.uint8)}, "100"),
        ({"width": 2**32 - 1}, "need"),
        ({"height": 2**32 - 1, "row_step": 2**32 - 1}, "need"),
        ({"point_step": 2**31}, "need|points of"),
        ({"point_step": 10}, "outside"),
        ({"point_step": 0}, "outside"),
        ({"height": 2, "width": 12, "row_step": 5}, "row_step"),
    ],
)
def test_sizes_that_cannot_be_are_refused(change: dict[str, Any], reason: str) -> None:
    message = make_message(make_columns())
    vars(message).update(change)
    with pytest.raises(DecodeError, match=reason):
        decode(message)


@pytest.mark.parametrize(
    ("index", "change", "reason"),
    [
        (0, {"name": "a"}, "no x, y and z"),
        (0, {"name": "y"}, "twice"),
        (0, {"datatype": 0}, "datatype"),
        (0, {"count": 3}, "3 values"),
        (0, {"offset": 2**32 - 1}, "outside"),
    ],
)
def test_fields_that_cannot_be_are_refused(index: int, change: dict[str, Any], reason: str) -> None:
    message = make_message(make_columns())
    vars(message.fields[index]).update(change)
    with pytest.raises(DecodeError, match=reason):
        decode(message)


def test_livox_times_count_from_the_timebase() -> None:
    points = [
        SimpleNamespace(x=1.0, y=2.0, z=3.0, reflectivity=9, line=2, offset_time=n * 1000)
        for n in range(5)
    ]
    message = SimpleNamespace(timebase=STAMP_NS + 500, points=points)
    records = records_of_livox(message, STAMP_NS, "/livox")
    assert records["offset_time"].tolist() == [500, 1500, 2500, 3500, 4500]
    assert records["line"].tolist() == [2] * 5
    message.timebase = 12
    records = records_of_livox(message, STAMP_NS, "/livox")
    assert records["offset_time"].tolist() == [0, 1000, 2000, 3000, 4000]


def test_another_message_of_livox_name_is_refused() -> None:
    with pytest.raises(DecodeError, match="timebase"):
        records_of_livox(SimpleNamespace(points=[]), STAMP_NS, "/livox")


def test_a_layout_pads_points_and_rows_as_it_says() -> None:
    cloud = PointCloud(
        topic="/top", stamp_ns=0, log_time_ns=0, points_xyz=np.ones((6, 3), np.float32)
    )
    plain = packed_points(cloud, CloudLayout(rows=2))
    assert (plain.width, plain.point_step, plain.row_step, len(plain.data)) == (3, 12, 36, 72)
    padded = packed_points(cloud, CloudLayout(rows=2, point_padding=4, row_padding=8))
    assert (padded.width, padded.point_step, padded.row_step) == (3, 16, 56)
    assert len(padded.data) == 112
    assert not padded.data[48:56].any()
