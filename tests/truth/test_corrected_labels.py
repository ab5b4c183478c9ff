"""A script plays the labeller in every format: exactly what it changed comes back."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_labelled_set import CATEGORIES, make_labelled_set
from played_labeller import LABELLERS, KittiLabeller, Labeller, VideoLabeller

from percept.core.errors import InputError
from percept.datasets.labelling.corrections.compare import SetDiff, compare_sets
from percept.datasets.labelling.corrections.corrected import corrected_format, read_corrected
from percept.datasets.labelling.corrections.diff_figures import Change
from percept.datasets.labelling.formats import ExportFormat, export
from percept.datasets.labelling.labelled_set import LabelledFrame, LabelledSet
from percept.datasets.labelling.set_tables import read_set, write_set

_CAR, _PEDESTRIAN, _SIGN = CATEGORIES
_NEW = (200.0, 50.0, 240.0, 90.0)
_ALL = tuple(LABELLERS)
_EXPORTS: tuple[ExportFormat, ...] = ("coco", "yolo", "kitti", "cvat", "label-studio")


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    """A set in all formats that are read back; tests write copies of what they change."""
    labelled = make_labelled_set(tmp_path_factory.mktemp("set") / "made")
    for name in _EXPORTS:
        export(labelled, name, labelled.folder / name)
    return labelled


@pytest.fixture
def copied(exported: LabelledSet, tmp_path: Path) -> LabelledSet:
    """The same, that a test may change."""
    folder = tmp_path / "copy"
    shutil.copytree(exported.folder, folder)
    return replace(exported, folder=folder)


def _frame(labelled: LabelledSet, number: int) -> LabelledFrame:
    return next(frame for _, frame in labelled.frames() if frame.frame == number)


def _play(labeller: Labeller, labelled: LabelledSet) -> Path:
    """Move a box of image 0, relabel one of 1, delete one of 2, and add one to 3."""
    labeller.move(_frame(labelled, 0), 0, 6.0, 4.0)
    labeller.relabel(_frame(labelled, 1), 0, _PEDESTRIAN)
    labeller.delete(_frame(labelled, 2), 1)
    labeller.add(_frame(labelled, 3), _NEW, _CAR)
    return labeller.save()


def _changes(diff: SetDiff) -> set[tuple[int, Change, int | None]]:
    """Return what changed: image, what happened, and the number of the box before."""
    return {
        (
            image.a.frame,
            change.change,
            None if change.row_a is None else int(image.a.boxes.ids[change.row_a]),
        )
        for image in diff.images
        for change in image.changes
        if change.change is not Change.UNCHANGED
    }


_PLANTED = {(0, Change.MOVED, 1), (1, Change.RELABELLED, 4), (2, Change.REMOVED, 8)}


@pytest.mark.parametrize("name", _ALL)
def test_planted_corrections_come_back(
    name: ExportFormat, copied: LabelledSet, tmp_path: Path
) -> None:
    path = _play(LABELLERS[name](copied.folder / name, copied), copied)
    assert corrected_format(path) == name
    corrected = read_corrected(path, corrected_format(path), copied)
    back = replace(corrected.labelled, folder=tmp_path)
    write_set(back)
    diff = compare_sets(read_set(copied.folder), read_set(tmp_path))
    assert _changes(diff) == {*_PLANTED, (3, Change.ADDED, None)}
    assert not diff.dropped
    assert len(diff.images) == 12
    assert diff.total.counts[Change.UNCHANGED] == 30 - 3
    assert diff.total.right == 27 + 1  # the moved box overlaps by 0.68
    assert 0.66 < diff.images[0].changes[0].iou < 0.7


@pytest.mark.parametrize("name", _ALL)
def test_boxes_keep_their_places_tracks_and_links(name: ExportFormat, copied: LabelledSet) -> None:
    path = _play(LABELLERS[name](copied.folder / name, copied), copied)
    corrected = read_corrected(path, corrected_format(path), copied).labelled
    tolerance = 0.3 if name == "kitti" else 0.011  # a lens lies between, and two decimals
    moved, relabelled = _frame(corrected, 0).boxes, _frame(corrected, 1).boxes
    before = _frame(copied, 0).boxes
    np.testing.assert_allclose(moved.boxes_px[0], before.boxes_px[0] + [6, 4, 6, 4], atol=tolerance)
    assert (moved.track_ids[0], moved.solids[0], moved.sources[0]) == (7, 1, "")
    assert np.isnan(moved.confidences[0])
    np.testing.assert_array_equal(moved.boxes_px[1:], before.boxes_px[1:])
    assert (moved.sources[1], moved.confidences[1]) == ("lidar", 0.4)
    assert (relabelled.labels[0], relabelled.ids[0], relabelled.sources[0]) == (_PEDESTRIAN, 4, "")
    added = _frame(corrected, 3).boxes
    np.testing.assert_allclose(added.boxes_px[3], _NEW, atol=3 if name == "kitti" else 0.011)
    assert (added.ids[3], added.track_ids[3], added.solids[3]) == (31, -1, 0)


def test_tracks_of_videos_come_back(copied: LabelledSet) -> None:
    path = _play(VideoLabeller(copied.folder / "cvat", copied), copied)
    assert corrected_format(path) == "cvat"
    corrected = read_corrected(path, "cvat", copied)
    changes = _changes(compare_sets(copied, corrected.labelled))
    # The class of a track is that of all its boxes: that of image 1 goes through images 3 and 5.
    relabelled = {(3, Change.RELABELLED, 10), (2, Change.REMOVED, 8), (3, Change.ADDED, None)}
    assert changes == {(0, Change.MOVED, 1), (1, Change.RELABELLED, 4), *relabelled}
    assert not corrected.dropped
    tracks = {int(t) for _, f in corrected.labelled.frames() for t in f.boxes.track_ids}
    assert tracks == {-1, 7}


@pytest.mark.parametrize("name", _ALL)
def test_what_nobody_touched_is_what_it_was(name: ExportFormat, exported: LabelledSet) -> None:
    path = exported.folder / name
    if name == "label-studio":  # nobody has annotated yet
        return
    corrected = read_corrected(path, corrected_format(path), exported)
    for (ours, before), (theirs, after) in zip(
        exported.frames(), corrected.labelled.frames(), strict=True
    ):
        for column in ("ids", "boxes_px", "confidences", "track_ids", "solids", "occluded"):
            np.testing.assert_array_equal(
                getattr(before.boxes, column), getattr(after.boxes, column)
            )
        assert before.boxes.labels == after.boxes.labels
        assert before.boxes.sources == after.boxes.sources
        np.testing.assert_array_equal(ours.solids.boxes_m, theirs.solids.boxes_m)


def test_solids_of_kitti_come_back(copied: LabelledSet) -> None:
    labeller = LABELLERS["kitti"](copied.folder / "kitti", copied)
    assert isinstance(labeller, KittiLabeller)
    # Both images of the first moment show the pedestrian (row 1); one of them moves it.
    labeller.move_solid(_frame(copied, 0), 1, 0.5, 1.0)
    # The car of the second moment goes from both of its images.
    labeller.delete(_frame(copied, 2), 0)
    labeller.delete(_frame(copied, 3), 0)
    # The pedestrian of the fourth stays in one of two.
    labeller.delete(_frame(copied, 6), 1)
    labeller.relabel(_frame(copied, 6), 0, _PEDESTRIAN)
    labeller.add_solid(_frame(copied, 7), _NEW, _CAR, "1.6 1.9 4.5 2 1.5 20 0.3")
    corrected = read_corrected(labeller.save(), "kitti", copied)
    diff = compare_sets(copied, corrected.labelled)
    changes = {
        (
            moment.a.keyframe,
            one.change,
            None if one.row_a is None else moment.a.solids.ids[one.row_a],
        )
        for moment in diff.moments
        for one in moment.changes
        if one.change is not Change.UNCHANGED
    }
    assert changes == {
        (0, Change.MOVED, 2), (1, Change.REMOVED, 4), (3, Change.RELABELLED, 10),
        (3, Change.ADDED, None),
    }  # fmt: skip
    assert diff.has_solid_changes
    moved = corrected.labelled.keyframes[0].solids
    shift = moved.boxes_m[1, :3] - copied.keyframes[0].solids.boxes_m[1, :3]
    np.testing.assert_allclose(np.linalg.norm(shift), np.hypot(0.5, 1.0), atol=0.02)
    assert moved.sources[1] == ""
    assert moved.points[1] == -1
    # The new one is 20 m before the left camera, which looks 60 deg to the left and 2 deg down.
    new = corrected.labelled.keyframes[3].solids
    bearing = np.degrees(np.arctan2(new.boxes_m[3, 1] - 0.3, new.boxes_m[3, 0] - 1.5))
    np.testing.assert_allclose(bearing, 60 - np.degrees(np.arctan2(2, 20)), atol=0.5)
    np.testing.assert_allclose(new.boxes_m[3, 3:6], [4.5, 1.9, 1.6])
    assert _frame(corrected.labelled, 7).boxes.solids[3] == new.ids[3] == 19
    assert _frame(corrected.labelled, 6).boxes.solids[0] == 10


def test_a_solid_may_have_another_class_than_its_rectangle(tmp_path: Path) -> None:
    labelled = make_labelled_set(tmp_path / "set", drives=1, keyframes=1, cameras=("front", "left"))
    keyframe = labelled.keyframes[0]
    solids = replace(keyframe.solids, labels=(_CAR, _CAR, _CAR))
    labelled = replace(labelled, keyframes=(replace(keyframe, solids=solids),))
    export(labelled, "kitti", tmp_path / "kitti")
    corrected = read_corrected(tmp_path / "kitti", "kitti", labelled)
    assert corrected.labelled.keyframes[0].solids.labels == (_CAR, _CAR, _CAR)


def test_numbers_of_a_tool_that_counts_anew_mean_nothing(copied: LabelledSet) -> None:
    labeller = LABELLERS["coco"](copied.folder / "coco", copied)
    path = _play(labeller, copied)
    for file in (path / "annotations").glob("*.json"):
        document = json.loads(file.read_text())
        for number, annotation in enumerate(reversed(document["annotations"]), 1):
            annotation["id"] = number
        file.write_text(json.dumps(document))
    corrected = read_corrected(path, "coco", copied)
    assert any("numbers of boxes" in note for note in corrected.notes)
    changes = _changes(compare_sets(copied, corrected.labelled))
    assert changes == {*_PLANTED, (3, Change.ADDED, None)}


def test_images_that_did_not_come_back_are_left_out(copied: LabelledSet) -> None:
    for file in (copied.folder / "kitti" / "training" / "label_2").glob("00000[2-9].txt"):
        file.unlink()
    corrected = read_corrected(copied.folder / "kitti", "kitti", copied)
    assert [frame.frame for _, frame in corrected.labelled.frames()] == [0, 1, 10, 11]
    assert corrected.dropped["images of the data set that the labels do not have"] == 8
    diff = compare_sets(copied, corrected.labelled)
    assert diff.dropped == {"images that only A has": 8}
    assert not _changes(diff)


def test_foreign_and_hostile_names_are_counted_named_and_never_opened(
    copied: LabelledSet, tmp_path: Path
) -> None:
    secret = tmp_path / "secret.jpg"
    secret.mkdir()  # whoever opens it fails
    path = copied.folder / "cvat" / "images" / "annotations.xml"
    names = ["../" * 9 + "secret.jpg", str(secret), "other.jpg"]
    images = "".join(f'<image id="9" name="{name}" width="9" height="9"/>' for name in names)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("</annotations>", f"{images}</annotations>"), encoding="utf-8")
    corrected = read_corrected(path, "cvat", copied)
    assert corrected.dropped == {"images that are not in the data set": 3}
    # A note shows the beginning of a long name, such as that of a deep folder.
    assert all(name[:40] in corrected.notes[0] for name in names)


def test_a_coco_name_that_leads_elsewhere_is_named(copied: LabelledSet) -> None:
    path = copied.folder / "coco" / "annotations" / "instances_train.json"
    document = json.loads(path.read_text())
    name = "../../../../etc/passwd"
    document["images"].append({"id": 999, "file_name": name, "width": 3, "height": 3})
    path.write_text(json.dumps(document))
    corrected = read_corrected(path, "coco", copied)
    assert corrected.dropped["images that are not in the data set"] == 1
    assert any(name in note for note in corrected.notes)


def test_labels_of_another_set_are_refused(exported: LabelledSet, tmp_path: Path) -> None:
    other = make_labelled_set(tmp_path / "other", drives=1, keyframes=1, cameras=("back",))
    with pytest.raises(InputError, match="no image of"):
        read_corrected(exported.folder / "coco", "coco", other)


def test_images_of_another_size_are_left_out(copied: LabelledSet) -> None:
    path = copied.folder / "cvat" / "images" / "annotations.xml"
    text = path.read_text(encoding="utf-8").replace('width="320"', 'width="640"', 1)
    path.write_text(text, encoding="utf-8")
    corrected = read_corrected(path, "cvat", copied)
    assert corrected.dropped["images of another size than in the data set"] == 1
    assert len(list(corrected.labelled.frames())) == 11


def test_boxes_end_at_the_edge_of_the_image(copied: LabelledSet) -> None:
    labeller = LABELLERS["cvat"](copied.folder / "cvat", copied)
    labeller.add(_frame(copied, 0), (300.0, 100.0, 350.0, 120.0), _CAR)
    labeller.add(_frame(copied, 0), (330.0, 100.0, 350.0, 120.0), _CAR)
    corrected = read_corrected(labeller.save(), "cvat", copied)
    boxes = _frame(corrected.labelled, 0).boxes
    assert boxes.boxes_px[3:].tolist() == [[300.0, 100.0, 320.0, 120.0]]
    assert corrected.dropped == {
        "boxes cut at the edge of the image": 1,
        "boxes outside of the image": 1,
    }


def test_new_classes_join_the_others(copied: LabelledSet) -> None:
    labeller = LABELLERS["label-studio"](copied.folder / "label-studio", copied)
    labeller.relabel(_frame(copied, 0), 0, "trailer")
    corrected = read_corrected(labeller.save(), "label-studio", copied)
    assert corrected.labelled.categories == (*CATEGORIES, "trailer")
    assert any("trailer" in note for note in corrected.notes)


def _bent(folder: Path, row: int, box_px: tuple[float, float, float, float]) -> LabelledSet:
    """Return a set seen through a strong lens, with another box in its first image."""
    labelled = make_labelled_set(folder, drives=1, keyframes=2, cameras=("front",))
    drive = next(iter(labelled.drives.values()))
    bent = replace(drive.cameras["front"], distortion=(-0.38, 0.12, 0.0, 0.0, 0.0))
    first, second = labelled.keyframes
    frame = first.frames[0]
    boxes_px = frame.boxes.boxes_px.copy()
    boxes_px[row] = box_px
    frame = replace(frame, boxes=replace(frame.boxes, boxes_px=boxes_px))
    return replace(
        labelled,
        drives={drive.name: replace(drive, cameras={"front": bent})},
        keyframes=(replace(first, frames=(frame,)), second),
    )


def test_boxes_that_a_format_does_not_show_stay(tmp_path: Path) -> None:
    corner = (0.0, 0.0, 9.0, 7.0)  # which the lens sees outside of the rectified image
    labelled = _bent(tmp_path / "set", 1, corner)
    export(labelled, "kitti", tmp_path / "kitti")
    label_file = tmp_path / "kitti" / "training" / "label_2" / "000000.txt"
    assert len(label_file.read_text().splitlines()) == 2
    label_file.write_text("")
    corrected = read_corrected(tmp_path / "kitti", "kitti", labelled)
    boxes = _frame(corrected.labelled, 0).boxes
    assert boxes.boxes_px.tolist() == [list(corner)]
    assert (boxes.ids[0], boxes.sources[0], boxes.confidences[0]) == (2, "lidar", 0.4)


def test_sides_that_nobody_moved_stay_though_the_format_cut_them(tmp_path: Path) -> None:
    labelled = _bent(tmp_path / "set", 0, (3.0, 60.0, 80.0, 140.0))
    export(labelled, "kitti", tmp_path / "kitti")
    label_file = tmp_path / "kitti" / "training" / "label_2" / "000000.txt"
    first, *rest = label_file.read_text().splitlines()
    words = first.split()
    assert float(words[4]) == 0  # the left side is outside of the rectified image
    words[6] = str(float(words[6]) + 10)
    label_file.write_text("\n".join([" ".join(words), *rest]))
    corrected = read_corrected(tmp_path / "kitti", "kitti", labelled)
    x1, y1, x2, y2 = _frame(corrected.labelled, 0).boxes.boxes_px[0]
    assert (x1, y1, y2) == (3.0, 60.0, 140.0)
    assert 85 < x2 < 90
