"""Logs and a command line for the tests that work as a user does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from percept.cli.app import app
from percept.core.samples import PointCloud
from percept.datasets.synthetic.drive import DriveConfig, generate_drive
from percept.datasets.write import CloudLayout, LogFormat, LogWriter

Run = Callable[..., Result]

_SUFFIX = {"rosbag1": ".bag", "rosbag2": "", "mcap": ".mcap"}


@pytest.fixture(scope="session")
def run() -> Run:
    """Runs a command as the shell would: `run("inspect", path)`."""

    def call(*arguments: object) -> Result:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return call


@pytest.fixture(scope="session")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short drive with few beams and no cameras."""
    folder = tmp_path_factory.mktemp("drive")
    generate_drive(DriveConfig(seconds=0.6, beam_share=0.25, cameras=()), folder)
    return folder


@pytest.fixture(scope="session")
def real_clouds(shared_data: Path) -> list[PointCloud]:
    """Real KITTI and AV2 scans as the messages of two topics."""
    return list(_real_clouds(shared_data / "scenes"))


def _real_clouds(scenes: Path) -> Iterator[PointCloud]:
    kitti = sorted((scenes / "kitti_object" / "training" / "velodyne").glob("*.bin"))
    av2 = sorted((scenes / "av2" / "7fab2350" / "converted").glob("*.bin"))
    stamp_ns = 1_700_000_000_000_000_000
    for path in (*kitti, *av2):
        name = "kitti" if path in kitti else "av2"
        scan = np.fromfile(path, np.float32).reshape(-1, 4)
        stamp_ns += 100_000_000
        yield PointCloud(
            topic=f"/{name}/points",
            stamp_ns=stamp_ns,
            log_time_ns=stamp_ns + 30_000_000,
            frame=name,
            points_xyz=scan[:, :3],
            intensity=scan[:, 3],
        )


@pytest.fixture(scope="session")
def pack() -> Callable[..., Path]:
    """Writes clouds into a log: `pack(clouds, folder, "mcap")` gives its path."""

    def write(
        clouds: list[PointCloud],
        folder: Path,
        log_format: LogFormat,
        cloud_layout: CloudLayout | None = None,
    ) -> Path:
        path = folder / f"log{_SUFFIX[log_format]}"
        with LogWriter(path, log_format, cloud_layout=cloud_layout) as writer:
            for cloud in clouds:
                writer.write(cloud)
        return path

    return write
