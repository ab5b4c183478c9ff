"""A network's mask in place of contrast: lines come from the mask, colours from the image."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper

from percept.core.lane_markings import PaintObservation
from percept.datasets.synthetic.drive import Drive, DriveConfig
from percept.detection.road_lines import RoadLineNetwork
from percept.lanes import flat_ground, observe_paint
from percept.lanes.birdseye import BirdsEye

_F64 = NDArray[np.float64]
_Image = NDArray[np.uint8]
_CAMERA = Drive(DriveConfig(seed=5, seconds=1)).cameras[0]
_WHITE_Y, _YELLOW_Y, _WIDTH_M = -1.75, 1.75, 0.15
_ASPHALT, _WHITE, _YELLOW = (60, 60, 60), (225, 225, 225), (40, 190, 235)


def _places() -> _F64:
    """Return where each pixel meets a flat road, (H, W, 2)."""
    width, height = _CAMERA.image_size
    v, u = np.mgrid[0:height, 0:width].astype(np.float64)
    view = BirdsEye(_CAMERA, flat_ground())
    return view.points(np.column_stack([u.ravel(), v.ravel()])).reshape(height, width, 2)


_PLACES = _places()


def _on(line_y: float) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return (np.abs(_PLACES[..., 1] - line_y) < _WIDTH_M / 2) & (_PLACES[..., 0] > 0)


def _street() -> _Image:
    image = np.full((*_PLACES.shape[:2], 3), _ASPHALT, np.uint8)
    image[_on(_WHITE_Y)], image[_on(_YELLOW_Y)] = _WHITE, _YELLOW
    return image


def _threshold_network(path: Path) -> Path:
    """Write a network: the mean of the channels, 0..1, against a threshold, as a logit."""
    width, height = _CAMERA.image_size
    nodes = [
        helper.make_node("ReduceMean", ["image"], ["gray"], axes=[1], keepdims=1),
        helper.make_node("Sub", ["gray", "threshold"], ["above"]),
        helper.make_node("Mul", ["above", "gain"], ["mask"]),
    ]
    floats = TensorProto.FLOAT
    graph = helper.make_graph(
        nodes,
        "threshold",
        [helper.make_tensor_value_info("image", floats, [1, 3, height, width])],
        [helper.make_tensor_value_info("mask", floats, [1, 1, height, width])],
        [
            helper.make_tensor("threshold", floats, [1], [0.45]),
            helper.make_tensor("gain", floats, [1], [60.0]),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.save(model, path)
    return path


def _seen(image: _Image, mask: NDArray[np.float32] | None) -> PaintObservation:
    return observe_paint(
        image,
        _CAMERA,
        stamp_ns=1,
        ground=flat_ground(),
        paint_mask=None if mask is None else lambda _: mask,
    )


def _extent(seen: PaintObservation, line_y: float) -> float:
    near = np.abs(seen.strokes_m[:, 1] - line_y) < 0.1
    return float(near.sum()) * seen.step_m


def test_lines_of_a_network_lie_where_they_are_and_have_their_colours(tmp_path: Path) -> None:
    network = RoadLineNetwork(_threshold_network(tmp_path / "threshold.onnx"))
    image = _street()
    seen = observe_paint(image, _CAMERA, stamp_ns=1, ground=flat_ground(), paint_mask=network.mask)
    y = seen.strokes_m[:, 1]
    off = np.minimum(np.abs(y - _WHITE_Y), np.abs(y - _YELLOW_Y))
    assert off.max() < 0.04
    for line_y, yellow in ((_WHITE_Y, 0.0), (_YELLOW_Y, 1.0)):
        here = np.abs(y - line_y) < 0.1
        assert here.sum() * seen.step_m > 8
        assert seen.yellow[here] == pytest.approx(yellow, abs=0.05)
        assert np.median(seen.width_m[here]) == pytest.approx(_WIDTH_M, abs=0.04)
    assert seen.strength.min() > 0.5


def test_the_mask_decides_and_not_the_contrast() -> None:
    nothing = np.zeros(_PLACES.shape[:2], np.float32)
    assert len(_seen(_street(), nothing).strokes_m) == 0
    assert _extent(_seen(_street(), None), _WHITE_Y) > 8
    gray = np.full((*nothing.shape, 3), _ASPHALT, np.uint8)
    worn = _on(_WHITE_Y).astype(np.float32)
    assert _extent(_seen(gray, worn), _WHITE_Y) > 8
    assert len(_seen(gray, None).strokes_m) == 0
    assert len(_seen(gray, np.float32(0.4) * worn).strokes_m) == 0


def test_lines_of_a_pair_stay_two_and_a_wide_mask_is_one() -> None:
    gray = np.full((*_PLACES.shape[:2], 3), _ASPHALT, np.uint8)
    pair = (_on(-1.87) | _on(-1.57)).astype(np.float32)
    seen = _seen(gray, pair)
    near = seen.strokes_m[seen.strokes_m[:, 0] < 9, 1]
    assert (np.abs(near + 1.87) < 0.05).sum() >= 4
    assert (np.abs(near + 1.57) < 0.05).sum() >= 4
    with np.errstate(invalid="ignore"):
        wide = (np.abs(_PLACES[..., 1] + 1.75) < 0.17).astype(np.float32)
    row = _seen(gray, wide).strokes_m
    assert len(row) > 10
    assert np.abs(row[:, 1] + 1.75).max() < 0.05
