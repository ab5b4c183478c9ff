"""PCD, PLY, npy and bare float files."""

from __future__ import annotations

import io
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import plyfile
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from percept.core.errors import DecodeError, RecordingError
from percept.core.samples import PointCloud
from percept.datasets.files.cloud_files import read_point_cloud
from percept.datasets.files.lzf import decompress_lzf

RNG = np.random.default_rng(11)
POINTS = np.empty(
    500,
    dtype=[("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4"), ("ring", "u2"), ("t", "u4")],
)
for axis, spread in zip("xyz", (30, 20, 1), strict=True):
    POINTS[axis] = RNG.normal(0, spread, 500)
POINTS["intensity"] = RNG.integers(0, 255, 500)
POINTS["ring"] = np.arange(500) % 16
POINTS["t"] = np.arange(500) * 200_000


def pack_lzf(data: bytes) -> bytes:
    """Pack greedily with copies of up to 264 bytes from up to 8192 bytes back."""
    packed, literals, position = bytearray(), bytearray(), 0
    places: dict[bytes, int] = {}

    def flush() -> None:
        for start in range(0, len(literals), 32):
            part = literals[start : start + 32]
            packed.extend(bytes([len(part) - 1]) + part)
        literals.clear()

    while position < len(data):
        key = data[position : position + 3]
        start = places.get(key, -1)
        places[key] = position
        length = 0
        if len(key) == 3 and start >= 0 and position - start <= 8192:
            while (
                length < 264
                and position + length < len(data)
                and data[start + length] == data[position + length]
            ):
                length += 1
        if length < 3:
            literals.append(data[position])
            position += 1
            continue
        flush()
        distance, extra = position - start - 1, length - 2
        if extra < 7:
            packed.append(extra << 5 | distance >> 8)
        else:
            packed += bytes([7 << 5 | distance >> 8, extra - 7])
        packed.append(distance & 255)
        position += length
    flush()
    return bytes(packed)


def pcd_bytes(
    records: NDArray[np.void], encoding: str, extra: str = "", counts: str | None = None
) -> bytes:
    names = records.dtype.names or ()
    kinds = [records.dtype[name] for name in names]
    header = (
        "# .PCD v0.7\nVERSION 0.7\n"
        f"FIELDS {' '.join(names)}\n"
        f"SIZE {' '.join(str(kind.itemsize) for kind in kinds)}\n"
        f"TYPE {' '.join(kind.kind.upper() for kind in kinds)}\n"
        f"COUNT {counts or ' '.join('1' for _ in names)}\n"
        f"WIDTH {len(records)}\nHEIGHT 1\n{extra}VIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {len(records)}\nDATA {encoding}\n"
    ).encode()
    if encoding == "ascii":
        rows = (" ".join(repr(value) for value in row.tolist()) for row in records)
        return header + "\n".join(rows).encode() + b"\n"
    if encoding == "binary":
        return header + records.tobytes()
    columns = b"".join(np.ascontiguousarray(records[name]).tobytes() for name in names)
    packed = pack_lzf(columns)
    return header + struct.pack("<II", len(packed), len(columns)) + packed


