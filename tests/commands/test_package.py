"""What is shipped: the wheel that is built from the source archive works by itself."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

_ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with percept as pip installs it, from a wheel that was built from the sdist."""
    made = tmp_path_factory.mktemp("package")
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(made), str(_ROOT)]
    done = subprocess.run(build, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = made.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(made / "site")
    return made / "site"


def _run(installed: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_wheel_owns_no_foreign_name(installed: Path) -> None:
    folders = {path.name for path in installed.iterdir()}
    assert {name for name in folders if not name.endswith(".dist-info")} == {"percept"}
    assert not (installed / "percept" / "__init__.py").exists()
    assert (installed / "percept" / "lidar" / "rules.yaml").is_file()
    assert (installed / "percept" / "core" / "py.typed").is_file()


def test_it_detects_in_an_empty_folder(installed: Path, drive: Path, tmp_path: Path) -> None:
    where = _run(installed, tmp_path, "-c", "import percept.lidar as p; print(p.__file__)")
    assert where.stdout.startswith(str(installed)), where.stderr
    log = str(drive / "drive.mcap")
    done = _run(installed, tmp_path, "-m", "percept.cli", "detect", "--bag", log, "--out", "run")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "report.html").is_file()
