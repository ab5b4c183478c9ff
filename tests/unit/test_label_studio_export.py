"""Label Studio's tasks and the interface that they are for."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from lxml import etree
from made_labelled_set import make_labelled_set
from renamed_labelled_set import HARD_NAMES, renamed

from percept.datasets.labelling.formats import export
from percept.datasets.labelling.formats.xml_text import xml_text
from percept.datasets.labelling.labelled_set import LabelledSet


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    made = renamed(make_labelled_set(tmp_path_factory.mktemp("tasks_set"), drives=3, keyframes=2))
    export(made, "label-studio", made.folder / "label-studio")
    return made


@pytest.fixture(scope="module")
def tasks(labelled: LabelledSet) -> list[dict[str, Any]]:
    text = (labelled.folder / "label-studio/tasks.json").read_bytes().decode("ascii")
    found: list[dict[str, Any]] = json.loads(text)
    return found


def test_regions_are_the_boxes_in_percent(
    labelled: LabelledSet, tasks: list[dict[str, Any]]
) -> None:
    for task, (_, frame) in zip(tasks, labelled.frames(), strict=True):
        regions = [region for one in task["predictions"] for region in one["result"]]
        assert [r["id"] for r in regions] == [f"box-{n}" for n in frame.boxes.ids.tolist()]
        names = [r["value"]["rectanglelabels"] for r in regions]
        assert names == [[xml_text(label)] for label in frame.boxes.labels]
        shares = np.array(
            [[r["value"][k] for k in ("x", "y", "width", "height")] for r in regions]
        ).reshape(-1, 4)
        assert ((shares >= 0) & (shares <= 100)).all()
        corners = np.hstack([shares[:, :2], shares[:, :2] + shares[:, 2:]])
        found = corners * (3.2, 2.0, 3.2, 2.0)
        np.testing.assert_allclose(found, frame.boxes.boxes_px, rtol=0, atol=1e-9)
        sizes = {(r["original_width"], r["original_height"]) for r in regions}
        assert sizes <= {frame.image_size}


def test_an_image_has_one_prediction_or_none(
    labelled: LabelledSet, tasks: list[dict[str, Any]]
) -> None:
    counts = [len(task["predictions"]) for task in tasks]
    assert counts == [int(len(frame.boxes) > 0) for _, frame in labelled.frames()]
    assert {one["model_version"] for task in tasks for one in task["predictions"]} == {
        "lidar, small"
    }
    assert tasks[0]["predictions"][0]["score"] == pytest.approx((0.875 + 0.4) / 2)


def test_a_region_says_where_it_is_from(tasks: list[dict[str, Any]]) -> None:
    network, lidar, person = tasks[0]["predictions"][0]["result"]
    assert (network["score"], network["meta"]) == (0.875, {"source": "small", "track_id": 7})
    assert (lidar["score"], lidar["meta"]) == (0.4, {"source": "lidar"})
    assert "score" not in person
    assert person["meta"] == {}


def test_addresses_lead_to_the_images(labelled: LabelledSet, tasks: list[dict[str, Any]]) -> None:
    for task, (keyframe, frame) in zip(tasks, labelled.frames(), strict=True):
        data = task["data"]
        address = urlsplit(data["image"])
        assert address.path == "/data/local-files/"
        (below,) = parse_qs(address.query)["d"]
        image = labelled.folder / "label-studio" / below
        assert image.samefile(labelled.folder / frame.file)
        assert (data["drive"], data["camera"]) == (keyframe.drive, frame.camera)
        assert (data["split"], data["stamp_ns"]) == (keyframe.split, str(frame.stamp_ns))


def test_the_interface_has_the_classes_and_what_the_regions_name(
    labelled: LabelledSet, tasks: list[dict[str, Any]]
) -> None:
    text = (labelled.folder / "label-studio/config.xml").read_text("utf-8")
    assert "encoding" not in text  # the reader refuses texts that declare one
    view = etree.fromstring(text)
    image, labels = view
    assert (image.tag, image.attrib["value"]) == ("Image", "$image")
    assert labels.attrib["toName"] == image.attrib["name"]
    assert [one.attrib["value"] for one in labels] == [xml_text(name) for name in HARD_NAMES]
    assert len({one.attrib["background"] for one in labels}) == len(HARD_NAMES)
    for region in tasks[0]["predictions"][0]["result"]:
        assert region["type"] == labels.tag.lower()
        assert (region["from_name"], region["to_name"]) == (
            labels.attrib["name"],
            image.attrib["name"],
        )


def test_what_persons_drew_alone_is_a_prediction_without_a_score(tmp_path: Path) -> None:
    made = make_labelled_set(tmp_path, drives=1, keyframes=1, cameras=("front", "left"))
    for _, frame in made.frames():
        frame.boxes.confidences[:] = np.nan
    export(made, "label-studio", tmp_path / "label-studio")
    first, last = json.loads((tmp_path / "label-studio/tasks.json").read_text())
    assert "score" not in first["predictions"][0]
    assert last["predictions"] == []
