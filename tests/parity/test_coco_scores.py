"""Scores against pycocotools run directly on files, as its documentation says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from percept.datasets.labels import read_detections, read_labels
from percept.evaluation.boxes_2d import BoxScores, score_boxes
from percept.evaluation.boxes_2d.bootstrap import class_ap
from percept.evaluation.boxes_2d.coco import run_coco
from percept.evaluation.boxes_2d.config import BoxScoreConfig
from percept.evaluation.boxes_2d.pairing import pair_images
from percept.evaluation.boxes_2d.tables import detection_table, truth_table

_CLASSES = ("car", "deer", "cone")


def _random_set(seed: int, *, crowds: bool = True) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return instances and results: found, missed, invented, misplaced, misnamed, tied."""
    rng = np.random.default_rng(seed)
    images = int(rng.integers(3, 25))
    annotations: list[dict[str, Any]] = []
    results: list[dict[str, Any]] = []
    for image in range(images):
        for _ in range(int(rng.integers(0, 9))):
            box = _box(rng)
            label = int(rng.integers(0, len(_CLASSES)))
            crowd = int(crowds and rng.random() < 0.1)
            annotations.append(
                {
                    "id": len(annotations) + 1, "image_id": image, "category_id": label,
                    "bbox": box.tolist(), "area": float(box[2] * box[3]), "iscrowd": crowd,
                }
            )  # fmt: skip
            for _ in range(int(rng.choice([0, 1, 1, 1, 2]))):
                moved = box + rng.normal(0, 0.08, 4) * box[[2, 3, 2, 3]]
                kept = label if rng.random() < 0.9 else int(rng.integers(0, len(_CLASSES)))
                results.append(_result(rng, image, kept, moved))
        results += [
            _result(rng, image, int(rng.integers(0, len(_CLASSES))), _box(rng))
            for _ in range(int(rng.integers(0, 4)))
        ]
    instances = {
        "images": [{"id": k, "file_name": f"{k:06d}.jpg"} for k in range(images)],
        "categories": [{"id": k, "name": name} for k, name in enumerate(_CLASSES)],
        "annotations": annotations,
    }
    return instances, results


def _box(rng: np.random.Generator) -> NDArray[np.float64]:
    sides = np.exp(rng.uniform(np.log(8), np.log(200), 2))
    return np.concatenate([rng.uniform(0, 600, 2), sides])


def _result(
    rng: np.random.Generator, image: int, label: int, box: NDArray[np.float64]
) -> dict[str, Any]:
    box[2:] = np.maximum(box[2:], 1.0)
    score = round(float(rng.random()), 2)  # two digits, so that some are equal
    return {"image_id": image, "category_id": label, "bbox": box.tolist(), "score": score}


def _files(folder: Path, instances: object, results: object) -> tuple[Path, Path]:
    labels, found = folder / "instances.json", folder / "results.json"
    labels.write_text(json.dumps(instances))
    found.write_text(json.dumps(results))
    return labels, found


def _ours(labels: Path, found: Path) -> BoxScores:
    truth = read_labels(labels, "coco")
    return score_boxes(truth, read_detections(found, "coco", truth))


def _theirs(labels: Path, found: Path, label: int | None = None) -> NDArray[np.float64]:
    """Return the twelve figures of pycocotools: AP, AP50, AP75, AP by size, and AR."""
    truth = COCO(str(labels))
    evaluation = COCOeval(truth, truth.loadRes(str(found)), "bbox")
    if label is not None:
        evaluation.params.catIds = [label]
    evaluation.evaluate()
    evaluation.accumulate()
    evaluation.summarize()
    return np.asarray(evaluation.stats)


@pytest.mark.parametrize("seed", range(12))
def test_average_precision_is_that_of_pycocotools(seed: int, tmp_path: Path) -> None:
    labels, found = _files(tmp_path, *_random_set(seed))
    ours, theirs = _ours(labels, found), _theirs(labels, found)
    sizes = {name: average for name, (average, _) in ours.by_size.items()}
    assert [ours.average.ap, ours.average.ap50, ours.average.ap75] == pytest.approx(
        theirs[:3], abs=1e-9
    )
    assert ours.average.ar == pytest.approx(theirs[8], abs=1e-9)
    for place, name in enumerate(("small", "medium", "large")):
        if theirs[3 + place] >= 0:  # -1 is no object
            assert sizes[name].ap == pytest.approx(theirs[3 + place], abs=1e-9)
            assert sizes[name].ar == pytest.approx(theirs[9 + place], abs=1e-9)