def check_points(cloud: PointCloud) -> None:
    np.testing.assert_array_equal(cloud.points_xyz, np.stack([POINTS[n] for n in "xyz"], axis=1))
    assert cloud.intensity is not None
    np.testing.assert_array_equal(cloud.intensity, POINTS["intensity"])


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_pcd_in_all_encodings(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "scan.pcd"
    path.write_bytes(pcd_bytes(POINTS, encoding) + (b"" if encoding == "ascii" else b"left over"))
    cloud = read_point_cloud(path)
    check_points(cloud)
    assert cloud.ring is not None
    assert cloud.offset_ns is not None
    np.testing.assert_array_equal(cloud.ring, POINTS["ring"])
    np.testing.assert_array_equal(cloud.offset_ns, POINTS["t"])
    assert (cloud.topic, cloud.frame, cloud.stamp_ns) == ("scan", "scan", 0)


def test_pcd_with_padding_fields(tmp_path: Path) -> None:
    padded = np.zeros(
        500, dtype=[*POINTS.dtype.descr[:3], ("_", "u1", 4), *POINTS.dtype.descr[3:5]]
    )
    for name in ("x", "y", "z", "intensity", "ring"):
        padded[name] = POINTS[name]
    path = tmp_path / "scan.pcd"
    content = pcd_bytes(padded, "binary", counts="1 1 1 4 1 1")
    path.write_bytes(
        content.replace(b"SIZE 4 4 4 4 4 2", b"SIZE 4 4 4 1 4 2").replace(b"V F", b"U F")
    )
    check_points(read_point_cloud(path))


def test_pcd_nan_points_are_dropped_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "scan.pcd"
    holed = POINTS.copy()
    holed["y"][7] = np.nan
    for encoding in ("ascii", "binary", "binary_compressed"):
        path.write_bytes(pcd_bytes(holed, encoding))
        cloud = read_point_cloud(path)
        assert (len(cloud), cloud.dropped_nonfinite) == (499, 1)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"DATA binary", b"DATA morse"),
        (b"FIELDS x", b"FIELDS a"),
        (b"FIELDS x y", b"FIELDS x x"),
        (b"SIZE 4 4", b"SIZE 3 4"),
        (b"SIZE 4 4", b"SIZE 4"),
        (b"TYPE F", b"TYPE Q"),
        (b"COUNT 1 1 1 1 1 1", b"COUNT 1 1 1 1 1 -1"),
        (b"COUNT 1 1 1 1 1 1", b"COUNT 1 1 1 1 1 99999999999999999999"),
        (b"POINTS 500", b"POINTS 501"),
        (b"POINTS 500", b"POINTS 99999999999999999999"),
        (b"POINTS 500", b"POINTS -1"),
        (b"POINTS 500", b"POINTS many"),
        (b"WIDTH", b"DEPTH"),
    ],
)
def test_pcd_headers_that_cannot_be_are_refused(tmp_path: Path, old: bytes, new: bytes) -> None:
    for encoding in ("ascii", "binary", "binary_compressed"):
        content = pcd_bytes(POINTS, encoding)
        if old == b"WIDTH":
            content = content.replace(b"POINTS 500\n", b"")
        path = tmp_path / "scan.pcd"
        path.write_bytes(content.replace(old if old != b"DATA binary" else b"DATA ", new))
        with pytest.raises(DecodeError, match=r"scan\.pcd"):
            read_point_cloud(path)


def test_lzf_undoes_copies_that_overlap() -> None:
    data = b"abc" * 400 + bytes(range(256)) + b"z" * 1000 + RNG.bytes(3000)
    packed = pack_lzf(data)
    assert len(packed) < len(data) * 0.75
    unpacked = decompress_lzf(np.frombuffer(packed, np.uint8), len(data))
    assert unpacked.tobytes() == data


@given(st.binary(max_size=60), st.integers(0, 300))
@settings(max_examples=100, derandomize=True)
def test_lzf_of_anything_stays_in_its_bounds(packed: bytes, size: int) -> None:
    unpacked = decompress_lzf(np.frombuffer(packed, np.uint8), size)
    assert len(unpacked) in (0, size)


@pytest.mark.parametrize("text", [False, True])
def test_ply(tmp_path: Path, *, text: bool) -> None:
    path = tmp_path / "scan.ply"
    vertices = POINTS[["x", "y", "z", "intensity"]]
    renamed = np.array(
        vertices.tolist(), dtype=[(n, "f4") for n in ("x", "y", "z", "scalar_intensity")]
    )
    element = plyfile.PlyElement.describe(renamed, "vertex")
    plyfile.PlyData([element], text=text).write(str(path))
    cloud = read_point_cloud(path)
    np.testing.assert_allclose(cloud.points_xyz[:, 0], POINTS["x"], rtol=1e-6)
    assert cloud.intensity is not None
    np.testing.assert_array_equal(cloud.intensity, POINTS["intensity"])


@pytest.mark.parametrize("columns", [3, 4, 6])
def test_npy(tmp_path: Path, columns: int) -> None:
    table = RNG.normal(size=(50, columns))
    path = tmp_path / "scan.npy"
    np.save(path, table)
    cloud = read_point_cloud(path)
    np.testing.assert_array_equal(cloud.points_xyz, table[:, :3].astype("f4"))
    assert (cloud.intensity is None) == (columns == 3)


def test_npy_of_records(tmp_path: Path) -> None:
    np.save(tmp_path / "scan.npy", POINTS)
    check_points(read_point_cloud(tmp_path / "scan.npy"))


