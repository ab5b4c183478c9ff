"""Points of a scan in 3D boxes."""

from __future__ import annotations

import numpy as np

from percept.datasets.labelling.prelabels.solid_points import points_in_boxes


def test_points_are_counted_as_by_their_place_in_each_box() -> None:
    rng = np.random.default_rng(7)
    points = rng.uniform(-10, 10, (4000, 3)).astype(np.float32)
    boxes = np.column_stack(
        [rng.uniform(-6, 6, (12, 3)), rng.uniform(0.5, 8, (12, 3)), rng.uniform(-3.1, 3.1, 12)]
    )
    expected = []
    for x, y, z, *size, yaw in boxes.tolist():
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        local = (points - [x, y, z]) @ turn
        expected.append(int((np.abs(local) <= np.array(size) / 2).all(axis=1).sum()))
    assert points_in_boxes(points, boxes).tolist() == expected
    assert sum(expected) > 500


def test_neither_points_nor_boxes() -> None:
    box = np.array([[0, 0, 0, 1.0, 1, 1, 0]])
    assert points_in_boxes(np.zeros((0, 3)), box).tolist() == [0]
    assert points_in_boxes(np.zeros((3, 3)), np.zeros((0, 7))).tolist() == []
    assert points_in_boxes(np.array([[0.5, 0.5, 0.5], [0.51, 0, 0]]), box).tolist() == [1]
