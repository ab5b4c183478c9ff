"""The house rules that a machine can hold: arrows between packages, heavy imports, sizes."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import percept.core

_ROOT = Path(__file__).resolve().parents[2]
_SOURCES = {
    path: ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
    for root in (_ROOT / name for name in ("percept", "calib", "cli", "datasets"))
    for path in sorted(root.rglob("*.py"))
}

# What each package may import from the others. Core knows nobody; the command line knows all.
_ARROWS = {
    "core": set(),
    "lidar": {"core"},
    "detection": {"core", "lidar"},
    "tracking": {"core"},
    "hdmap": {"core"},
    "lights": {"core", "hdmap"},
    "lanes": {"core"},
    "review": {"core"},
    "odometry": {"core"},
    "evaluation": {"core"},
    "calib": {"core", "lidar"},
    "datasets": {"core", "calib"},
    "export": {"core", "lidar", "detection", "evaluation", "calib", "hdmap", "datasets"},
    "cli": {
        "core", "lidar", "detection", "tracking", "hdmap", "lights", "lanes", "odometry",
        "evaluation", "calib", "datasets", "export", "review",
    },
}  # fmt: skip

# Heavy third-party packages and the only files that may import them.
_HEAVY = {
    "rerun": {"percept.export.view", "percept.export.calibration.view"},
    "rosbags": {"percept.datasets", "percept.export.overlay_messages"},
    "mcap": {"percept.datasets", "percept.export.overlay"},
    "open3d": set(),
    "onnxruntime": {"percept.detection.networks.network", "percept.detection.quantize"},
    "onnx": {"percept.detection.networks.model_file", "percept.detection.quantize"},
    "pycocotools": {"percept.evaluation.boxes_2d.coco"},
    "torch": set(),
    "kiss_icp": {"percept.odometry.lidar"},
    "lxml": {"percept.hdmap.osm", "percept.hdmap.opendrive"},
    "shapely": {"percept.hdmap.check"},
    "starlette": {"percept.review"},
    "uvicorn": {"percept.review"},
    "jinja2": {"percept.review"},
    "sklearn": set(),
    "trackeval": set(),
    "motmetrics": set(),
    "lanelet2": set(),
    "numba": {
        "percept.core.box_overlap_kernels", "percept.core.sight_line_kernels", "percept.lidar",
        "percept.tracking", "percept.odometry", "percept.calib", "percept.datasets",
        "percept.lanes",
    },
    "numpy": {
        "percept.core", "percept.lidar", "percept.detection", "percept.tracking", "percept.hdmap",
        "percept.lights", "percept.lanes", "percept.odometry", "percept.evaluation",
        "percept.calib", "percept.datasets", "percept.export", "percept.review",
    },
}  # fmt: skip


def _imports(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@pytest.mark.parametrize("path", _SOURCES, ids=lambda p: str(p.relative_to(_ROOT)))
def test_imports_follow_the_arrows(path: Path) -> None:
    package = _SOURCES[path].split(".")[1]
    seen = {n.split(".")[1] for n in _imports(path) if n.startswith("percept.")} - {package}
    assert seen <= _ARROWS[package], f"{package} must not import {seen - _ARROWS[package]}"


@pytest.mark.parametrize("path", _SOURCES, ids=lambda p: str(p.relative_to(_ROOT)))
def test_heavy_packages_stay_in_their_files(path: Path) -> None:
    module = _SOURCES[path]
    for name in _imports(path):
        homes = _HEAVY.get(name.split(".")[0])
        assert homes is None or any(module == h or module.startswith(f"{h}.") for h in homes), (
            f"{module} must not import {name}"
        )


@pytest.mark.parametrize("path", _SOURCES, ids=lambda p: str(p.relative_to(_ROOT)))
def test_files_stay_readable(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 400


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys; sys.argv = ['percept', '--help']\n"
        "from percept.cli.app import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'cv2', 'numba', 'rosbags', 'mcap', 'rerun', 'pyarrow', 'pydantic',\n"
        "         'onnx', 'onnxruntime', 'pycocotools', 'torch', 'kiss_icp', 'lxml', 'scipy',\n"
        "         'starlette', 'uvicorn', 'jinja2', 'shapely'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_public_names_exist() -> None:
    for name in (m for m in _SOURCES.values() if not m.endswith("__main__")):
        module = importlib.import_module(name)
        missing = [n for n in getattr(module, "__all__", []) if not hasattr(module, n)]
        assert not missing, f"{name} promises {missing}"


def test_every_package_below_the_namespace_is_a_package() -> None:
    assert not list(_ROOT.glob("*/percept/__init__.py"))
    assert {m.name for m in pkgutil.iter_modules(percept.__path__)} == _ARROWS.keys()
