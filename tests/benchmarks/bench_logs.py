"""Reading logs against plain rosbags and mcap iteration, and peak memory against log length.

    python tests/benchmarks/bench_logs.py

Logs of 1 MB images, clouds of the same size and small messages are written to a temporary folder.
Both readers run in one process, interleaved, so that a busy machine slows both alike; the ratios
are what counts. Memory is that of a fresh process for each log.
"""

from __future__ import annotations

import argparse
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Reader as PlainReader1
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import Reader as PlainReader2
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer

from percept.datasets import open_recording
from percept.datasets.bag_recording import BagRecording

_DEFINITION = "string data\n"
_TYPE = "std_msgs/msg/String"
_ROUNDS = 5


def _messages(large: int, large_bytes: int) -> Iterator[tuple[str, int, bytes]]:
    """Yield ten small messages for each large one; payloads that compress to about a half."""
    rng = np.random.default_rng(0)
    big = rng.integers(0, 16, large_bytes, dtype=np.uint8).tobytes()
    for i in range(large * 11):
        data = big if i % 11 == 10 else bytes(40)
        yield ("/large" if i % 11 == 10 else "/small"), i * 10**7, b"\0\1\0\0" + data


def _write_bag(path: Path, large: int, size: int, compression: str = "") -> Path:
    writer = BagWriter(path)
    if compression:
        writer.set_compression(BagWriter.CompressionFormat[compression])
    with writer:
        at = {
            t: writer.add_connection(t, _TYPE, msgdef=_DEFINITION, md5sum="0" * 32)
            for t in ("/small", "/large")
        }
        for topic, time_ns, data in _messages(large, size):
            writer.write(at[topic], time_ns, data)
    return path


def _write_ros2(folder: Path, large: int, size: int, storage: StoragePlugin) -> Path:
    with Rosbag2Writer(folder, version=9, storage_plugin=storage) as writer:
        at = {
            t: writer.add_connection(t, _TYPE, msgdef=_DEFINITION, rihs01="RIHS01_0")
            for t in ("/small", "/large")
        }
        for topic, time_ns, data in _messages(large, size):
            writer.write(at[topic], time_ns, data)
    return next(folder.glob(f"{folder.name}.*"))


def _write_mcap(path: Path, large: int, size: int) -> Path:
    with path.open("wb") as stream:
        writer = McapWriter(stream, compression=CompressionType.ZSTD)
        writer.start("ros2")
        schema = writer.register_schema(_TYPE, "ros2msg", _DEFINITION.encode())
        at = {t: writer.register_channel(t, "cdr", schema) for t in ("/small", "/large")}
        for topic, time_ns, data in _messages(large, size):
            writer.add_message(at[topic], time_ns, data, time_ns)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap types all but this
    return path


def _logs(folder: Path, large: int, size: int) -> dict[str, Path]:
    folder.mkdir()
    return {
        "bag": _write_bag(folder / "plain.bag", large, size),
        "bag lz4": _write_bag(folder / "lz4.bag", large, size, "LZ4"),
        "db3": _write_ros2(folder / "db3", large, size, StoragePlugin.SQLITE3),
        "mcap": _write_ros2(folder / "mcap", large, size, StoragePlugin.MCAP),
        "mcap zstd": _write_mcap(folder / "zstd.mcap", large, size),
    }


def _with_percept(path: Path) -> int:
    with open_recording(path) as recording:
        if not isinstance(recording, BagRecording):
            raise TypeError(f"{path} is no log")
        return sum(1 for _ in recording.messages())


def _with_rosbags(path: Path) -> int:
    reader: Any = PlainReader1(path) if path.suffix == ".bag" else PlainReader2(path)
    with reader:
        return sum(1 for _ in reader.messages())


def _with_mcap(path: Path) -> int:
    with path.open("rb") as stream:
        return sum(1 for _ in make_reader(stream).iter_messages())


def _seconds(read: Callable[[Path], int], path: Path) -> float:
    begin = time.perf_counter()
    read(path)
    return time.perf_counter() - begin


def _print_speed(logs: dict[str, Path]) -> None:
    print(
        f"{'log':24} {'messages':>8} {'MB':>6} {'percept ms':>11} {'/ rosbags':>10} {'/ mcap':>7}"
    )
    for name, path in logs.items():
        readers = {"percept": _with_percept, "rosbags": _with_rosbags}
        if path.suffix == ".mcap":
            readers["mcap"] = _with_mcap
        counts = {reader: read(path) for reader, read in readers.items()}
        if len(set(counts.values())) != 1:
            raise SystemExit(f"the readers disagree on {name}: {counts}")
        best = dict.fromkeys(readers, float("inf"))
        for _ in range(_ROUNDS):
            for reader, read in readers.items():
                best[reader] = min(best[reader], _seconds(read, path))
        ratios = [
            best["percept"] / best[r] if r in best else float("nan") for r in ("rosbags", "mcap")
        ]
        megabytes = path.stat().st_size / 1e6
        print(
            f"{name:24} {counts['percept']:8d} {megabytes:6.0f} {best['percept'] * 1e3:11.1f} "
            f"{ratios[0]:10.2f} {ratios[1]:7.2f}"
        )


def _peak_megabytes(path: Path) -> float:
    command = [sys.executable, __file__, "--peak", str(path)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def _peak_of_this_process() -> float:
    """Return the peak in MB; what getrusage says would include the parent's."""
    status = Path("/proc/self/status").read_text()
    return int(re.findall(r"VmHWM:\s+(\d+) kB", status)[0]) / 1024


def _print_memory(folder: Path, large: int, size: int) -> None:
    print(f"\n{'peak memory, MB':24} {'short':>8} {'10 x':>8} {'ratio':>6}")
    short, long = _logs(folder / "short", large, size), _logs(folder / "long", large * 10, size)
    for name, path in short.items():
        for kind in ("", ", cut at 90 %"):
            paths = [path, long[name]]
            if kind:
                paths = [_cut(one) for one in paths]
            peaks = [_peak_megabytes(one) for one in paths]
            print(f"{name + kind:24} {peaks[0]:8.1f} {peaks[1]:8.1f} {peaks[1] / peaks[0]:6.2f}")


def _cut(path: Path) -> Path:
    target = path.with_name(f"cut_{path.name}")
    content = path.read_bytes()
    target.write_bytes(content[: int(len(content) * 0.9)])
    return target


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, help="folder with the real recordings")
    parser.add_argument("--peak", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peak:
        _with_percept(options.peak)
        print(_peak_of_this_process())
        return
    print(f"{platform.machine()}, Python {platform.python_version()}")
    with tempfile.TemporaryDirectory(prefix="percept-bench-") as folder:
        logs = _logs(Path(folder) / "speed", 100, 1_000_000)
        if options.data:
            for name in ("evo/ROS_example.bag", "evo/nav2_turtlebot.mcap", "rosbagjs/example.bag"):
                logs[name] = options.data / "bags" / name
        _print_speed(logs)
        _print_memory(Path(folder), 30, 300_000)


if __name__ == "__main__":
    main()
