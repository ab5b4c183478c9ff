"""`percept map validate` as a user runs it, on a short drive whose map is wrong in one place."""

from __future__ import annotations

import hashlib
import json
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from typer.testing import Result

from percept.core.map_findings import Decision, Status
from percept.datasets.synthetic.drive import DriveConfig, generate_drive
from percept.export.discrepancy_table import DISCREPANCIES, DiscrepancyRow, read_discrepancies
from percept.review import ReviewStore

Run = Callable[..., Result]


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive of 6 s with a map that has a stop line too many."""
    folder = tmp_path_factory.mktemp("street")
    config = DriveConfig(seed=3, seconds=6, beam_share=0.3, map_changes=1)
    generate_drive(config, folder)
    return folder


@pytest.fixture(scope="session")
def checked(street: Path, run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run folder of that drive, with lights."""
    folder = tmp_path_factory.mktemp("checked") / "run"
    result = _validate(run, street, folder, lights=True)
    assert result.exit_code == 0, result.output
    return folder


def _validate(run: Run, street: Path, out: Path, *more: object, lights: bool = False) -> Result:
    arguments: list[object] = ["--bag", street / "drive.mcap", "--out", out]
    if "--map" not in more:
        arguments += ["--map", street / "map.osm"]
    if not lights:
        arguments += ["--no-lights"]
    return run("map", "validate", *arguments, *more)


def _stop_line(folder: Path) -> dict[str, Any]:
    """Return the row of the one finding about a stop line: the map has one too many."""
    rows = pq.read_table(folder / "discrepancies.parquet").to_pylist()
    (row,) = [row for row in rows if row["kind"] == "stop_line_missing"]
    found: dict[str, Any] = row
    return found


def _content(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "run.json").read_text())
    return content


def _decision(row: DiscrepancyRow, status: Status) -> Decision:
    return Decision(
        finding_id=row.finding_id, status=status, comment="", kind=row.kind,
        map_element_id=row.map_element_id, along_m=row.along_m, length_m=row.length_m,
        x_m=row.x_m, y_m=row.y_m, offset_m=row.offset_m,
    )  # fmt: skip


def test_the_planted_change_is_found_and_shown(street: Path, checked: Path) -> None:
    (planted,) = json.loads((street / "truth" / "map_changes.json").read_text())
    row = _stop_line(checked)
    assert (row["kind"], row["map_element_id"]) == (planted["kind"], planted["map_element_id"])
    assert np.hypot(row["x"] - planted["x"], row["y"] - planted["y"]) < 1
    assert (row["drive"], row["sensor"]) == (0, "cam_front")
    picture = cv2.imread(str(checked / row["evidence"]))
    assert picture is not None
    assert picture.shape[1] == 2 * 640 + 6


def test_all_outputs_are_whole_and_run_json_adds_up(checked: Path) -> None:
    assert {path.name for path in checked.iterdir()} == {
        "discrepancies.parquet", "discrepancies.geojson", "coverage.parquet", "offsets.parquet",
        "map_lines.json", "evidence", "report.html", "view.rrd", "run.json",
    }  # fmt: skip
    content = _content(checked)
    counts = content["counts"]
    assert content["verdict"] == "good"
    assert counts["findings"] == sum(counts["kinds"].values()) == counts["statuses"]["open"] >= 1
    assert counts["way_m"] == pytest.approx(6 * 8, rel=0.3)
    coverage = pq.read_table(checked / "coverage.parquet").to_pylist()
    seen = sum(row["length_m"] * row["observed_share"] for row in coverage)
    assert counts["seen_m"] == pytest.approx(seen, abs=0.1)
    assert [Path(file["path"]).name for file in content["inputs"]] == ["drive.mcap", "map.osm"]
    assert "stop line missing" in (checked / "report.html").read_text()


def test_geojson_has_longitude_first_and_says_what_the_table_says(checked: Path) -> None:
    collection = json.loads((checked / "discrepancies.geojson").read_text())
    row = _stop_line(checked)
    (feature,) = [found for found in collection["features"] if found["id"] == row["id"]]
    assert collection["type"] == "FeatureCollection"
    assert "crs" not in collection
    longitude, latitude = np.mean(feature["geometry"]["coordinates"], axis=0)
    assert longitude == pytest.approx(row["longitude"], abs=1e-6)
    assert latitude == pytest.approx(row["latitude"], abs=1e-6)
    assert set(row) == set(DISCREPANCIES.names)
    assert feature["properties"]["observed"] == row["observed"]


def test_rejected_findings_do_not_come_back_and_force_keeps_decisions(
    street: Path, checked: Path, run: Run, tmp_path: Path
) -> None:
    out = tmp_path / "again"
    out.mkdir()
    (out / "evidence").mkdir()
    (out / "evidence" / "0099.png").write_bytes(b"of an older run")
    rows = read_discrepancies(checked / "discrepancies.parquet")
    with ReviewStore(out / "review.sqlite") as store:
        for row in rows:
            store.decide(_decision(row, Status.REJECTED))
    before = hashlib.sha256((out / "review.sqlite").read_bytes()).hexdigest()
    result = _validate(run, street, out, "--review", out / "review.sqlite", "--force", "--json")
    content = json.loads(result.stdout)
    assert content["counts"]["findings"] == 0
    assert content["counts"]["findings that a person rejected before"] == len(rows) > 0
    assert content == _content(out)
    assert not (out / "evidence").exists()
    assert hashlib.sha256((out / "review.sqlite").read_bytes()).hexdigest() == before


