"""Who should have found an object and did not."""

from __future__ import annotations

import numpy as np
import pytest
from made_prelabels import AHEAD, CAR_M, CAR_PX, net, solids, view

from percept.core.results import Detections2D
from percept.datasets.labelling.labelled_set import SolidBoxes
from percept.datasets.labelling.prelabels.categories import CategoryConfig
from percept.datasets.labelling.prelabels.label_keyframe import PreLabelConfig
from percept.datasets.labelling.prelabels.view_evidence import Vocabulary, evidence_of_views

_KNOWN = Vocabulary.of(
    {"a": ["Car", "person", "light_red"], "b": ["person", "car"]}, ["car"], CategoryConfig()
)
_LEFT = (0.0, 0.0, 20.0, 40.0)


def disagreement(found: SolidBoxes, **networks: Detections2D) -> float:
    return evidence_of_views(
        1, [view(camera=AHEAD, **networks)], found, _KNOWN, PreLabelConfig()
    ).disagreement


def test_all_agree() -> None:
    both = {"a": net(("car", 0.9, CAR_PX)), "b": net(("car", 0.8, CAR_PX))}
    assert disagreement(solids(("car", 0.9, CAR_M)), **both) == 0.0


def test_unsure_box_is_no_disagreement() -> None:
    both = {"a": net(("car", 0.9, CAR_PX)), "b": net(("car", 0.1, CAR_PX))}
    assert disagreement(SolidBoxes.none(), **both) == 0.0


@pytest.mark.parametrize(("label", "share"), [("person", 1.0), ("traffic light red", 0.0)])
def test_network_is_asked_for_what_it_knows(label: str, share: float) -> None:
    both = {"a": net((label, 0.9, _LEFT)), "b": net()}
    assert disagreement(SolidBoxes.none(), **both) == share


def test_lidar_is_asked_for_what_it_knows_and_can_see() -> None:
    elsewhere = solids(("car", 0.9, (15.0, 8.0, 0, 4, 2, 1.5, 0)))
    low = (60.0, 0.0, 80.0, 7.0)
    found = net(("car", 0.9, _LEFT), ("person", 0.9, CAR_PX), ("car", 0.9, low))
    # One car of three 2D boxes, and the car that no network saw.
    assert disagreement(elsewhere, b=found) == pytest.approx(2 / 4)
    assert disagreement(SolidBoxes.none(), b=found) == 0.0


def test_all_objects_are_named_once() -> None:
    behind = (-20.0, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0)
    one = evidence_of_views(
        5,
        [view(a=net(("car", 0.9, CAR_PX), ("person", 0.4, _LEFT)))],
        solids(("car", 0.8, CAR_M), ("car", 0.7, behind), ("unknown", 1.0, behind)),
        _KNOWN,
        PreLabelConfig(),
    )
    assert (one.stamp_ns, one.labels) == (5, ("car", "pedestrian", "car"))
    assert one.confidences == pytest.approx([0.9, 0.4, 0.7])


def test_nothing_there() -> None:
    one = evidence_of_views(5, [], SolidBoxes.none(), _KNOWN, PreLabelConfig())
    assert (one.labels, one.disagreement) == ((), 0.0)
    assert one.confidences.dtype == np.float64
