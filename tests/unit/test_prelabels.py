"""Pre-labels of a keyframe: networks joined, 3D boxes linked, what was missed added."""

from __future__ import annotations

import numpy as np
import pytest
from made_prelabels import AHEAD, CAR_M, CAR_PX, net, solids, view

from percept.core.transform import Transform
from percept.datasets.labelling.labelled_set import ImageBoxes, SolidBoxes
from percept.datasets.labelling.prelabels.categories import CategoryConfig
from percept.datasets.labelling.prelabels.config import SolidThresholds
from percept.datasets.labelling.prelabels.label_keyframe import (
    ImageView,
    LinkConfig,
    PreLabelConfig,
    Thresholds,
    label_keyframe,
    link,
)


def rows(boxes: ImageBoxes) -> list[tuple[str, str, int]]:
    return list(zip(boxes.labels, boxes.sources, boxes.solids.tolist(), strict=True))


def test_networks_are_joined_by_name_and_never_by_number() -> None:
    """Both know the same classes in another order: the box of one object is one box."""
    pedestrian = (20.0, 40.0, 30.0, 60.0)
    first = net(("car", 0.9, CAR_PX), ("person", 0.5, pedestrian))
    second = net(("pedestrian", 0.8, pedestrian), ("car", 0.6, CAR_PX))
    boxes = link(view(a=first, b=second), SolidBoxes.none(), PreLabelConfig())
    assert rows(boxes) == [("car", "a", 0), ("pedestrian", "b", 0)]
    swapped = link(view(b=second, a=first), SolidBoxes.none(), PreLabelConfig())
    assert sorted(rows(swapped)) == sorted(rows(boxes))


def test_boxes_of_one_network_do_not_compete() -> None:
    boxes = link(
        view(a=net(("car", 0.9, CAR_PX), ("car", 0.8, CAR_PX))), SolidBoxes.none(), PreLabelConfig()
    )
    assert len(boxes) == 2


def test_other_kind_is_another_object_unless_it_is_the_same_box() -> None:
    rider = (92.0, 45.0, 108.0, 52.0)
    apart = link(
        view(a=net(("bicycle", 0.9, CAR_PX)), b=net(("person", 0.8, rider))),
        SolidBoxes.none(),
        PreLabelConfig(),
    )
    assert apart.labels == ("bicycle", "pedestrian")
    same = link(
        view(a=net(("car", 0.7, CAR_PX)), b=net(("truck", 0.8, CAR_PX))),
        SolidBoxes.none(),
        PreLabelConfig(),
    )
    assert rows(same) == [("truck", "b", 0)]


def test_threshold_of_each_class() -> None:
    config = PreLabelConfig(images=Thresholds(least=0.5, classes={"cone": 0.1}))
    found = net(("car", 0.4, CAR_PX), ("traffic cone", 0.2, (0, 0, 20, 20)), ("car", 0.5, CAR_PX))
    made = label_keyframe([view(a=found)], SolidBoxes.none(), config)
    assert made.images[0].labels == ("cone", "car")
    assert made.dropped == {"2D boxes below the threshold of their class": 1}


def test_boxes_end_at_the_border_and_slivers_are_counted() -> None:
    found = net(("car", 0.9, (-10, 50, 20, 120)), ("car", 0.9, (0, 0, 7, 7)))
    made = label_keyframe([view(a=found)], SolidBoxes.none(), PreLabelConfig())
    assert made.images[0].boxes_px.tolist() == [[0, 50, 20, 100]]
    assert made.dropped == {"2D boxes that are too small": 1}


def test_linked_box_knows_its_object() -> None:
    made = label_keyframe(
        [view(a=net(("van", 0.9, CAR_PX)))],
        solids(("car", 0.8, CAR_M)),
        PreLabelConfig(),
        first_box=7,
        first_solid=30,
    )
    (boxes,) = made.images
    assert rows(boxes) == [("van", "a", 30)]
    assert (boxes.ids.tolist(), boxes.track_ids.tolist()) == ([7], [100])
    assert (boxes.truncated[0], boxes.occluded[0]) == (0.0, 0.0)
    assert made.solids.ids.tolist() == [30]
    assert made.solids.labels == ("car",)


def test_unlinked_box_knows_nothing_of_an_object() -> None:
    boxes = link(view(a=net(("car", 0.9, (0, 0, 20, 20)))), SolidBoxes.none(), PreLabelConfig())
    assert (boxes.track_ids.tolist(), boxes.solids.tolist()) == ([-1], [0])
    assert np.isnan([boxes.truncated[0], boxes.occluded[0]]).all()


def test_object_that_no_network_saw_is_projected() -> None:
    boxes = link(view(a=net()), solids(("car", 0.8, CAR_M)), PreLabelConfig())
    assert rows(boxes) == [("car", "lidar", 1)]
    assert boxes.boxes_px[0] == pytest.approx(CAR_PX)
    assert boxes.confidences.tolist() == [0.8]


def test_part_of_an_object_makes_no_second_box() -> None:
    part = (11.0, 0.5, 0.2, 2.0, 0.9, 0.5, 0.0)
    made = label_keyframe(
        [view(a=net(("car", 0.9, CAR_PX)))],
        solids(("car", 0.8, CAR_M), ("truck", 0.9, part), ("car", 0.8, part)),
        PreLabelConfig(linking=LinkConfig(least_px=2)),
    )
    # The truck within the car is of another kind: a person decides.
    assert rows(made.images[0]) == [("car", "a", 1), ("truck", "lidar", 2)]
    assert made.dropped["3D boxes of an object that a 2D box shows already"] == 1


