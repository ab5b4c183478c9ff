"""Help: every command has one, and its example runs as it stands."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

_COMMANDS = [
    [],
    ["demo"],
    ["inspect"],
    ["detect"],
    ["detect", "quantize"],
    ["track"],
    ["synth"],
    ["synth", "drive"],
    ["synth", "calib"],
    ["calib", "lidar"],
    ["calib", "export"],
    ["eval"],
    ["eval", "detections"],
    ["eval", "lights"],
    ["eval", "tracks"],
    ["eval", "lanes"],
    ["eval", "map"],
    ["odometry"],
    ["lanes"],
    ["map"],
    ["map", "info"],
    ["map", "draw"],
    ["map", "check"],
    ["map", "validate"],
    ["map", "review"],
    ["dataset"],
    ["dataset", "prepare"],
    ["dataset", "check"],
    ["dataset", "import"],
    ["dataset", "diff"],
    ["view"],
]
# What examples begin with is done once: the others find its folder, and go on from there.
_MADE_ONCE = {
    "demo": "percept demo --out demo",
    "set": "percept dataset prepare --run demo/run --format coco --out set",
    "back": "percept dataset import set/coco --of set --out back",
    "checked": "percept map validate --bag demo/drive.mcap --map demo/map.osm --out checked",
}
_ENVIRONMENT = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
_NO_SCREEN = {k: v for k, v in _ENVIRONMENT.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}


def _help(command: list[str]) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "percept.cli", *command, "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


def _example(command: list[str]) -> str:
    text = " ".join(_help(command).split())
    found = re.search(r"Example: (.*?) (Options:|Arguments:|Commands:)", text)
    assert found, text
    return found.group(1)


@pytest.fixture(scope="module")
def workplace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("workplace")


@pytest.fixture(scope="module")
def stops(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder for the examples that share one log of stops and boards."""
    return tmp_path_factory.mktemp("stops")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["camera", "camera-lidar", "check"])
def test_the_example_of_a_calibration_runs(command: str, stops: Path) -> None:
    example, made = _example(["calib", command]), "percept synth calib --out stops && "
    assert example.startswith(made)
    if (stops / "stops").is_dir():
        example = example.removeprefix(made)
    shell = ["/bin/sh", "-c", example]
    done = subprocess.run(
        shell, cwd=stops, env=_NO_SCREEN, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("command", _COMMANDS, ids=lambda c: " ".join(c) or "percept")
def test_the_example_of_the_help_runs(command: list[str], workplace: Path) -> None:
    example = _example(command)
    for folder, command_line in _MADE_ONCE.items():
        if (workplace / folder).is_dir():
            if example == command_line:
                return
            example = example.removeprefix(f"{command_line} && ")
    shell = ["/bin/sh", "-c", example]
    done = subprocess.run(
        shell, cwd=workplace, env=_NO_SCREEN, capture_output=True, text=True, check=False
    )
    if command == ["view"]:  # there is no screen here, and the command must say so
        assert done.returncode == 5
        assert "screen" in done.stderr or "display" in done.stderr.lower()
    else:
        assert done.returncode == 0, done.stderr
