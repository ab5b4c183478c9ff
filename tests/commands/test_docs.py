"""The documentation: its commands run, its options and links exist, its tables are complete."""

from __future__ import annotations

import csv
import importlib
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
import yaml

from percept.calib import limits
from percept.cli.app import app
from percept.cli.dataset.request import PrepareConfig
from percept.cli.detect import verdict as detect_verdict
from percept.cli.detect.request import DetectConfig
from percept.cli.map.validate_request import MapValidateConfig
from percept.cli.track import verdict as track_verdict
from percept.cli.track.request import TrackConfig
from percept.core.map_findings import Kind, Status
from percept.core.results import Verdict
from percept.core.rig import load_rig
from percept.core.settings import Settings
from percept.datasets.inspection import InspectConfig
from percept.datasets.labelling.dropped import DROPPED
from percept.datasets.labelling.set_schemas import TABLES as DATASET_TABLES
from percept.datasets.synthetic.calibration.log import BOARD_COLUMNS
from percept.datasets.synthetic.truth import BOX_COLUMNS, LIGHT_COLUMNS, OBJECT_COLUMNS
from percept.detection import agreement
from percept.detection.images.pixels import PIXEL_FORMATS
from percept.detection.networks.decode import NAMES as LAYOUTS
from percept.detection.yolo_config import YoloConfig
from percept.evaluation.boxes_2d import BoxScoreConfig
from percept.export.coverage_table import COVERAGE, OFFSETS
from percept.export.discrepancy_table import DISCREPANCIES, read_discrepancies
from percept.export.image_table import IMAGES_2D
from percept.export.lane_document import LANES
from percept.export.light_table import LIGHTS
from percept.export.pose_table import POSES
from percept.export.scan_table import SCANS_3D
from percept.export.tables import DETECTIONS_2D, DETECTIONS_3D
from percept.export.track_table import TRACKS
from percept.lanes import LaneConfig
from percept.lidar import Rules, load_rules
from percept.lidar.classify import ShapeRule
from percept.tracking.config import ClassSettings

_ROOT = Path(__file__).resolve().parents[2]
_PAGES = sorted([*_ROOT.glob("*.md"), *(_ROOT / "docs").glob("*.md")])
_NOTEBOOKS = sorted((_ROOT / "notebooks").glob("*.ipynb"))
# Of pip, the benchmarks, and the scripts that export and train networks.
_FOREIGN_OPTIONS = {
    "--upgrade",
    "--no-deps",
    "--data",
    "--grid",
    "--end2end",
    "--weights",
    "--include",
    "--drive",
}
_LARGEST_PICTURE = 300_000
_FINDINGS = "discrepancies.parquet"
# Taken with a browser.
_PAGE_PICTURES = {
    "calib_check.png",
    "calib_report.png",
    "eval.png",
    "inspect.png",
    "lights.png",
    "map_review.png",
    "report.png",
}


def _page(name: str) -> str:
    return (_ROOT / name).read_text(encoding="utf-8")


def _blocks(text: str, language: str) -> list[str]:
    """Return the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def _section(text: str, heading: str) -> str:
    _, found, rest = text.partition(f"\n## {heading}\n")
    assert found, f"no section '{heading}'"
    return rest.partition("\n## ")[0]


# ---- links and pictures


def _slug(heading: str) -> str:
    """Return the anchor that a heading gets on the usual hosts."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", _PAGES, ids=lambda page: page.name)
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if target.startswith(("http://", "https://", "mailto:")):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), f"{page.name} links to {target}"
        if anchor:
            headings = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in map(_slug, headings), f"{page.name} links to {target}"


def test_every_picture_is_used_and_small() -> None:
    linked = "".join(page.read_text(encoding="utf-8") for page in _PAGES)
    pictures = sorted((_ROOT / "docs" / "pictures").iterdir())
    assert pictures
    for picture in pictures:
        assert f"pictures/{picture.name})" in linked, picture.name
        assert picture.stat().st_size <= _LARGEST_PICTURE, picture.name


# ---- options


