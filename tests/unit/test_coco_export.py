"""COCO files as pycocotools reads them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from made_labelled_set import make_labelled_set
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval
from renamed_labelled_set import HARD_NAMES, renamed

from percept.datasets.labelling.formats import export
from percept.datasets.labelling.formats.image_box import each_box
from percept.datasets.labelling.labelled_set import SPLITS, LabelledSet
from percept.datasets.labels.coco import read_coco


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    made = renamed(make_labelled_set(tmp_path_factory.mktemp("coco_set"), drives=3, keyframes=2))
    export(made, "coco", made.folder / "coco")
    return made


def _opened(labelled: LabelledSet, split: str) -> COCO:
    return COCO(str(labelled.folder / f"coco/annotations/instances_{split}.json"))


def test_pycocotools_reads_the_boxes_of_every_image(labelled: LabelledSet) -> None:
    seen = 0
    for split in SPLITS:
        coco = _opened(labelled, split)
        names = {one["id"]: one["name"] for one in coco.loadCats(coco.getCatIds())}
        assert names == dict(enumerate(HARD_NAMES, 1))
        frames = [frame for keyframe, frame in labelled.frames() if keyframe.split == split]
        assert len(frames) == len(coco.imgs) > 0
        for frame in frames:
            image = coco.imgs[frame.frame + 1]
            assert (image["width"], image["height"]) == frame.image_size
            placed = labelled.folder / "coco/images" / split / image["file_name"]
            assert placed.samefile(labelled.folder / frame.file)
            found = coco.loadAnns(coco.getAnnIds(imgIds=[image["id"]]))
            assert [names[one["category_id"]] for one in found] == list(frame.boxes.labels)
            sides = np.array([one["bbox"] for one in found]).reshape(-1, 4)
            corners = np.hstack([sides[:, :2], sides[:, :2] + sides[:, 2:]])
            np.testing.assert_allclose(corners, frame.boxes.boxes_px, rtol=0, atol=1e-9)
            assert [one["id"] for one in found] == frame.boxes.ids.tolist()
            seen += len(found)
    assert seen == sum(len(frame.boxes) for _, frame in labelled.frames()) > 20


def test_what_is_known_of_a_pre_label_is_beside_it(labelled: LabelledSet) -> None:
    coco = _opened(labelled, "train")
    _, frame = next(labelled.frames())
    by_network, by_lidar, by_person = (coco.anns[n] for n in frame.boxes.ids.tolist())
    # A score outside the attributes would make a result of what is a label.
    assert "score" not in by_network
    assert by_network["attributes"] == {
        "score": 0.875,
        "source": "small",
        "track_id": 7,
        "box_3d": 1,
        "truncated": 0.0,
        "occluded": 0.1,
    }
    assert by_lidar["attributes"]["source"] == "lidar"
    assert "track_id" not in by_lidar["attributes"]
    assert by_person["attributes"] == {}
    x1, y1, x2, y2 = next(each_box(frame.boxes)).box_px
    assert by_network["area"] == pytest.approx((x2 - x1) * (y2 - y1))


def test_the_boxes_score_one_against_themselves(labelled: LabelledSet) -> None:
    truth = _opened(labelled, "val")
    results = [
        {"image_id": a["image_id"], "category_id": a["category_id"], "bbox": a["bbox"], "score": 1}
        for a in truth.anns.values()
    ]
    scores = COCOeval(truth, truth.loadRes(results), "bbox")
    scores.evaluate()
    scores.accumulate()
    scores.summarize()
    assert scores.stats[0] == pytest.approx(1.0)


def test_files_are_ascii_and_have_what_other_readers_ask_for(labelled: LabelledSet) -> None:
    path = labelled.folder / "coco/annotations/instances_test.json"
    document = json.loads(path.read_bytes().decode("ascii"))
    assert document["info"]["description"] == labelled.name
    assert document["licenses"] == [{"id": 1, "name": "CC-BY-4.0", "url": ""}]
    assert {image["license"] for image in document["images"]} == {1}
    assert all({"iscrowd", "segmentation"} <= set(one) for one in document["annotations"])


def test_our_reader_takes_them_back(labelled: LabelledSet) -> None:
    back = read_coco(labelled.folder / "coco/annotations/instances_train.json")
    truth = [frame for keyframe, frame in labelled.frames() if keyframe.split == "train"]
    assert not back.dropped
    assert [image.name for image in back.images] == [Path(f.file).name for f in truth]
    for image, frame in zip(back.images, truth, strict=True):
        assert image.labels == frame.boxes.labels
        np.testing.assert_allclose(image.boxes_px, frame.boxes.boxes_px, rtol=0, atol=1e-9)


def test_a_split_without_images_has_no_file(tmp_path: Path) -> None:
    made = make_labelled_set(tmp_path, drives=1, keyframes=1)
    losses = export(made, "coco", tmp_path / "coco")
    files = sorted(path.name for path in (tmp_path / "coco/annotations").iterdir())
    assert files == ["instances_train.json"]
    readme = (tmp_path / "coco/README.md").read_text("utf-8")
    assert losses
    assert all(loss in readme for loss in losses)
