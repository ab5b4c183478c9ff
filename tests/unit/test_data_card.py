"""The data card, the report and the map of a data set, and the distances that they state."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from made_labelled_set import make_labelled_set

from percept.core.errors import GeometryError
from percept.core.results import Verdict
from percept.datasets.labelling.card import write_card
from percept.datasets.labelling.card_gaps import known_gaps
from percept.datasets.labelling.card_markdown import marked, plain
from percept.datasets.labelling.dropped import DroppedFrame, drop_counts, write_dropped
from percept.datasets.labelling.labelled_set import LabelledSet
from percept.datasets.labelling.places.distances import least_distances, nearest_across
from percept.export.dataset_pictures import chosen_pictures, dropped_pictures
from percept.export.dataset_report import dataset_report
from percept.export.report import Picture, Table, write_report
from percept.export.split_map import SPLIT_COLOURS, split_maps


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    return make_labelled_set(tmp_path_factory.mktemp("set"), drives=3, keyframes=4)


@pytest.fixture(scope="module")
def dropped(labelled: LabelledSet) -> tuple[DroppedFrame, ...]:
    return tuple(_dropped(labelled))


def _dropped(labelled: LabelledSet) -> Iterator[DroppedFrame]:
    frames = [frame for _, frame in labelled.frames()]
    drive = next(iter(labelled.drives.values()))
    for number, reason in enumerate(["blurred", "duplicate", "duplicate", "margin"]):
        yield DroppedFrame(
            log=drive.log,
            drive=drive.name,
            camera="front",
            stamp_ns=number,
            reason=reason,
            of=frames[number].file if reason == "duplicate" else "",
            picture=None if reason == "margin" else labelled.folder / frames[number + 4].file,
            latitude=48.1,
            longitude=11.5 + number * 1e-5,
        )


def _card(labelled: LabelledSet, folder: Path, **more: object) -> dict[str, str]:
    """Return the parts of the card by their titles."""
    moved = replace(labelled, folder=folder)
    given: dict[str, object] = {"dropped": {}, "losses": {}, "settings": {}} | more
    write_card(moved, **given)  # type: ignore[arg-type]  # each test gives what it is about
    text = (folder / "README.md").read_text(encoding="utf-8")
    parts = re.split(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def test_card_says_what_the_set_holds(labelled: LabelledSet, tmp_path: Path) -> None:
    card = _card(
        labelled,
        tmp_path,
        dropped={"blurred": 3},
        losses={"yolo": ("Tracks, see `a|b`.",)},
        settings={"split": {"margin_m": 20.0}},
        margin_m=20.0,
        calibration=dict.fromkeys(labelled.drives, "v7, `good`"),
        notes=("Said once.", "Said once."),
    )
    assert "| images | 8 | 8 | 8 | 24 |" in card["Contents"]
    assert "| 3D boxes | 12 | 12 | 12 | 36 |" in card["Contents"]
    assert "| car | 7 | 7 | 7 | 21 | 24 |" in card["Classes"]
    assert "2023-11-14T22:30:00.123456Z" in card["Logs"]
    assert "| drive-000001 | left | 320 x 200 | pinhole | yes | 4 | 14.0 |" in card["Sensors"]
    assert card["Calibration"].strip() == "- all drives: v7, `good`"
    assert "| images | small | 21 | sha256:00 |" in card["Where the boxes are from"]
    assert "asked for: 20 m" in card["Splits"]
    assert "| blurred | 3 |" in card["What was left out"]
    assert "| `yolo/` | See its README.md. Tracks, see `a\\|b`. |" in card["Files"]
    assert card["Known gaps"].count("Said once.") == 1
    assert card["Licence"].strip() == "CC-BY-4.0"
    assert "margin_m: 20.0" in card["Settings"]


def test_card_measures_the_margin(labelled: LabelledSet, tmp_path: Path) -> None:
    measured = re.search(
        r"train and val, measured: ([\d.]+) m", _card(labelled, tmp_path)["Splits"]
    )
    assert measured is not None
    # From the last moment of one drive to the first of the next: 0.01 deg less three steps.
    assert float(measured[1]) == pytest.approx((0.01 - 3 * 4.5e-5) * 111_200, rel=1e-3)


def test_card_of_a_bare_set_says_what_it_lacks(tmp_path: Path) -> None:
    made = make_labelled_set(
        tmp_path, drives=1, with_scans=False, located=False, rectified_suffix=None
    )
    bare = replace(made, categories=(), keyframes=(), licence="", anonymised=("faces",))
    card = _card(bare, tmp_path, blurred={"faces": 12})
    assert "No licence was given." in card["Known gaps"]
    assert all(f"split {name} is empty" in card["Known gaps"] for name in ("train", "val", "test"))
    assert "There are no boxes." in card["Classes"]
    assert "scans/" not in card["Files"]
    assert "rectified/" not in card["Files"]
    assert "faces: 12 regions" in card["Privacy"]
    gaps = " ".join(known_gaps(made))
    assert "Of 3 of 3 moments it is not known where they are." in gaps
    assert "3 of 3 moments have no LiDAR points." in gaps
    assert "No licence" not in gaps


def test_names_cannot_become_markup() -> None:
    assert plain('a <img src="x">\n| b_c') == 'a \\<img src="x"\\> \\| b\\_c'
    assert marked("see `a_b|c` and <d>") == "see `a_b\\|c` and \\<d\\>"
    assert marked("one ` alone_") == "one \\` alone\\_"


def test_dropped_images_are_a_table(
    dropped: tuple[DroppedFrame, ...], labelled: LabelledSet, tmp_path: Path
) -> None:
    write_dropped(tmp_path, dropped)
    rows = pq.read_table(tmp_path / "dropped.parquet").to_pylist()
    assert [row["reason"] for row in rows] == ["blurred", "duplicate", "duplicate", "margin"]
    assert rows[0]["of"] is None
    assert (labelled.folder / rows[1]["of"]).is_file()
    assert drop_counts(dropped) == {"duplicate": 2, "blurred": 1, "margin": 1}


def test_report_shows_chosen_and_dropped_images(
    labelled: LabelledSet, dropped: tuple[DroppedFrame, ...], tmp_path: Path
) -> None:
    content = dataset_report(
        labelled, dropped, verdict=Verdict.GOOD, why=("fine",), others={"broken": 2},
        losses={"coco": ()},
    )  # fmt: skip
    blocks = {section.title: section.blocks for section in content.sections}
    shown = [block for block in blocks["Chosen images"] if isinstance(block, Picture)]
    assert [one.caption for one in shown] == [
        f"{split}: 8 of 8 images, spread evenly" for split in ("train", "val", "test")
    ]
    left_out = [one for one in blocks["Images that were left out"] if isinstance(one, Picture)]
    assert [one.caption.split(",")[0] for one in left_out] == [
        "duplicate: 2 of 2 images",
        "blurred: 1 of 1 images",
    ]
    tables = [block for block in blocks["Classes"] if isinstance(block, Table)]
    assert ("car", "7", "7", "7", "21") in tables[0].rows
    assert ("pedestrian", "4", "4", "4", "12") in tables[1].rows
    assert ("broken", "2") in next(
        b for b in blocks["What was left out"] if isinstance(b, Table)
    ).rows
    assert len(blocks["Distances and sizes"]) == 2
    write_report(tmp_path / "report.html", content)
    assert "8 of 8 images" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_pictures_that_are_not_there_are_left_out(
    labelled: LabelledSet, dropped: tuple[DroppedFrame, ...], tmp_path: Path
) -> None:
    assert chosen_pictures(replace(labelled, folder=tmp_path)) == {}
    (tmp_path / "empty.jpg").touch()
    gone = [replace(one, picture=tmp_path / "empty.jpg") for one in dropped]
    assert dropped_pictures(gone, labelled.folder) == {}


def test_a_duplicate_stands_beside_what_it_repeats(
    labelled: LabelledSet, dropped: tuple[DroppedFrame, ...]
) -> None:
    grids = dropped_pictures(dropped, labelled.folder)
    single, pair = (
        grids[reason].picture.shape[0] / grids[reason].picture.shape[1]
        for reason in ("blurred", "duplicate")
    )
    assert grids["duplicate"].shown == 2
    assert pair < single / 2  # two pictures side by side, twice


def test_map_draws_each_split_in_its_colour() -> None:
    rows = {"train": 0.0, "val": 1e-3, "left out": 2e-3}
    places = {
        name: np.array([[48.0 + north, 11.0 + 1e-4 * k] for k in range(4)])
        for name, north in rows.items()
    }
    (svg,) = split_maps(places | {"test": np.zeros((0, 2))})
    dots = {
        colour: [float(y) for y in re.findall(r"M[\d.]+ ([\d.]+)h0", marks)]
        for marks, colour in re.findall(r'<path d="([^"]*)" stroke="(#\w+)"', svg)
    }
    assert set(dots) == {SPLIT_COLOURS[name] for name in rows}
    north_up = [dots[SPLIT_COLOURS[name]][0] for name in ("train", "val", "left out")]
    assert north_up == sorted(north_up, reverse=True)
    assert SPLIT_COLOURS["test"] not in svg


def test_places_far_apart_are_maps_of_their_own() -> None:
    near = np.array([[48.0, 11.0], [48.01, 11.0], [48.02, 11.01]])
    maps = split_maps({"train": near, "val": np.array([[52.5, 13.4], [-33.0, 151.0]])})
    assert [len(re.findall("h0", svg)) for svg in maps] == [3, 1, 1]
    assert "area 1 of 3" in maps[0]
    assert split_maps({"train": np.zeros((0, 2))}) == ()


def test_distances_across_splits() -> None:
    latitudes = [48.0, 48.0, 48.001, math.nan]
    longitudes = [11.0, 11.1, 11.0, 11.0]
    (one,) = nearest_across(latitudes, longitudes, ["train", "train", "val", "val"])
    assert (one.part, one.other) == ("val", "train")
    assert (one.places.tolist(), one.nearest.tolist()) == ([2], [0])
    assert one.distances_m[0] == pytest.approx(111.2, abs=0.05)  # a thousandth of a degree there
    with pytest.raises(GeometryError):
        list(nearest_across([1.0], [1.0, 2.0], ["train", "val"]))


def test_distances_hold_across_the_antimeridian() -> None:
    (one,) = nearest_across([0.0, 0.0], [179.9999, -179.9999], ["train", "test"])
    assert one.distances_m[0] == pytest.approx(22.26, abs=0.01)


def test_least_distances_of_a_set(labelled: LabelledSet) -> None:
    assert set(least_distances(labelled)) == {("train", "val"), ("train", "test"), ("val", "test")}


def test_report_holds_its_pictures(labelled: LabelledSet) -> None:
    content = dataset_report(labelled, (), verdict=Verdict.GOOD, why=())
    pictures = [b for section in content.sections for b in section.blocks if isinstance(b, Picture)]
    jpegs = [one for one in pictures if one.data_uri.startswith("data:image/jpeg")]
    assert len(jpegs) == 3
    assert all(base64.b64decode(one.data_uri.partition(",")[2])[:2] == b"\xff\xd8" for one in jpegs)