def test_unknown_object_takes_the_class_that_an_image_says() -> None:
    far = (50.0, 20.0, 0.0, 2.0, 2.0, 1.0, 0.0)
    made = label_keyframe(
        [view(a=net(("bus", 0.9, CAR_PX)))],
        solids(("unknown", 1.0, far), ("unknown", 1.0, CAR_M)),
        PreLabelConfig(),
        first_solid=5,
    )
    assert made.solids.labels == ("bus",)
    assert made.solids.track_ids.tolist() == [101]
    assert rows(made.images[0]) == [("bus", "a", 5)]
    assert made.dropped == {"3D boxes of unknown class that no image names": 1}


def test_nearer_of_two_objects_behind_each_other_is_the_one_that_is_seen() -> None:
    behind = (22.0, 0.0, 0.0, 4.0, 4.0, 2.0, 0.0)  # its picture is the same
    for order in (
        (("car", 0.8, behind), ("car", 0.8, CAR_M)),
        (("car", 0.8, CAR_M), ("car", 0.8, behind)),
    ):
        boxes = link(view(a=net(("car", 0.9, CAR_PX))), solids(*order), PreLabelConfig())
        assert len(boxes) == 1
        assert order[int(boxes.solids[0]) - 1][2] == CAR_M


def test_each_object_is_linked_once() -> None:
    shifted = (92.0, 45.0, 112.0, 55.0)
    boxes = link(
        view(a=net(("car", 0.9, shifted), ("car", 0.8, CAR_PX))),
        solids(("car", 0.8, CAR_M)),
        PreLabelConfig(),
    )
    assert rows(boxes) == [("car", "a", 0), ("car", "a", 1)]


def test_other_kind_needs_more_overlap() -> None:
    wide = (90.0, 45.0, 118.0, 55.0)  # IoU 0.71
    assert link(
        view(a=net(("cone", 0.9, wide))), solids(("car", 0.8, CAR_M)), PreLabelConfig()
    ).solids.tolist() == [1]
    wider = (90.0, 45.0, 130.0, 55.0)  # IoU 0.5
    assert rows(
        link(view(a=net(("cone", 0.9, wider))), solids(("car", 0.8, CAR_M)), PreLabelConfig())
    ) == [("cone", "a", 0), ("car", "lidar", 1)]


def test_objects_and_vehicle_move_until_the_image_is_taken() -> None:
    """0.1 s later an object at 20 m/s is 2 m to the left, 20 px, and the vehicle 1 m nearer."""
    T_then_before = Transform("base", "base", np.eye(4) - np.eye(4, k=3))
    moved = ImageView(
        found={"a": net()}, image_size=(200, 100), camera=AHEAD, offset_ns=100_000_000,
        vehicle_place=T_then_before,
    )  # fmt: skip
    boxes = link(moved, solids(("car", 0.8, CAR_M), speed=20.0), PreLabelConfig())
    near_face = 9.0
    assert boxes.boxes_px[0, 0] == pytest.approx(100 - 100 * 3 / near_face)
    assert boxes.boxes_px[0, 1] == pytest.approx(50 - 100 * 0.5 / near_face)


@pytest.mark.parametrize(("offset_ms", "linked"), [(19, True), (21, False)])
def test_image_of_another_time_is_not_linked_where_the_motion_is_not_known(
    offset_ms: int, *, linked: bool
) -> None:
    later = ImageView(
        found={"a": net(("car", 0.9, CAR_PX))}, image_size=(200, 100), camera=AHEAD,
        offset_ns=offset_ms * 1_000_000,
    )  # fmt: skip
    made = label_keyframe([later], solids(("car", 0.8, CAR_M)), PreLabelConfig())
    assert (made.images[0].solids[0] > 0) == linked
    assert ("images that cannot be linked with 3D boxes" in made.dropped) != linked


def test_camera_of_unknown_lens_has_the_boxes_of_its_networks() -> None:
    one = view(camera=None, a=net(("car", 0.9, CAR_PX)))
    made = label_keyframe([one], solids(("car", 0.8, CAR_M)), PreLabelConfig())
    assert rows(made.images[0]) == [("car", "a", 0)]
    assert made.dropped == {"images that cannot be linked with 3D boxes": 1}
    assert len(made.solids) == 1


def test_numbers_go_on_from_image_to_image() -> None:
    one = view(a=net(("car", 0.9, CAR_PX), ("cone", 0.9, (0, 0, 20, 20))))
    made = label_keyframe(
        [one, view(a=net()), one], SolidBoxes.none(), PreLabelConfig(), first_box=4
    )
    assert [boxes.ids.tolist() for boxes in made.images] == [[4, 5], [], [6, 7]]


def test_a_file_that_names_one_class_leaves_the_least_of_the_others() -> None:
    config = PreLabelConfig.model_validate({"solids": {"classes": {"cone": 0.7}}})
    assert (config.solids.of("cone"), config.solids.of("car")) == (0.7, 0.5)


def test_solids_below_their_threshold_and_left_out_classes_are_counted() -> None:
    config = PreLabelConfig(
        solids=SolidThresholds(classes={"deer": 0.9}),
        categories=CategoryConfig(names={"cone": ""}),
    )
    found = solids(("deer", 0.8, CAR_M), ("cone", 0.9, CAR_M), ("car", 0.6, CAR_M))
    made = label_keyframe([], found, config)
    assert made.solids.labels == ("car",)
    assert made.dropped == {
        "3D boxes below the threshold of their class": 1,
        "3D boxes of classes that are left out": 1,
    }
