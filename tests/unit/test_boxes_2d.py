"""Scores of 2D boxes: small sets that are worked out by hand."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from percept.core.errors import GeometryError, InputError, UsageError
from percept.core.labels import ANY_LABEL, LabelledImage, LabelSet
from percept.core.results import Verdict
from percept.evaluation.boxes_2d import BoxScoreConfig, Counts, score_boxes, scores_as_json

_CAR = (100.0, 100.0, 180.0, 150.0)  # 80 x 50
_FAR = (300.0, 100.0, 320.0, 112.0)  # 20 x 12
_EMPTY = (500.0, 300.0, 540.0, 330.0)


def _image(name: str, *boxes: tuple[Any, ...], **columns: Any) -> LabelledImage:
    """Return an image of (label, box) or (label, box, confidence)."""
    confidences = [box[2] for box in boxes] if boxes and len(boxes[0]) == 3 else None
    return LabelledImage.of(
        name,
        [box[1] for box in boxes],
        [str(box[0]) for box in boxes],
        confidences,
        **columns,
    )


def _set(*images: LabelledImage, complete: bool = True) -> LabelSet:
    return LabelSet(images, complete=complete)


def _shifted(box: Sequence[float], dx: float) -> tuple[float, ...]:
    return (box[0] + dx, box[1], box[2] + dx, box[3])


def test_all_found_is_one_and_firm_with_enough_objects() -> None:
    images = [_image(f"{k}", ("car", _CAR), ("deer", _FAR)) for k in range(60)]
    found = [_image(f"{k}", ("car", _CAR, 0.9), ("deer", _FAR, 0.8)) for k in range(60)]
    scores = score_boxes(_set(*images), _set(*found))
    average = scores.average
    assert (average.ap50, average.ap75, average.ap, average.ar) == pytest.approx((1, 1, 1, 1))
    assert scores.ap50_interval == pytest.approx((1, 1))
    assert scores.counts == Counts(120, 120, 120)
    assert (scores.counts.precision, scores.counts.recall, scores.counts.f1) == (1, 1, 1)
    assert not scores.mistakes
    assert not scores.worst
    assert scores.verdict is Verdict.GOOD


def test_nothing_found_is_zero() -> None:
    scores = score_boxes(_set(_image("a", ("car", _CAR))), _set(complete=False))
    assert scores.average.ap50 == 0
    assert scores.counts == Counts(1, 0, 0)
    assert math.isnan(scores.counts.precision)
    assert scores.counts.recall == 0
    assert scores.verdict is Verdict.DOUBTFUL
    assert any("not one detection" in reason for reason in scores.why)


@pytest.mark.parametrize("found", [(), (("car", _CAR, 0.9),)])
def test_without_objects_there_is_no_figure_and_the_verdict_is_bad(
    found: tuple[tuple[Any, ...], ...],
) -> None:
    scores = score_boxes(_set(_image("a")), _set(_image("a", *found)))
    assert math.isnan(scores.average.ap50)
    assert scores.counts == Counts(0, len(found), 0)
    assert scores.verdict is Verdict.BAD
    assert scores.verdict.exit_code == 4
    document = json.dumps(scores_as_json(scores), allow_nan=False)
    assert json.loads(document)["ap50"] is None


def test_labels_without_images_are_refused() -> None:
    with pytest.raises(InputError, match="no image"):
        score_boxes(_set(), _set(_image("a", ("car", _CAR, 0.9))))


def test_precision_recall_and_mistakes_of_one_image() -> None:
    truth = _set(_image("a", ("car", _CAR), ("deer", _FAR), ("cone", (10, 10, 30, 60))))
    found = _set(
        _image(
            "a",
            ("car", _shifted(_CAR, 4), 0.9),  # a hit
            ("car", _shifted(_CAR, -4), 0.8),  # a second box on it
            ("car", _FAR, 0.7),  # the deer, misnamed
            ("cone", _shifted((10, 10, 30, 60), 12), 0.6),  # badly placed: IoU 0.25
            ("car", _EMPTY, 0.5),  # nothing
            ("car", _EMPTY, 0.1),  # below the threshold
        )
    )
    scores = score_boxes(truth, found)
    assert scores.counts == Counts(3, 5, 1)
    assert scores.counts.f1 == pytest.approx(2 / 8)
    assert scores.confusions == (("deer", "car", 1),)
    assert scores.mistakes == {
        "second box on an object": 1,
        "object of another class": 1,
        "object, but badly placed": 1,
        "nothing that is labelled": 1,
    }
    (worst,) = scores.worst
    assert (worst.objects, worst.missed, worst.false) == (3, 2, 4)


def test_an_object_is_taken_for_one_other_only() -> None:
    truth = _set(_image("a", ("deer", _FAR), ("car", _CAR)))
    found = _set(_image("a", ("car", _FAR, 0.9), ("car", _FAR, 0.8)))
    scores = score_boxes(truth, found)
    assert scores.confusions == (("deer", "car", 1),)
    assert scores.mistakes == {"object of another class": 1, "nothing that is labelled": 1}


@pytest.mark.parametrize(("images", "verdict"), [(99, Verdict.DOUBTFUL), (100, Verdict.GOOD)])
def test_a_hundred_objects_make_figures_firm(images: int, verdict: Verdict) -> None:
    truth = _set(*(_image(f"{k}", ("car", _CAR)) for k in range(images)))
    found = _set(*(_image(f"{k}", ("car", _CAR, 0.5 + k / 1000)) for k in range(images)))
    assert score_boxes(truth, found).verdict is verdict


def test_a_threshold_that_nothing_reaches_is_noted() -> None:
    truth = _set(_image("a", ("car", _CAR)))
    scores = score_boxes(truth, _set(_image("a", ("car", _CAR, 0.2))))
    assert scores.counts == Counts(1, 0, 0)
    assert any("no detection has a confidence of 0.25" in note for note in scores.notes)


def test_the_best_threshold_is_where_f1_is_highest() -> None:
    truth = _set(*(_image(f"{k}", ("car", _CAR)) for k in range(4)))
    found = _set(
        _image("0", ("car", _CAR, 0.9)),
        _image("1", ("car", _CAR, 0.8)),
        _image("2", ("car", _CAR, 0.6), ("car", _EMPTY, 0.7)),
        _image("3", ("car", _EMPTY, 0.5)),
    )
    (car,) = score_boxes(truth, found).classes
    # 0.9: 2/5; 0.8: 4/6; 0.7: 4/7; 0.6: 6/8; 0.5: 6/9
    assert (car.best_score, car.best_f1) == (0.6, 0.75)


def test_equal_confidences_are_one_threshold() -> None:
    truth = _set(_image("0", ("car", _CAR)), _image("1"))
    found = _set(_image("0", ("car", _CAR, 0.5)), _image("1", ("car", _CAR, 0.5)))
    (car,) = score_boxes(truth, found).classes
    assert car.best_f1 == pytest.approx(2 / 3)  # not 1, which no threshold gives


def test_bands_of_size_height_and_distance() -> None:
    truth = _set(_image("a", ("car", _CAR), ("car", _FAR), range_m=[8.0, 42.0]))
    found = _set(_image("a", ("car", _CAR, 0.9), ("car", _EMPTY, 0.8), range_m=[8.5, 20.0]))
    scores = score_boxes(truth, found)
    assert {band: n for band, (_, n) in scores.by_size.items()} == {
        "small": Counts(1, 0, 0), "medium": Counts(1, 2, 1),
    }  # fmt: skip
    assert scores.by_height == {
        "10-25 px": Counts(1, 0, 0), "25-40 px": Counts(0, 1, 0), "40-80 px": Counts(1, 1, 1),
    }  # fmt: skip
    assert scores.by_range == {
        "0-15 m": Counts(1, 1, 1), "15-30 m": Counts(0, 1, 0), "30-50 m": Counts(1, 0, 0),
    }  # fmt: skip


def test_precision_by_distance_is_unknown_where_no_detection_has_one() -> None:
    truth = _set(_image("a", ("car", _CAR), range_m=[8.0]))
    scores = score_boxes(truth, _set(_image("a", ("car", _CAR, 0.9), ("car", _EMPTY, 0.8))))
    assert scores.by_range == {"0-15 m": Counts(1, None, 1), "unknown": Counts(0, 1, 0)}
    assert math.isnan(scores.by_range["0-15 m"].precision)
    assert scores.by_range["0-15 m"].recall == 1


def test_a_region_of_any_class_swallows_detections_of_each() -> None:
    region = (290.0, 90.0, 700.0, 400.0)
    truth = _image("a", ("car", _CAR), ("deer", _CAR), (ANY_LABEL, region),
                   ignore=[False, False, True])  # fmt: skip
    found = _image("a", ("car", _CAR, 0.9), ("car", _FAR, 0.8), ("deer", _EMPTY, 0.7))
    scores = score_boxes(_set(truth), _set(found))
    assert scores.counts == Counts(2, 1, 1)
    assert sum(scores.dropped.values()) == 2
    assert ANY_LABEL not in [one.label for one in scores.classes]


def test_low_objects_count_for_nothing_and_neither_do_detections_on_them() -> None:
    truth = _set(_image("a", ("car", _CAR), ("car", _FAR)))
    invented = (500.0, 300.0, 520.0, 310.0)
    found = _set(_image("a", ("car", _CAR, 0.9), ("car", _FAR, 0.8), ("car", invented, 0.95)))
    assert score_boxes(truth, found).counts == Counts(2, 3, 2)
    scores = score_boxes(truth, found, BoxScoreConfig(min_height_px=25))
    assert scores.counts == Counts(1, 1, 1)
    assert scores.average.ap == pytest.approx(1)
    assert scores.dropped == {
        "objects lower or less visible than what counts": 1,
        "detections in ignored regions or on objects that do not count": 2,
    }


def test_a_low_detection_on_a_tall_enough_object_counts() -> None:
    truth = _set(_image("a", ("car", (0.0, 0.0, 40.0, 30.0))))
    found = _set(_image("a", ("car", (0.0, 0.0, 40.0, 24.0), 0.9)))
    scores = score_boxes(truth, found, BoxScoreConfig(min_height_px=25))
    assert scores.counts == Counts(1, 1, 1)


def test_hidden_objects_do_not_count_where_it_is_known() -> None:
    truth = _set(_image("a", ("car", _CAR), ("car", _FAR), ("car", _EMPTY),
                        visible=[0.2, 0.9, math.nan]))  # fmt: skip
    scores = score_boxes(truth, _set(complete=False), BoxScoreConfig(min_visible=0.3))
    assert scores.counts.objects == 2


def test_classes_of_one_side_are_named() -> None:
    truth = _set(_image("a", ("car", _CAR), ("deer", _FAR)))
    found = _set(_image("a", ("car", _CAR, 0.9), ("Deer", _FAR, 0.8), ("kite", _EMPTY, 0.7)))
    scores = score_boxes(truth, found)
    assert scores.average.ap50 == pytest.approx(0.5)  # the deer are in the mean
    assert scores.counts == Counts(2, 1, 1)  # the kite is not
    assert scores.dropped == {"detections of classes that the labels do not have": 2}
    (missing,) = [reason for reason in scores.why if "not one detection" in reason]
    assert "of deer (1), whose AP of 0 is in the mean; without them AP50 is 1.000" in missing
    assert "--map deer=Deer" in missing
    (foreign,) = [note for note in scores.notes if "count for nothing" in note]
    assert "Deer (1), kite (1)" in foreign
    mapped = score_boxes(truth, found, BoxScoreConfig(label_map={"Deer": "deer"}))
    assert mapped.average.ap50 == pytest.approx(1)


def test_classes_of_which_no_object_counts_are_not_said_to_be_missed() -> None:
    truth = _set(_image("a", ("car", _CAR), ("deer", _FAR)))
    found = _set(_image("a", ("car", _CAR, 0.9)))
    scores = score_boxes(truth, found, BoxScoreConfig(min_height_px=25))
    assert scores.average.ap50 == pytest.approx(1)
    assert not any("not one detection" in reason for reason in scores.why)


def test_no_class_in_common_is_refused_with_the_map_to_pass() -> None:
    truth = _set(_image("a", ("Car", _CAR)))
    with pytest.raises(InputError, match="--map Car=car"):
        score_boxes(truth, _set(_image("a", ("car", _CAR, 0.9))))


def test_a_map_of_an_unknown_class_is_refused() -> None:
    sides = _set(_image("a", ("car", _CAR))), _set(_image("a", ("car", _CAR, 0.9)))
    with pytest.raises(UsageError, match="Did you mean 'car'"):
        score_boxes(*sides, BoxScoreConfig(label_map={"cra": "vehicle"}))


def test_images_meet_by_their_whole_names_or_by_the_last_parts() -> None:
    truth = _set(_image("val/000001.png", ("car", _CAR)), _image("val/000002.png"))
    for name in ("val/000001", "val/000001.jpg", "000001", "elsewhere/000001.x.png"):
        found = _set(_image(name, ("car", _CAR, 0.9)))
        if name.endswith(".x.png"):
            with pytest.raises(InputError, match="no image of the detections"):
                score_boxes(truth, found)
        else:
            scores = score_boxes(truth, found)
            assert scores.counts.hits == 1
            assert any("last parts" in note for note in scores.notes) == (name == "000001")


def test_last_parts_that_are_not_unique_do_not_meet() -> None:
    truth = _set(_image("front/1", ("car", _CAR)), _image("left/1"))
    with pytest.raises(InputError, match="no image of the detections"):
        score_boxes(truth, _set(_image("1", ("car", _CAR, 0.9))))


def test_images_of_one_side_are_counted() -> None:
    truth = _set(_image("a", ("car", _CAR)), _image("b", ("car", _CAR)))
    found = _image("a", ("car", _CAR, 0.9)), _image("c", ("car", _CAR, 0.9))
    looked_at_all = score_boxes(truth, _set(*found))
    assert (looked_at_all.images, looked_at_all.counts) == (1, Counts(1, 1, 1))
    assert looked_at_all.dropped == {
        "labelled images that the detector did not look at": 1,
        "detections in images without labels": 1,
        "images with detections and without labels": 1,
    }
    assert any("did not look at" in reason for reason in looked_at_all.why)
    some = score_boxes(truth, _set(*found, complete=False))
    assert (some.images, some.counts) == (2, Counts(2, 1, 1))
    only_with_objects = score_boxes(_set(*truth.images, complete=False), _set(*found))
    assert only_with_objects.counts == Counts(1, 1, 1)  # c may be an image that nobody labelled
    assert any("do not list images without objects" in note for note in only_with_objects.notes)


def test_detections_without_confidences_are_said_to_be_unranked() -> None:
    truth = _set(_image("a", ("car", _CAR)))
    scores = score_boxes(truth, _set(_image("a", ("car", _CAR))))
    assert scores.average.ap50 == pytest.approx(1)
    assert any("no confidences" in note for note in scores.notes)
    assert any("confidences are equal" in reason for reason in scores.why)


def test_what_a_reader_dropped_makes_the_figures_doubtful() -> None:
    images = [_image(f"{k}", ("car", _CAR)) for k in range(150)]
    found = [_image(f"{k}", ("car", _CAR, 0.5 + k / 1000)) for k in range(150)]
    assert score_boxes(_set(*images), _set(*found)).verdict is Verdict.GOOD
    lossy = LabelSet(tuple(found), dropped={"boxes that are not finite": 3})
    scores = score_boxes(_set(*images), lossy)
    assert scores.verdict is Verdict.DOUBTFUL
    assert scores.dropped == {"boxes that are not finite (detections)": 3}


def test_more_than_a_hundred_of_a_class_in_an_image_are_counted() -> None:
    boxes = [("car", _shifted(_EMPTY, k), 0.3 + k / 1000) for k in range(130)]
    scores = score_boxes(_set(_image("a", ("car", _CAR))), _set(_image("a", *boxes)))
    assert scores.counts.detections == 100
    assert scores.dropped == {"detections beyond the 100 best of a class in an image": 30}


def test_the_interval_holds_the_truth_of_many_draws() -> None:
    """A detector that finds 70 % of one object an image has an AP50 near 0.7."""
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(20):
        lucky = rng.random(100) < 0.7
        truth = _set(*(_image(f"{k}", ("car", _CAR)) for k in range(100)))
        found = _set(
            *(_image(f"{k}", ("car", _CAR, 0.5)) for k in np.flatnonzero(lucky)), complete=False
        )
        low, high = score_boxes(truth, found).ap50_interval
        held += low <= 0.7 <= high
        assert 0.05 < high - low < 0.3
    assert 14 <= held <= 20  # 18 are expected


def test_few_images_have_no_interval() -> None:
    scores = score_boxes(_set(_image("a", ("car", _CAR))), _set(_image("a", ("car", _CAR, 0.9))))
    assert all(map(math.isnan, scores.ap50_interval))


@pytest.mark.parametrize(
    ("boxes", "labels", "message"),
    [
        ([[0, 0, 1]], ["a"], "labels need"),
        ([[0, 0, 1, 1]], ["a", "b"], "labels need"),
        ([[0, 0, math.nan, 1]], ["a"], "not finite"),
        ([[5, 0, 1, 1]], ["a"], "inside out"),
    ],
)
def test_a_labelled_image_checks_its_boxes(
    boxes: list[list[float]], labels: list[str], message: str
) -> None:
    with pytest.raises((GeometryError, ValueError), match=f"{message}|reshape"):
        LabelledImage.of("a", boxes, labels)


_GRID = [(k // 6 * 200.0 + 20, k % 6 * 100.0 + 30) for k in range(36)]


def _written(
    read: Callable[[float, float, float, float], tuple[float, ...]],
    *,
    size: tuple[int, int] | None = (1280, 720),
    scored: bool = True,
) -> LabelSet:
    """Return boxes in 36 images as a file has them that was written in one way and read as xywh."""
    images = []
    for k, (x, y) in enumerate(_GRID * 3):
        x1, y1, width, height = read(x, y, x + 60, y + 40)
        box = ("car", (x1, y1, x1 + width, y1 + height), 0.5 + k / 1000)
        images.append(_image(f"{k}", box[: 2 + scored], image_size=size))
    return _set(*images)


def _xywh(x1: float, y1: float, x2: float, y2: float) -> tuple[float, ...]:
    return (x1, y1, x2 - x1, y2 - y1)


def _xyxy(*corners: float) -> tuple[float, ...]:
    return corners


def _centre(x1: float, y1: float, x2: float, y2: float) -> tuple[float, ...]:
    return ((x1 + x2) / 2, (y1 + y2) / 2, x2 - x1, y2 - y1)


def _shares(*corners: float) -> tuple[float, ...]:
    return tuple(value / 1280 for value in _xywh(*corners))


@pytest.mark.parametrize(
    ("labels", "detections", "size", "doubt"),
    [
        (_xywh, _xywh, (1280, 720), None),
        (_xywh, _xywh, None, None),
        (_xyxy, _xyxy, (1280, 720), "labels: 60 of 108 boxes reach beyond their image"),
        (_xywh, _xyxy, (1280, 720), "detections: 60 of 108 boxes reach beyond their image"),
        (_xyxy, _xyxy, None, "labels: sizes of boxes are like corners"),
        (_shares, _shares, (1280, 720), "labels: all boxes are within 2 pixels"),
        (_xywh, _shares, None, "detections: all boxes are within 2 pixels"),
        (_xywh, _centre, None, "of 108 detections 0 lie on an object"),
    ],
)
def test_boxes_that_are_written_in_another_way_make_the_figures_doubtful(
    labels: Callable[..., tuple[float, ...]],
    detections: Callable[..., tuple[float, ...]],
    size: tuple[int, int] | None,
    doubt: str | None,
) -> None:
    truth = _written(labels, size=size, scored=False)
    scores = score_boxes(truth, _written(detections, size=size))
    assert scores.verdict is (Verdict.GOOD if doubt is None else Verdict.DOUBTFUL)
    assert doubt is None or any(reason.startswith(doubt) for reason in scores.why), scores.why


def test_classes_that_are_numbered_differently_make_the_figures_doubtful() -> None:
    names = ("bicycle", "car", "bus")
    truth = [_image(f"{k}", (names[k % 2], _CAR)) for k in range(120)]
    found = [_image(f"{k}", (names[k % 2 + 1], _CAR, 0.3 + k / 1000)) for k in range(120)]
    scores = score_boxes(_set(*truth), _set(*found))
    assert scores.verdict is Verdict.DOUBTFUL
    assert any(reason.startswith("of the objects 60 are taken for") for reason in scores.why)


def test_labels_with_confidences_may_be_detections() -> None:
    scores = score_boxes(_written(_xywh), _written(_xywh))
    assert scores.why == ("the labels have confidences: are they detections?",)


def test_images_of_other_folders_and_images_without_a_detection_are_doubted() -> None:
    truth = [_image(f"drive1/{k}", ("car", _CAR)) for k in range(120)]
    for folder, seen, doubt in (
        ("drive1/", 120, None),
        ("", 120, None),
        ("drive2/", 120, "from folders of other names (120), such as 'drive1/0' with 'drive2/0'"),
        ("drive1/", 90, "30 of 120 images with objects have no detection"),
        ("drive1/", 97, None),
    ):
        found = [_image(f"{folder}{k}", ("car", _CAR, 0.3 + k / 1000)) for k in range(seen)]
        scores = score_boxes(_set(*truth), _set(*found, complete=False))
        assert scores.verdict is (Verdict.GOOD if doubt is None else Verdict.DOUBTFUL)
        assert doubt is None or any(doubt in reason for reason in scores.why), scores.why


def test_detections_with_regions_are_labels() -> None:
    truth = _set(_image("a", ("car", _CAR)))
    with pytest.raises(InputError, match="regions to ignore"):
        score_boxes(truth, _set(_image("a", (ANY_LABEL, _CAR), ignore=[True])))
