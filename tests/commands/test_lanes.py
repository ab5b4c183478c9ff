"""`percept lanes`: what it prints, writes and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import typer
from typer.testing import CliRunner

from percept.cli.lanes import lanes

_APP = typer.Typer()
_APP.command()(lanes)


def _road(path: Path) -> Path:
    """Write a road with two lines that meet in the middle of the image."""
    image = np.full((360, 640, 3), 90, np.uint8)
    image[:170] = 200
    for bottom in (60, 600):
        corners = [(320, 160), (bottom - 14, 359), (bottom + 14, 359)]
        cv2.fillPoly(image, [np.array(corners, np.int32)], (235, 235, 235), cv2.LINE_AA)
    image[:170] = 200
    cv2.imwrite(str(path), image)
    return path


def test_one_image_gives_one_document_and_several_a_list(tmp_path: Path) -> None:
    road = _road(tmp_path / "road.png")
    one = CliRunner().invoke(_APP, ["--image", str(road), "--json"])
    assert one.exit_code == 0, one.output
    document = json.loads(one.stdout)
    assert {line["side"] for line in document["lines"]} >= {"left", "right"}
    assert document["lane_width_m"] is None
    assert document["lines"][0]["points_m"] == document["lines"][0]["sd_m"] == []
    out = tmp_path / "run"
    two = CliRunner().invoke(
        _APP, ["--image", str(road), "--image", str(road), "--out", str(out), "--json"]
    )
    assert len(json.loads(two.stdout)["images"]) == 2
    written = {path.name for path in out.iterdir()}
    assert written == {"overlays", "lanes.json", "lanes.parquet", "report.html", "run.json"}
    assert len(list((out / "overlays").iterdir())) == 2
    assert json.loads((out / "run.json").read_text())["counts"]["both_lines"] == 2


def test_an_image_without_a_road_ends_with_4(tmp_path: Path) -> None:
    path = tmp_path / "grey.png"
    cv2.imwrite(str(path), np.full((200, 300, 3), 128, np.uint8))
    done = CliRunner().invoke(_APP, ["--image", str(path)])
    assert done.exit_code == 4
    assert "no lines were found" in done.stdout


def test_what_cannot_be_used_is_said(tmp_path: Path) -> None:
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"no image")
    for arguments, text in (
        ([], "give either --image or --bag"),
        (["--image", str(broken)], "no image that OpenCV can decode"),
        (["--image", str(tmp_path / "none.png")], "cannot be read"),
        (["--image", str(broken), "--camera", "front"], "--camera names a camera of a rig"),
    ):
        done = CliRunner().invoke(_APP, arguments)
        assert done.exception is not None
        assert text in str(done.exception)