def test_bare_floats_with_and_without_intensity(tmp_path: Path) -> None:
    path = tmp_path / "scan.bin"
    # 480 points are whole rows at either width.
    for columns in (3, 4):
        table = np.stack([POINTS[n][:480] for n in ("x", "y", "z", "intensity")[:columns]], axis=1)
        table.astype("<f4").tofile(path)
        cloud = read_point_cloud(path)
        np.testing.assert_array_equal(cloud.points_xyz, table[:, :3])
        assert (cloud.intensity is None) == (columns == 3)


def test_bare_floats_without_any_structure_are_rows_of_four(tmp_path: Path) -> None:
    path = tmp_path / "scan.bin"
    RNG.normal(size=(480, 4)).astype("<f4").tofile(path)
    assert len(read_point_cloud(path)) == 480


def test_nuscenes_files_have_five_columns(tmp_path: Path) -> None:
    path = tmp_path / "n015__LIDAR_TOP__1532402927647951.pcd.bin"
    table = np.stack([POINTS[n] for n in ("x", "y", "z", "intensity", "ring")], axis=1)
    table.astype("<f4").tofile(path)
    cloud = read_point_cloud(path)
    assert cloud.ring is not None
    np.testing.assert_array_equal(cloud.ring, POINTS["ring"])
    assert cloud.stamp_ns == 1532402927647951_000


@pytest.mark.parametrize("suffix", [".pcd", ".ply", ".npy", ".bin"])
@given(data=st.binary(max_size=200))
@settings(
    max_examples=30,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_any_bytes_under_a_cloud_name(tmp_path: Path, suffix: str, data: bytes) -> None:
    magic = {".pcd": b"FIELDS x y z\n", ".ply": b"ply\n", ".npy": b"\x93NUMPY\1\0", ".bin": b""}
    for content in (data, magic[suffix] + data):
        path = tmp_path / f"any{suffix}"
        path.write_bytes(content)
        with suppress(DecodeError):
            read_point_cloud(path)


@pytest.mark.parametrize("suffix", [".pcd", ".ply", ".npy"])
def test_cut_files_are_errors(tmp_path: Path, suffix: str) -> None:
    buffer = io.BytesIO()
    if suffix == ".npy":
        np.save(buffer, POINTS)
    elif suffix == ".ply":
        plyfile.PlyData([plyfile.PlyElement.describe(POINTS, "vertex")]).write(buffer)
    else:
        buffer.write(pcd_bytes(POINTS, "binary_compressed"))
    content = buffer.getvalue()
    path = tmp_path / f"cut{suffix}"
    for size in (0, 1, 50, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:size])
        with pytest.raises(DecodeError):
            read_point_cloud(path)


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("hello")
    with pytest.raises(RecordingError, match=r"\.pcd"):
        read_point_cloud(path)


def test_a_missing_file_is_not_called_one_of_another_kind(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="does not exist"):
        read_point_cloud(tmp_path / "missing.pcd")


@pytest.mark.parametrize(
    ("name", "count", "span_ms"),
    [
        ("lidar2lidar/opencalib_rig/0001/top.pcd", 92_677, 100),
        ("lidar2lidar/opencalib_rig/0001/left.pcd", None, 100),
        ("lidar2lidar/av2_rig_7fab2350/sweep0/down.pcd", 47_444, None),
        ("camera_lidar/acfr_vlp/clouds/pose1.pcd", 23_969, None),
        ("lidar2lidar/small_gicp_pair/source.ply", 69_792, None),
        ("odometry/kitti00_velodyne/000000.bin", 124_668, None),
        ("odometry/kitti07_dump/000004/points.bin", 19_872, None),
    ],
)
def test_real_files(shared_data: Path, name: str, count: int | None, span_ms: int | None) -> None:
    cloud = read_point_cloud(shared_data / name)
    assert count is None or len(cloud) + cloud.dropped_nonfinite == count
    spread = np.abs(cloud.points_xyz).max(axis=0)
    assert (spread < 400).all()
    assert spread[2] < spread[:2].max()
    if span_ms is None:
        assert cloud.offset_ns is None
    else:
        assert cloud.offset_ns is not None
        assert 0 == cloud.offset_ns.min() < cloud.offset_ns.max() < span_ms * 1.1e6
