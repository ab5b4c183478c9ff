"""Files that a command is given and cannot, or can only partly, use."""

from __future__ import annotations

import json
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from hostile.camera_views import drawn
from hostile.case import ERROR, NEVER_GOOD, UNUSABLE, Case, Outcome
from hostile.lidar_worlds import capture, street
from typer.testing import CliRunner, Result

from percept.cli.app import app

__all__ = ["COMMAND_CASES"]

_Make = Callable[[Path], Sequence[object]]
COMMAND_CASES: list[Case] = []
_REFUSED = frozenset({ERROR})
_BOARD = ("--board", "checkerboard:8x5:0.06")


def _case(kind: str, name: str, wrong: str, allowed: frozenset[str]) -> Callable[[_Make], _Make]:
    """Add a case whose function writes files into a folder and returns the options."""

    def add(make: _Make) -> _Make:
        COMMAND_CASES.append(Case(kind, name, wrong, _Command(kind, make), allowed))
        return make

    return add


class _Command:
    """Runs `percept calib` on the files of a case."""

    def __init__(self, kind: str, make: _Make) -> None:
        self._kind = kind
        self._make = make

    def __call__(self) -> Outcome:
        with TemporaryDirectory() as name:
            folder = Path(name)
            options = ["calib", self._kind, "--json", "--out", folder / "run", *self._make(folder)]
            done = CliRunner().invoke(app, [str(option) for option in options])
            return _outcome(done, f"{folder}/")


def _outcome(done: Result, folder: str) -> Outcome:
    if done.exit_code in (2, 3):
        (line,) = done.stderr.strip().splitlines()
        return Outcome(ERROR, line.removeprefix("Error: ").replace(folder, ""))
    if done.exit_code not in (0, 4):
        raise AssertionError("".join(traceback.format_exception(done.exception)))
    document = json.loads(done.stdout)
    why = document["why"]
    return Outcome(document["verdict"], why if isinstance(why, str) else why[0])


def _clouds(folder: Path, count: int = 2) -> list[tuple[Path, Path]]:
    """Write scenes and return the files of the top and the side LiDAR."""
    files = []
    for k, scene in enumerate(capture([street(seed) for seed in range(count)])):
        pair = (folder / f"top{k}.npy", folder / f"side{k}.npy")
        for path, name in zip(pair, ("top", "side"), strict=True):
            np.save(path, scene[name])
        files.append(pair)
    return files


def _options(files: Sequence[tuple[Path, Path]]) -> list[object]:
    named = [("top", top) for top, _ in files] + [("side", side) for _, side in files]
    return [part for name, path in named for part in ("--cloud", f"{name}={path}")]


@_case("lidar", "a cut file", "the second half of a pcd file is missing", NEVER_GOOD)
def _cut_file(folder: Path) -> Sequence[object]:
    ((top, side),) = _clouds(folder, 1)
    points = np.load(side).astype(np.float32)
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {len(points)}\nHEIGHT 1\nPOINTS {len(points)}\nDATA binary\n"
    )
    cut = folder / "side.pcd"
    cut.write_bytes(header.encode() + points.tobytes()[: points.nbytes // 2])
    return _options([(top, cut)])


@_case("lidar", "an empty file", "a cloud's file has no bytes", _REFUSED)
def _empty_file(folder: Path) -> Sequence[object]:
    files = _clouds(folder)
    files[1][1].write_bytes(b"")
    return _options(files)


@_case("lidar", "a file is missing", "two scenes of one LiDAR, one of the other", NEVER_GOOD)
def _missing_scene(folder: Path) -> Sequence[object]:
    files = _clouds(folder)
    return _options(files)[:-2]


@_case("camera", "text for images", "the image files hold text", NEVER_GOOD)
def _text(folder: Path) -> Sequence[object]:
    images = folder / "images"
    images.mkdir()
    for k in range(4):
        (images / f"{k}.png").write_text("no image")
    return ["--images", images, *_BOARD]


@_case("camera", "a board without a size", "`--board checkerboard:8x5`", _REFUSED)
def _no_size(folder: Path) -> Sequence[object]:
    return ["--images", folder, "--board", "checkerboard:8x5"]


@_case("camera", "black images", "the lens cap was on", UNUSABLE)
def _black(folder: Path) -> Sequence[object]:
    images = folder / "images"
    images.mkdir()
    for k in range(3):
        cv2.imwrite(str(images / f"{k}.png"), np.zeros((400, 640), np.uint8))
    return ["--images", images, *_BOARD]


@_case("camera-lidar", "one cloud for all images", "the same cloud file in every pair", UNUSABLE)
def _one_cloud(folder: Path) -> Sequence[object]:
    ((top, _),) = _clouds(folder, 1)
    K = [900, 0, 652, 0, 903, 388, 0, 0, 1]
    intrinsics = folder / "camera.yaml"
    intrinsics.write_text(
        "image_width: 1280\nimage_height: 800\ncamera_name: front\n"
        f"camera_matrix: {{rows: 3, cols: 3, data: {K}}}\n"
        "distortion_model: plumb_bob\n"
        "distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n"
    )
    pairs: list[object] = []
    for k, image in enumerate(drawn(count=3)):
        path = folder / f"image{k}.png"
        cv2.imwrite(str(path), image)
        pairs += ["--pair", f"{path}={top}"]
    return [*pairs, "--intrinsics", intrinsics, *_BOARD, "--board-size", "0.7x0.5"]