def _commands(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    """Yield all commands that do something themselves, by the words after `percept`."""
    below: dict[str, Any] = getattr(group, "commands", {})
    if not below or getattr(group, "invoke_without_command", False):
        yield " ".join(path), group
    for name, command in below.items():
        yield from _commands(command, (*path, name))


def _options_of(command: Any) -> set[str]:
    names = {name for parameter in command.params for name in parameter.opts}
    return {name for name in names if name.startswith("--")} | {"--help"}


_OPTIONS = {name: _options_of(c) for name, c in _commands(typer.main.get_command(app))}


def _invocations(text: str) -> Iterator[str]:
    """Yield what stands behind `percept` in code: in fenced blocks, and between backticks."""
    for block in re.findall(r"^```\w*\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            command = re.sub(r"\s#.*", "", line)
            yield from re.findall(r"(?:^|[\s/])percept ([^&|>]+)", command)
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    yield from re.findall(r"`percept ([^`]+)`", prose)


@pytest.mark.parametrize("page", _PAGES, ids=lambda page: page.name)
def test_every_option_in_the_docs_exists(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for call in _invocations(text):
        known = [name for name in _OPTIONS if call.startswith(name)]
        assert known or re.match(r"--|COMMAND|(synth|calib|eval|map|dataset)$", call), (
            f"{page.name}: percept {call}"
        )
        named = set(re.findall(r"--[a-z][a-z-]+", call))
        allowed = _OPTIONS[max(known, key=len)] if known else {"--help", "--version"}
        assert named <= allowed, f"{page.name}: percept {call}"
    code = " ".join(re.findall(r"`([^`\n]+)`", text))
    everywhere = set().union(*_OPTIONS.values()) | _FOREIGN_OPTIONS | {"--version"}
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", code)) <= everywhere, page.name


@pytest.mark.parametrize(
    "command",
    [
        "detect", "detect quantize", "eval detections", "inspect", "synth drive", "synth calib",
        "calib camera", "calib lidar", "calib camera-lidar", "calib check", "calib export",
        "odometry", "track", "eval tracks", "eval lights", "lanes", "eval lanes", "map info",
        "map draw", "map check", "map validate", "map review", "eval map", "dataset prepare",
        "dataset check", "dataset import", "dataset diff",
    ],
)  # fmt: skip
def test_a_page_names_every_option_of_its_command(command: str) -> None:
    own = _ROOT / "docs" / f"{command.replace(' ', '-')}.md"
    text = _page(f"docs/{own.name if own.exists() else command.split()[0] + '.md'}")
    missing = [o for o in _OPTIONS[command] - {"--help"} if o not in text]
    assert not missing


def test_the_readme_names_every_command() -> None:
    text = _page("README.md")
    assert all(f"`percept {name}" in text for name in _OPTIONS)


@pytest.mark.parametrize(("heading", "target"), [("Quick start", "demo"), ("Tests", "test")])
def test_a_section_of_the_readme_begins_with_one_command(heading: str, target: str) -> None:
    section = _section(_page("README.md"), heading)
    assert section.lstrip("\n").startswith(f"```bash\nmake {target}\n```\n")
    assert re.search(rf"^{target}:", _page("Makefile"), re.MULTILINE)


# ---- settings, rules, tables, verdict


def _keys(values: dict[str, Any], path: str = "") -> set[str]:
    keys: set[str] = set()
    for name, value in values.items():
        below = _keys(value, f"{path}{name}.") if isinstance(value, dict) else {path + name}
        keys |= below
    return keys


def test_the_settings_of_detect_are_complete_and_are_the_defaults() -> None:
    (block,) = _blocks(_section(_page("docs/detect.md"), "Settings"), "yaml")
    values = yaml.safe_load(block)
    assert DetectConfig.model_validate(values) == DetectConfig()
    # What happens over time has pages of its own.
    elsewhere = {"tracking", "joining", "lights", "odometry"}
    assert not any(values.pop(name) for name in elsewhere)
    # The one key of the model that is refused, because it has another place.
    refused = {"lidar.ground.sensor_height_m"}
    assert _keys(values) == _keys(DetectConfig().model_dump(exclude=elsewhere)) - refused


def test_the_settings_of_tracks_and_lights_are_complete_and_are_the_defaults() -> None:
    (block,) = _blocks(_section(_page("docs/track.md"), "Settings"), "yaml")
    tracks = yaml.safe_load(block)
    (block,) = _blocks(_section(_page("docs/lights.md"), "Settings"), "yaml")
    values = {**tracks, **yaml.safe_load(block)}
    assert TrackConfig.model_validate(values) == TrackConfig()
    # Of the classes one is written out, the others say what is different.
    classes, car = values["tracking"].pop("classes"), ClassSettings.model_fields
    assert classes["car"].keys() == car.keys()
    defaults = TrackConfig().model_dump()
    assert classes.keys() == defaults["tracking"].pop("classes").keys()
    assert _keys(values) == _keys(defaults)


def test_the_settings_of_map_validation_are_complete_and_are_the_defaults() -> None:
    (block,) = _blocks(_section(_page("docs/map-validate.md"), "Settings"), "yaml")
    values = yaml.safe_load(block)
    assert MapValidateConfig.model_validate(values) == MapValidateConfig()
    elsewhere = {"odometry", "lidar", "models"}  # they have pages of their own
    assert _keys(values) == _keys(MapValidateConfig().model_dump(exclude=elsewhere))


def test_the_settings_of_data_sets_are_complete_and_are_the_defaults() -> None:
    (block,) = _blocks(_section(_page("docs/dataset-prepare.md"), "Settings"), "yaml")
    values = yaml.safe_load(block)
    assert PrepareConfig.model_validate(values) == PrepareConfig()
    values.pop("prelabels")  # they have a page of their own
    assert _keys(values) == _keys(PrepareConfig().model_dump(exclude={"prelabels"}))
    text = _page("docs/dataset-prelabels.md")
    keys = _keys(PrepareConfig().prelabels.model_dump())
    assert not [key for key in keys if key.rpartition(".")[2] not in text]


def test_the_findings_that_are_described_are_those_that_exist() -> None:
    rows = _section(_page("docs/map-validate.md"), "Findings").splitlines()
    named = [line.split("|")[1].strip(" `") for line in rows if line.startswith("| `")]
    assert named == [str(kind) for kind in Kind]
    rows = _section(_page("docs/map-validate.md"), "Verdict").splitlines()
    named = [line.split("|")[1].strip(" `") for line in rows if line.startswith("| `")]
    assert set(named) == {str(verdict) for verdict in Verdict}
    assert all(f"`{status}`" in _page("docs/map-validate.md") for status in Status)


def test_the_settings_of_a_network_are_complete_and_are_the_defaults() -> None:
    (block,) = _blocks(_section(_page("docs/networks.md"), "Settings"), "yaml")
    ((_, values),) = yaml.safe_load(block)["models"].items()
    assert YoloConfig.model_validate(values) == YoloConfig()
    assert values.keys() == YoloConfig.model_fields.keys()


@pytest.mark.parametrize(
    ("model", "page"),
    [
        (InspectConfig, "inspect"),
        (ShapeRule, "detect"),
        (Rules, "detect"),
        (BoxScoreConfig, "eval-detections"),
        (LaneConfig, "lanes"),
    ],
)
def test_every_key_of_limits_and_rules_is_named(model: type[Settings], page: str) -> None:
    text = _page(f"docs/{page}.md")
    assert not [key for key in model.model_fields if key not in text]


def test_every_layout_and_pixel_format_has_its_row() -> None:
    text = _page("docs/networks.md")
    rows = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]
    assert set(re.findall(r"`([\w-]+)`", "".join(rows))) == {*LAYOUTS, *PIXEL_FORMATS}


def test_the_limits_of_quantised_networks_are_those_of_the_code() -> None:
    text = _page("docs/detect-quantize.md")
    for row in (
        f"IoU of 0.5, below | {agreement.GOOD_SHARE_50:.0%} | {agreement.BAD_SHARE_50:.0%} |",
        f"IoU of 0.75, below | {agreement.GOOD_SHARE_75:.0%} | |",
        f"in the mean by more than | {agreement.GOOD_SHIFT:.2f} | {agreement.BAD_SHIFT:.2f} |",
        f"fewer than | {agreement.LEAST_BOXES} | |",
        f"as fast, less than | {agreement.LEAST_SPEED} | |",
    ):
        assert row in text.replace(" %", "%")


def test_the_rule_in_the_docs_is_the_one_that_ships(tmp_path: Path) -> None:
    (block,) = _blocks(_section(_page("docs/detect.md"), "Rules"), "yaml")
    (tmp_path / "rules.yaml").write_text(block)
    shown, shipped = load_rules(tmp_path / "rules.yaml"), load_rules()
    assert shown.classes["barrel"] == shipped.classes["barrel"]
    assert (shown.retro, shown.min_confidence) == (shipped.retro, shipped.min_confidence)
    assert all(f"`{label}`" in _page("docs/detect.md") for label in shipped.labels)


@pytest.mark.parametrize(
    ("page", "columns"),
    [
        ("docs/detect.md", DETECTIONS_3D.names),
        ("docs/detect.md", DETECTIONS_2D.names),
        ("docs/detect.md", IMAGES_2D.names),
        ("docs/track.md", TRACKS.names),
        ("docs/track.md", POSES.names),
        ("docs/track.md", SCANS_3D.names),
        ("docs/lights.md", LIGHTS.names),
        ("docs/lanes.md", LANES.names),
        ("docs/map-validate.md", DISCREPANCIES.names),
        ("docs/map-validate.md", COVERAGE.names),
        ("docs/map-validate.md", OFFSETS.names),
        ("docs/dataset-prepare.md", DATASET_TABLES["frames"].names),
        ("docs/dataset-prepare.md", DATASET_TABLES["keyframes"].names),
        ("docs/dataset-prepare.md", DATASET_TABLES["boxes_2d"].names),
        ("docs/dataset-prepare.md", DATASET_TABLES["boxes_3d"].names),
        ("docs/dataset-prepare.md", DROPPED.names),
        ("docs/synth.md", OBJECT_COLUMNS.names),
        ("docs/synth.md", LIGHT_COLUMNS.names),
        ("docs/synth.md", BOX_COLUMNS.names),
        ("docs/synth.md", BOARD_COLUMNS.names),
    ],
)
def test_every_column_is_described(page: str, columns: list[str]) -> None:
    assert not [name for name in columns if f"`{name}`" not in _page(page)]


def test_the_limits_of_the_verdict_are_those_of_the_code() -> None:
    pattern = re.compile(r"^\| .* \| (?:bad|doubtful) \|$", re.MULTILINE)
    rows = pattern.findall(_page("docs/detect.md"))
    of_tracks = pattern.findall(track_verdict.__doc__ or "")
    assert set(rows) == {*pattern.findall(detect_verdict.__doc__ or ""), *of_tracks}
    assert pattern.findall(_section(_page("docs/track.md"), "Verdict")) == of_tracks
    text = " ".join(rows)
    assert f"{detect_verdict._LARGEST_HEIGHT_SPREAD_M:.2f} m" in text
    assert all(f"{100 * share:.0f} %" in text for share in detect_verdict._GROUND_SHARE)
    assert detect_verdict._LARGEST_MISSING_SHARE == 0.1


@pytest.mark.parametrize("name", limits.__all__)
def test_the_limits_of_calibrations_are_those_of_the_code(name: str) -> None:
    page = _page("docs/calibration.md")
    _, found, rest = page.partition(f"<!-- made by scripts/docs-pictures: {name} -->\n")
    assert found
    table = rest.partition("<!-- end -->")[0]
    shown = re.findall(r"^\| `(\w+)` \| (\S+) \| (.+) \|$", table, re.MULTILINE)
    assert [(key, float(value)) for key, value, _ in shown] == [
        (key, float(value)) for key, value in asdict(getattr(limits, name)()).items()
    ], "run scripts/docs-pictures"
    # The reasons stand in the code too, broken into lines of their own.
    described = " ".join((getattr(limits, name).__doc__ or "").split())
    assert not [key for key, _, why in shown if f"{key}: {why}" not in described]


# ---- what a reader types


def _follow(page: str, folder: Path, instead: tuple[str, str] = ("", "")) -> None:
    """Do in a folder what a page shows, with another command instead of one of its own."""
    path = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{path}:{os.environ['PATH']}"}
    assert instead[0] in _page(page)
    text = _page(page).replace(*instead) if instead[0] else _page(page)
    for language, block in re.findall(r"^```(bash|python)\n(.*?)^```$", text, re.M | re.S):
        shell = ["/bin/sh", "-e", "-c"] if language == "bash" else [sys.executable, "-c"]
        done = subprocess.run(
            [*shell, block], cwd=folder, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, f"{block}\n{done.stdout}\n{done.stderr}"
        assert "Traceback" not in done.stderr


def test_the_tutorial_runs_as_it_stands(tmp_path: Path) -> None:
    _follow("docs/tutorial.md", tmp_path)
    barrels = {name: _barrels(tmp_path / name) for name in ("tuned", "ruled")}
    assert barrels["ruled"] > barrels["tuned"], "the rule that was edited must have an effect"


def test_the_tutorial_of_cameras_runs_as_it_stands(tmp_path: Path) -> None:
    _follow("docs/tutorial-cameras.md", tmp_path)
    near, far = (_scores(tmp_path / name) for name in ("near", "far"))
    assert (near["images"], far["images"]) == (20, 4)
    assert near["ap50"] > 0.5
    run = json.loads((tmp_path / "run" / "run.json").read_text())
    assert run["verdict"] == "good"
    assert run["counts"]["boxes_2d_placed"]["cluster"] > 100
    tuned = json.loads((tmp_path / "tuned" / "run.json").read_text())["counts"]["boxes_2d"]["near"]
    first = run["counts"]["boxes_2d"]["near"]
    assert 0 < sum(tuned["cam_front"].values()) < sum(first["cam_front"].values())


def test_the_tutorial_of_tracks_runs_as_it_stands(tmp_path: Path) -> None:
    _follow("docs/tutorial-tracks.md", tmp_path)
    runs = {
        name: json.loads((tmp_path / name / "run.json").read_text())
        for name in ("run", "again", "by_lidar", "way")
    }
    assert {name: run["verdict"] for name, run in runs.items()} == dict.fromkeys(runs, "good")
    named = {name: sum(runs[name]["counts"]["tracks"].values()) for name in ("run", "again")}
    unknown = {name: runs[name]["counts"]["tracks"]["unknown"] for name in named}
    assert named["again"] - unknown["again"] > named["run"] - unknown["run"]
    # The Python of the page on tracks goes on from a run.
    (block,) = _blocks(_page("docs/track.md"), "python")
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo" / "run").symlink_to(tmp_path / "run")
    shown = subprocess.run(
        [sys.executable, "-c", block], cwd=tmp_path, capture_output=True, text=True
    )
    assert shown.returncode == 0, shown.stderr
    assert len(shown.stdout.splitlines()) == 1 + runs["run"]["counts"]["frames"]


def test_the_tutorial_of_maps_finds_what_was_planted(tmp_path: Path) -> None:
    _follow("docs/tutorial-maps.md", tmp_path)
    scores = json.loads((tmp_path / "scored" / "scores.json").read_text())
    assert scores["recall"] >= 0.75
    first, again = (
        read_discrepancies(tmp_path / name / _FINDINGS) for name in ("checked", "again")
    )
    decided = {Status.CONFIRMED: 0, Status.REJECTED: 0}
    with (tmp_path / "decided" / "decisions.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            decided[Status(row["status"])] += 1
    assert decided[Status.REJECTED] == 1
    assert decided[Status.CONFIRMED] == len(first) - 1 == len(again)
    assert {finding.status for finding in again} == {Status.CONFIRMED}


def _scores(run: Path) -> dict[str, Any]:
    scores: dict[str, Any] = json.loads((run / "scores.json").read_text())
    return scores


def test_the_tutorial_of_labelling_runs_as_it_stands(tmp_path: Path) -> None:
    _follow("docs/tutorial-labelling.md", tmp_path)
    changes = json.loads((tmp_path / "changes" / "diff.json").read_text())["boxes_2d"]
    assert (changes["moved"], changes["relabelled"]) == (1, 1)
    assert (changes["removed"], changes["added"]) == (1, 1)


def test_the_tutorial_of_calibration_runs_with_fewer_boards(tmp_path: Path) -> None:
    whole = "percept synth calib --stops 3 --poses 36 --out stops"
    fewer = "percept synth calib --stops 2 --poses 8 --out stops"
    _follow("docs/tutorial-calibration.md", tmp_path, (whole, fewer))
    assert {_verdict(tmp_path / run) for run in ("lidars", "rig")} == {"good"}
    assert _verdict(tmp_path / "camera") == "doubtful", "eight boards do not cover the image"
    _assert_near_the_truth(tmp_path)
    _assert_files_for_ros_and_autoware(tmp_path)


@pytest.mark.slow
def test_the_tutorial_of_calibration_ends_at_the_truth(tmp_path: Path) -> None:
    _follow("docs/tutorial-calibration.md", tmp_path)
    assert {_verdict(tmp_path / run) for run in ("lidars", "camera", "rig")} == {"good"}
    _assert_near_the_truth(tmp_path)
    _assert_files_for_ros_and_autoware(tmp_path)


def _verdict(run: Path) -> str:
    verdict: str = json.loads((run / "run.json").read_text())["verdict"]
    return verdict


def _assert_near_the_truth(tmp_path: Path) -> None:
    truth = load_rig(tmp_path / "stops" / "truth" / "rig.yaml")
    for name, sensor in load_rig(tmp_path / "rig" / "rig.yaml").sensors.items():
        placed = truth.sensors[name].T_base_sensor
        assert placed is not None
        assert sensor.T_base_sensor is not None
        error = placed.inverse() @ sensor.T_base_sensor
        assert np.linalg.norm(error.translation_m) < 0.01, name
        assert np.trace(error.rotation) > 1 + 2 * np.cos(np.radians(0.1)), name


def _assert_files_for_ros_and_autoware(tmp_path: Path) -> None:
    assert (tmp_path / "tf" / "static_transforms.launch.py").is_file()
    assert (tmp_path / "kit" / "sensor_kit_calibration.yaml").is_file()


def test_the_readme_calibrates_with_the_commands_of_the_tutorial() -> None:
    (shown,) = _blocks(_section(_page("README.md"), "Calibrate"), "bash")
    told = set(_invocations(_page("docs/tutorial-calibration.md")))
    calls = list(_invocations(f"```bash\n{shown}```\n"))
    assert len(calls) == 6
    assert not [call for call in calls if call.strip() not in {t.strip() for t in told}]


def _barrels(run: Path) -> int:
    labels: dict[str, int] = json.loads((run / "run.json").read_text())["counts"]["labels"]
    return labels.get("barrel", 0)


def test_the_python_of_the_readme_runs(drive: Path, tmp_path: Path) -> None:
    (block,) = _blocks(_page("README.md"), "python")
    (tmp_path / "demo").symlink_to(drive)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", block], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert re.match(r"\d+% ground, \d+ clusters", done.stdout)


@pytest.mark.parametrize("page", ["docs/networks.md", "docs/lights.md"])
def test_the_python_of_a_page_runs(page: str, tmp_path: Path) -> None:
    assert len(_blocks(_page(page), "python")) == 1
    _follow(page, tmp_path)


@pytest.mark.parametrize("path", _NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_runs_and_is_stored_without_outputs(path: Path, tmp_path: Path) -> None:
    from nbclient import NotebookClient

    nbformat: Any = importlib.import_module("nbformat")  # its functions have no types
    notebook = nbformat.read(path, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len(notebook.cells) < 12
    assert not [cell for cell in code if cell.outputs or cell.execution_count]
    assert "._" not in "".join(cell.source for cell in code)
    resources = {"metadata": {"path": str(tmp_path)}}
    NotebookClient(notebook, timeout=60, kernel_name="python3", resources=resources).execute()
    pictures = [o for cell in code for o in cell.outputs if "image/png" in o.get("data", {})]
    assert pictures


@pytest.mark.slow
def test_the_pictures_and_figures_can_be_made_anew(tmp_path: Path) -> None:
    for name in ("docs", "scripts"):
        shutil.copytree(_ROOT / name, tmp_path / name)
    shutil.copy(_ROOT / "README.md", tmp_path)
    pictures = sorted((tmp_path / "docs" / "pictures").iterdir())
    for picture in pictures:
        if picture.name not in _PAGE_PICTURES:
            picture.unlink()
    script = tmp_path / "scripts" / "docs-pictures"
    done = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert sorted((tmp_path / "docs" / "pictures").iterdir()) == pictures
    figures = re.compile(r"^all +all +\d+ +\d+( +[01]\.\d\d){4}$", re.MULTILINE)
    assert figures.search((tmp_path / "README.md").read_text())
