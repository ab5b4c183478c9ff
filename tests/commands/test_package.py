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


def test_the_wheel_has_all_that_lies_beside_the_code(installed: Path) -> None:
    packages = [p for p in _ROOT.glob("*/percept/*") if any(p.glob("*.py"))]
    assert not [
        p.name for p in packages if not (installed / "percept" / p.name / "py.typed").exists()
    ]
    made = {".py", ".pyc", ".nbi", ".nbc"}
    data = [
        file.relative_to(package.parent)
        for package in packages
        for file in package.rglob("*")
        if file.is_file() and file.suffix not in made
    ]
    assert not [file for file in data if not (installed / "percept" / file).is_file()]
    assert {"rules.yaml", "builtin.onnx", "light_colours.npz"} <= {file.name for file in data}


def test_it_detects_in_an_empty_folder(installed: Path, drive: Path, tmp_path: Path) -> None:
    names = [f"percept.{name}" for name in ("lidar", "tracking", "odometry", "lights.colours")]
    code = f"import {', '.join(names)}, sys; [print(sys.modules[n].__file__) for n in {names}]"
    places = _run(installed, tmp_path, "-c", code)
    assert places.returncode == 0, places.stderr
    assert all(place.startswith(str(installed)) for place in places.stdout.split())
    # Without tracks: nothing that was compiled before is used here, and theirs takes the longest.
    options = ("--bag", str(drive / "drive.mcap"), "--out", "run", "--no-track")
    done = _run(installed, tmp_path, "-m", "percept.cli", "detect", *options)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "report.html").is_file()