@pytest.mark.parametrize("seed", range(12, 15))
def test_each_class_is_that_of_pycocotools(seed: int, tmp_path: Path) -> None:
    labels, found = _files(tmp_path, *_random_set(seed))
    ours = {one.label: one for one in _ours(labels, found).classes}
    for place, name in enumerate(_CLASSES):
        theirs = _theirs(labels, found, place)
        if theirs[0] < 0:
            continue
        average = ours[name].average
        assert ours[name].precision_at_recall.mean() == pytest.approx(average.ap50, abs=1e-9)
        assert [average.ap, average.ap50, average.ap75, average.ar] == pytest.approx(
            theirs[[0, 1, 2, 8]], abs=1e-9
        )


@pytest.mark.parametrize("seed", range(20, 26))
def test_counts_follow_the_matches_of_pycocotools(seed: int, tmp_path: Path) -> None:
    labels, found = _files(tmp_path, *_random_set(seed))
    truth = COCO(str(labels))
    evaluation = COCOeval(truth, truth.loadRes(str(found)), "bbox")
    evaluation.params.iouThrs = np.array([0.6])
    evaluation.evaluate()
    objects = detections = hits = 0
    for one in evaluation.evalImgs:
        if one is not None and one["aRng"] == evaluation.params.areaRng[0]:
            kept = (np.array(one["dtScores"]) >= 0.4) & ~one["dtIgnore"][0].astype(bool)
            objects += int((one["gtIgnore"] == 0).sum())
            detections += int(kept.sum())
            hits += int((kept & (one["dtMatches"][0] > 0)).sum())
    ours = read_labels(labels, "coco")
    scores = score_boxes(
        ours, read_detections(found, "coco", ours), BoxScoreConfig(iou=0.6, score=0.4)
    )
    counts = scores.counts
    assert (counts.objects, counts.detections, counts.hits) == (objects, detections, hits)
    assert sum(scores.mistakes.values()) == detections - hits
    assert sum(n.objects for n in scores.by_height.values()) == objects
    assert sum(n.hits for n in scores.by_height.values()) == hits


@pytest.mark.parametrize("seed", range(30, 33))
def test_the_bootstrap_computes_the_same_average(seed: int, tmp_path: Path) -> None:
    labels, found = _files(tmp_path, *_random_set(seed))
    truth = read_labels(labels, "coco")
    pairs = pair_images(truth, read_detections(found, "coco", truth), {})
    wanted, made = truth_table(pairs, BoxScoreConfig()), detection_table(pairs)
    images, classes = len(pairs.images), len(pairs.classes)
    coco = run_coco(wanted, made, images=images, classes=classes, iou=0.5, lowest_px=0)
    assert (coco.at_half.truth[~coco.at_half.counted] == -1).all()
    for label in range(classes):
        rows = np.flatnonzero((made.label == label) & coco.at_half.counted)
        rows = rows[np.argsort(-made.score[rows], kind="stable")]
        hit = (coco.at_half.truth[rows] >= 0).astype(float)
        objects = float((wanted.counted & (wanted.label == label)).sum())
        once = class_ap(np.ones(images), made.image[rows], hit, objects)
        twice = class_ap(np.full(images, 2.0), made.image[rows], hit, 2 * objects)
        assert once == pytest.approx(coco.by_class[label].ap50, abs=1e-9)
        assert twice == pytest.approx(once, abs=1e-9)


def test_the_overlap_of_the_counts_changes_no_average(tmp_path: Path) -> None:
    labels, found = _files(tmp_path, *_random_set(40))
    truth = read_labels(labels, "coco")
    detections = read_detections(found, "coco", truth)
    usual = score_boxes(truth, detections)
    loose, strict = (score_boxes(truth, detections, BoxScoreConfig(iou=x)) for x in (0.3, 0.83))
    assert loose.counts.hits >= usual.counts.hits > strict.counts.hits
    for scores in (loose, strict):
        assert scores.average == usual.average
        assert scores.ap50_interval == usual.ap50_interval
        for one, other in zip(scores.classes, usual.classes, strict=True):
            np.testing.assert_array_equal(one.precision_at_recall, other.precision_at_recall)


def test_an_annotation_with_the_id_0_counts(tmp_path: Path) -> None:
    """pycocotools alone gives an AP of 0 here: an id of 0 means 'no match' to it."""
    instances = {
        "images": [{"id": 0, "file_name": "a.jpg"}],
        "categories": [{"id": 0, "name": "car"}],
        "annotations": [
            {"id": 0, "image_id": 0, "category_id": 0, "bbox": [10, 10, 50, 40], "iscrowd": 0,
             "area": 2000}
        ],
    }  # fmt: skip
    results = [{"image_id": 0, "category_id": 0, "bbox": [10, 10, 50, 40], "score": 0.9}]
    labels, found = _files(tmp_path, instances, results)
    assert _ours(labels, found).average.ap == pytest.approx(1.0)
    assert _theirs(labels, found)[0] == 0.0