def test_two_drives_are_two_visits_and_evidence_is_of_the_right_log(
    street: Path, run: Run, tmp_path: Path
) -> None:
    twin = tmp_path / "drive.mcap"
    twin.write_bytes((street / "drive.mcap").read_bytes())
    out = tmp_path / "run"
    result = _validate(run, street, out, "--bag", twin)
    assert result.exit_code == 0, result.output
    content = _content(out)
    assert (content["counts"]["drives"], _stop_line(out)["visits"]) == (2, 2)
    assert {row["drive"] for row in pq.read_table(out / "offsets.parquet").to_pylist()} == {0, 1}
    assert any(str(twin) in note for note in content["notes"])  # two logs of one name
    assert len(json.loads((out / "map_lines.json").read_text())["paths"]) == 2


def test_a_map_elsewhere_is_refused_with_its_distance(
    street: Path, run: Run, tmp_path: Path
) -> None:
    osm = (street / "map.osm").read_text()
    plain = re.sub(r'k="local_[xy]"', 'k="unused"', osm)
    for shift, words in (("43.80", "comes no nearer than 2.2 km"), ("44.78", "km from the fixes")):
        far = tmp_path / f"{shift}.osm"
        far.write_text(plain.replace('lat="43.78', f'lat="{shift}'))
        out = tmp_path / "run"
        result = _validate(run, street, out, "--map", far)
        assert result.exit_code == 3
        assert words in result.stderr
        assert result.stderr.startswith("error: ")
        assert len(result.stderr.splitlines()) == 1
        assert not out.exists()


def test_a_map_of_latitudes_alone_and_without_heights_will_do(
    street: Path, run: Run, tmp_path: Path
) -> None:
    osm = (street / "map.osm").read_text()
    plain = re.sub(r'\s*<tag k="(local_[xy]|ele)"[^>]*/>|<MetaInfo[^>]*/>', "", osm)
    path = tmp_path / "plain.osm"
    path.write_text(plain)
    result = _validate(run, street, tmp_path / "run", "--map", path, lights=True)
    content = _content(tmp_path / "run")
    assert result.exit_code == 0
    assert content["counts"]["kinds"]["stop_line_missing"] == 1
    assert any("Heights of the poses" in note for note in content["notes"])
    assert any("no height over the road" in note for note in content["notes"])


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--map", "no.osm"], 3, "no.osm"),
        (["--origin", "here"], 2, "is no place"),
        (["--start", "100"], 3, "no scan in this part of the log"),
        (["--end", "0"], 2, "not after"),
        (["--review", "no.sqlite"], 3, "no.sqlite"),
        (["--camera", "front=/nope"], 3, "Topics with images: /cam_front"),
        (["--poses", "tf"], 3, "nothing tells where that is in the map"),
        (["--tolerance", "-1"], 2, "validation.tolerance_m"),
        (["--spacing", "0"], 2, "spacing_m"),
        (["--model", "far=no.onnx"], 2, "--no-lights makes no use of --model"),
    ],
)
def test_wrong_input_is_one_clear_line(
    street: Path, run: Run, tmp_path: Path, arguments: list[str], code: int, words: str
) -> None:
    out = tmp_path / "run"
    result = _validate(run, street, out, *arguments)
    assert result.exit_code == code
    assert words in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not out.exists()


def test_files_of_the_wrong_kind_are_named(street: Path, run: Run, tmp_path: Path) -> None:
    unpainted = tmp_path / "unpainted.osm"
    osm = (street / "map.osm").read_text()
    unpainted.write_text(re.sub("line_thin|line_thick", "road_border", osm))
    empty = tmp_path / "empty.osm"
    empty.write_text('<osm version="0.6"/>')
    settings = tmp_path / "settings.yaml"
    settings.write_text("spacng_m: 2\n")
    for arguments, code, words in (
        (["--map", unpainted], 3, "has no painted lines"),
        (["--map", empty], 3, "holds no points"),
        (["--review", empty], 3, "is not a database"),
        (["--config", settings], 2, "Did you mean 'spacing_m'"),
        (["--bag", street / "drive.mcap"], 2, "names a log twice"),
    ):
        result = _validate(run, street, tmp_path / "run", *arguments)
        assert result.exit_code == code, result.output
        assert words in result.stderr


def test_a_log_without_cameras_says_so(drive: Path, run: Run, tmp_path: Path) -> None:
    result = _validate(run, drive, tmp_path / "run")
    assert result.exit_code == 3
    assert "no images in the log" in result.stderr


def test_a_camera_that_looks_back_is_not_used(street: Path, run: Run, tmp_path: Path) -> None:
    rig = yaml.safe_load((street / "rig.yaml").read_text())
    place = rig["sensors"]["cam_front"]["T_base_sensor"]
    x, y, z, w = place["quat_xyzw"]
    place["quat_xyzw"] = [-y, x, w, -z]  # turned by half a circle about the vehicle's z
    turned = tmp_path / "rig.yaml"
    turned.write_text(yaml.safe_dump(rig))
    result = _validate(run, street, tmp_path / "run", "--rig", turned)
    assert result.exit_code == 3
    assert "cam_front is not looked at: it shows none of the road ahead" in result.stderr


def test_ctrl_c_leaves_nothing_that_looks_whole(street: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = [
        sys.executable, "-m", "percept.cli", "map", "validate", "--no-lights",
        "--bag", street / "drive.mcap", "--map", street / "map.osm", "--out", out,
    ]  # fmt: skip
    process = subprocess.Popen([str(word) for word in command], stderr=subprocess.PIPE, text=True)
    try:
        while process.poll() is None and not list(out.glob(".view.rrd*")):
            pass
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "interrupted" in said
    assert not out.exists()
