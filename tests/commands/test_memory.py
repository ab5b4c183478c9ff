"""Memory of a run does not grow with the length of the log."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from percept.core.samples import PointCloud

Pack = Callable[..., Path]

_MEASURED = (
    "import resource, subprocess, sys\n"
    "subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)\n"
    "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
)


def _peak_kib(log: Path, out: Path) -> int:
    command = [sys.executable, "-m", "percept.cli", "detect", "--bag", str(log), "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-c", _MEASURED, *command], capture_output=True, text=True, check=True
    )
    return int(done.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("log_format", ["rosbag1", "rosbag2", "mcap"])
def test_ten_times_the_scans_need_no_more_memory(
    log_format: str, real_clouds: list[PointCloud], pack: Pack, tmp_path: Path
) -> None:
    few = [cloud.select(np.arange(0, len(cloud), 6)) for cloud in real_clouds[:2]]
    peaks = {}
    for scans in (200, 2000):
        clouds = (
            replace(few[i % 2], stamp_ns=10**9 + 10**8 * i, log_time_ns=10**9 + 10**8 * i)
            for i in range(scans)
        )
        folder = tmp_path / str(scans)
        folder.mkdir()
        log = pack(clouds, folder, log_format)
        peaks[scans] = _peak_kib(log, folder / "run")
    assert peaks[2000] < 1.1 * peaks[200], peaks
