"""3D boxes in images: rectangles, what is cut off, what is hidden."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.cameras import Camera, make_camera
from percept.core.transform import Transform
from percept.datasets.labelling.prelabels.project_solids import ProjectedSolids, project_solids

# x of the base forward is z of the camera, y to the left is -x, z up is -y.
_MATRIX = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
_AHEAD = Transform("camera", "base", _MATRIX)
_K = np.array([[100.0, 0, 99.5], [0, 100.0, 49.5], [0, 0, 1]])
_PINHOLE = make_camera("pinhole", (200, 100), _K, [])


def _seen(
    *boxes: list[float],
    camera: Camera = _PINHOLE,
    hiding: NDArray[np.bool_] | None = None,
) -> ProjectedSolids:
    found: NDArray[np.float64] = np.array(boxes, dtype=np.float64).reshape(-1, 7)
    return project_solids(found, _AHEAD, camera, hiding)


def test_rectangle_counts_from_the_edge_of_the_first_pixel() -> None:
    # The near face is at 10 m, 2 m wide and 1 m high: 20 x 10 pixels about the middle.
    seen = _seen([11, 0, 0, 2, 2, 1, 0])
    assert seen.boxes_px[0] == pytest.approx([90, 45, 110, 55])
    assert seen.sizes_px()[0] == pytest.approx([20, 10])
    assert seen.depths_m[0] == pytest.approx(11)
    assert (seen.truncated[0], seen.occluded[0]) == (0.0, 0.0)


def test_lens_bends_edges_between_corners() -> None:
    barrel = make_camera("pinhole", (200, 100), _K, [-0.3])
    straight, bent = (
        _seen([10, 0, 0, 0.1, 16, 8, 0]),
        _seen([10, 0, 0, 0.1, 16, 8, 0], camera=barrel),
    )
    assert bent.boxes_px[0, 0] > straight.boxes_px[0, 0] + 5
    corner = barrel.project(np.array([[8, -4, 9.95]]))[0][0]
    # The upper edge bulges above its ends.
    assert bent.boxes_px[0, 1] < corner[1] + 0.5 - 1


def test_what_leaves_the_image_is_cut_and_counted() -> None:
    half, outside = [20.0, 20.0, 0, 1e-3, 4, 2, 0], [20.0, 30.0, 0, 1e-3, 4, 2, 0]
    seen = _seen(half, outside)
    assert seen.boxes_px[0, [0, 2]] == pytest.approx([0, 10], abs=0.1)
    assert seen.truncated == pytest.approx([0.5, 1.0], abs=0.1)
    assert not seen.boxes_px[1].any()
    assert np.isnan(seen.occluded[1])


def test_box_that_begins_behind_the_camera_reaches_the_border() -> None:
    seen = _seen([0, 3, 0, 10, 2, 2, 0])
    assert seen.boxes_px[0, 0] == 0
    assert seen.boxes_px[0, 2] > 30
    assert 0.3 < seen.truncated[0] < 1


@pytest.mark.parametrize("box", [[-10.0, 0, 0, 4, 2, 2, 0], [0, 0, 0, 4, 2, 2, 0.3]])
def test_box_behind_or_around_the_camera_appears_nowhere(box: list[float]) -> None:
    seen = _seen(box)
    assert not seen.boxes_px.any()
    assert seen.truncated[0] == 1.0


def test_nearer_box_hides_a_farther_one_and_not_the_other_way() -> None:
    wall, behind, beside = (
        [10.0, 0, 0, 1, 6, 6, 0],
        [30.0, 0, 0, 2, 2, 2, 0],
        [30.0, 12, 0, 2, 2, 2, 0],
    )
    seen = _seen(wall, behind, beside)
    assert seen.occluded == pytest.approx([0, 1, 0])


def test_hidden_share_is_that_of_what_is_seen() -> None:
    # The wall fills 0.8 of its 10 m: it hides what is right of the middle by half.
    wall, behind = [10.0, -5, 0, 0.1, 10 / 0.8, 20, 0], [20.0, 0, 0, 0.1, 4, 4, 0]
    assert _seen(wall, behind).occluded[1] == pytest.approx(0.5, abs=0.1)


def test_box_that_cannot_hide_hides_nothing() -> None:
    boxes = [10.0, 0, 0, 1, 6, 6, 0], [30.0, 0, 0, 2, 2, 2, 0]
    seen = _seen(*boxes, hiding=np.array([False, True]))
    assert seen.occluded == pytest.approx([0, 0])


def test_no_boxes() -> None:
    seen = _seen()
    assert seen.boxes_px.shape == (0, 4)
    assert seen.occluded.shape == (0,)
