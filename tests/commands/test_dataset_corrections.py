"""`percept dataset import` and `percept dataset diff` as a user runs them."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from made_labelled_set import CATEGORIES, SIZE, make_labelled_set
from numpy.typing import NDArray
from played_labeller import LABELLERS
from typer.testing import Result

from percept.datasets.labelling.formats import export
from percept.datasets.labelling.labelled_set import LabelledSet
from percept.datasets.labelling.set_tables import read_set
from percept.export.label_diff_pictures import COLOURS

Run = Callable[..., Result]


@pytest.fixture
def labelled(tmp_path: Path) -> LabelledSet:
    """A set that a script has labelled in COCO: moved, relabelled, deleted and added boxes."""
    labelled = make_labelled_set(tmp_path / "set")
    export(labelled, "coco", labelled.folder / "coco")
    labeller = LABELLERS["coco"](labelled.folder / "coco", labelled)
    frames = [frame for _, frame in labelled.frames()]
    labeller.move(frames[0], 0, 6.0, 4.0)
    labeller.relabel(frames[1], 0, CATEGORIES[1])
    labeller.delete(frames[2], 1)
    labeller.add(frames[3], (200.0, 50.0, 240.0, 90.0), CATEGORIES[0])
    labeller.save()
    return labelled


def _digests(folder: Path) -> dict[Path, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_corrections_come_back_and_are_told(
    run: Run, labelled: LabelledSet, tmp_path: Path
) -> None:
    before = _digests(labelled.folder)
    back, changes = tmp_path / "back", tmp_path / "changes"
    coco = labelled.folder / "coco"
    done = run("dataset", "import", coco, "--of", labelled.folder, "--out", back)
    assert done.exit_code == 0, done.output
    assert "30 2D and 18 3D boxes in 12 images, from coco" in done.stdout
    assert "verdict: good" in done.stdout
    assert not list(back.glob("*.jpg"))
    assert not (back / "images").exists()
    assert sum(len(frame.boxes) for _, frame in read_set(back).frames()) == 30
    done = run("dataset", "diff", labelled.folder, back, "--out", changes, "--json")
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert document == json.loads((changes / "diff.json").read_text())
    total = document["boxes_2d"]
    assert {
        name: total[name] for name in ("moved", "relabelled", "added", "removed")
    } == dict.fromkeys(("moved", "relabelled", "added", "removed"), 1)
    assert (total["boxes_a"], total["boxes_b"], total["unchanged"]) == (30, 30, 27)
    car = document["by_class"][CATEGORIES[0]]
    # Of 10 cars one became a pedestrian, and one is new.
    assert (car["precision"], car["recall"]) == (0.9, 0.9)
    assert document["by_class"][CATEGORIES[1]]["relabelled_to"] == 1
    assert document["boxes_3d"]["unchanged"] == 18
    assert document["dropped"] == {}
    rows = pq.read_table(changes / "diff.parquet").to_pylist()
    assert len(rows) == 31
    (moved,) = [row for row in rows if row["change"] == "moved"]
    assert (moved["box_a"], moved["box_b"], moved["source_b"]) == (1, 1, "")
    assert moved["shift_px"] == pytest.approx(6)
    assert moved["x1_px_b"] == pytest.approx(moved["x1_px_a"] + 6)
    (added,) = [row for row in rows if row["change"] == "added"]
    assert added["box_a"] is None
    assert added["iou"] is None
    assert (changes / "run.json").is_file()
    assert _digests(labelled.folder) == before


def test_the_report_shows_what_changed(run: Run, labelled: LabelledSet, tmp_path: Path) -> None:
    back, changes = tmp_path / "back", tmp_path / "changes"
    for _, frame in labelled.frames():
        grey = np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)
        cv2.imwrite(str(labelled.folder / frame.file), grey)
    run("dataset", "import", labelled.folder / "coco", "--of", labelled.folder, "--out", back)
    shown = run("dataset", "diff", labelled.folder, back, "--out", changes)
    assert "all classes" in shown.stdout
    assert "verdict: doubtful" in shown.stdout  # 30 boxes are few
    page = (changes / "report.html").read_text(encoding="utf-8")
    for title in ("Removed", "Added", "Relabelled", "Moved"):
        assert f"<h2>{title}:" in page
    assert "Straßenschild &quot;&lt;&amp;&gt;&quot;" in page
    sheets = [
        np.asarray(cv2.imdecode(np.frombuffer(base64.b64decode(text), np.uint8), 1))
        for text in re.findall(r"data:image/jpeg;base64,([^\"]+)", page)
    ]
    assert len(sheets) == 4
    removed, added, relabelled, moved = sheets
    for sheet, sides in ((removed, "A"), (added, "B"), (relabelled, "B"), (moved, "AB")):
        for side in sides:
            assert _share(sheet, COLOURS[side]) > 0.002
    assert _share(removed, COLOURS["B"]) == 0
    assert _share(added, COLOURS["A"]) == 0
    assert _share(removed[:, :300], (128, 128, 128)) > 0.5  # the image is there


def _share(picture: NDArray[np.generic], rgb: tuple[int, int, int]) -> float:
    """Return how much of a picture has about a colour; thin lines of a JPEG have none exactly."""
    apart = np.abs(picture.astype(int) - np.array(rgb[::-1])).max(axis=2)
    return float((apart < 70).mean())


def test_a_set_is_what_it_is(run: Run, labelled: LabelledSet, tmp_path: Path) -> None:
    out = tmp_path / "same"
    done = run("dataset", "diff", labelled.folder, labelled.folder, "--out", out, "--json")
    document = json.loads(done.stdout)
    assert document["boxes_2d"]["unchanged"] == 30
    assert document["boxes_2d"]["precision"] == document["boxes_2d"]["recall"] == 1
    assert "data:image" not in (out / "report.html").read_text()


def test_images_that_only_one_has_make_it_doubtful(
    run: Run, labelled: LabelledSet, tmp_path: Path
) -> None:
    file = next((labelled.folder / "coco" / "annotations").glob("instances_val.json"))
    back, out = tmp_path / "back", tmp_path / "changes"
    done = run("dataset", "import", file, "--of", labelled.folder, "--out", back, "--json")
    record = json.loads(done.stdout)
    assert record["verdict"] == "doubtful"
    assert record["dropped"] == {"images of the data set that the labels do not have": 6}
    done = run("dataset", "diff", labelled.folder, back, "--out", out, "--json")
    assert json.loads(done.stdout)["dropped"] == {"images that only A has": 6}


def test_nothing_to_compare_ends_with_4(run: Run, tmp_path: Path) -> None:
    empty = make_labelled_set(
        tmp_path / "empty", drives=1, keyframes=1, cameras=("front",), with_scans=False
    )
    out = tmp_path / "out"
    done = run("dataset", "diff", empty.folder, empty.folder, "--out", out)
    assert done.exit_code == 4
    assert "verdict: bad" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("import", "set/none", "--of", "set", "--out", "out"), "does not exist"),
        (("import", "set/coco", "--of", "set/coco", "--out", "out"), "holds no data set"),
        (("import", "set/images", "--of", "set", "--out", "out"), "none of the known formats"),
        (("import", "set/boxes_2d.parquet", "--of", "set", "--out", "out"), "--format"),
        (("diff", "set", "set/coco", "--out", "out"), "holds no data set"),
        (("diff", "set", "other", "--out", "out"), "no image of the other"),
    ],
)
def test_what_cannot_be_used_is_one_line(
    arguments: tuple[str, ...],
    what: str,
    run: Run,
    labelled: LabelledSet,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    make_labelled_set(tmp_path / "other", drives=1, keyframes=1, cameras=("back",))
    monkeypatch.chdir(labelled.folder.parent)
    done = run("dataset", *arguments)
    assert done.exit_code == 3, done.output
    assert what in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_set_is_not_written_over(run: Run, labelled: LabelledSet) -> None:
    before = _digests(labelled.folder)
    arguments = ("dataset", "import", labelled.folder / "coco", "--of", labelled.folder)
    done = run(*arguments, "--out", labelled.folder)
    assert done.exit_code == 2
    done = run(*arguments, "--out", labelled.folder, "--force")
    assert done.exit_code == 2
    assert "would be written over" in done.stderr
    assert _digests(labelled.folder) == before
