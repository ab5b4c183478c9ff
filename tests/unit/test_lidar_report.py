"""The report of a LiDAR calibration: where it looks, and what its centimetres are."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.lidars.result import LidarCalibration, LidarExtrinsic
from percept.core.results import Verdict
from percept.export.calibration.lidar_report import (
    clouds_in_reference,
    lidar_calibration_report,
    point_sd_m,
)
from percept.export.calibration.shared_view import busiest_places

Points = NDArray[np.float64]


def _wall(x: float, y: tuple[float, float], seed: int) -> Points:
    rng = np.random.default_rng(seed)
    return np.column_stack([np.full(4000, x), rng.uniform(*y, 4000), rng.uniform(0, 3, 4000)])


def _floor(seed: int) -> Points:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-30, 30, size=(4000, 2)), np.zeros(4000)])


def _extrinsic(T: Points | None, start: Points | None = None) -> LidarExtrinsic:
    return LidarExtrinsic(
        sensor="left",
        T_reference_sensor=T,
        sd_translation_m=np.array([0.003, 0.0, 0.004]),
        sd_rotation_deg=np.degrees([0.0, 0.003, 0.004]),
        leave_one_out_translation_m=None,
        leave_one_out_rotation_deg=None,
        rms_m=0.02 if T is not None else np.nan,
        overlap=0.5,
        scenes_agreeing="1/1",
        weak_directions=(),
        verdict=Verdict.DOUBTFUL if T is not None else Verdict.BAD,
        why="<made up>",
        path=("top", "left"),
        T_reference_start=start,
    )


def _result(extrinsic: LidarExtrinsic) -> LidarCalibration:
    return LidarCalibration(
        reference="top",
        extrinsics=(extrinsic,),
        loops=(),
        verdict=extrinsic.verdict,
        why=("<made up>",),
        advice=(),
        scenes=1,
    )


def test_it_looks_where_both_see_something_upright() -> None:
    first = np.vstack([_floor(1), _wall(10, (-3, 3), 2), _wall(-12, (5, 9), 3)])
    second = np.vstack([_floor(4), _wall(10, (-3, 3), 5), _wall(20, (-9, 9), 6)])
    ((centre, along),) = busiest_places(first, second, 8.0, 3)
    assert centre == pytest.approx([10, 0, 1.5], abs=0.5)
    assert along == "y"
    assert busiest_places(_floor(1), _floor(2), 8.0, 3) == []
    assert busiest_places(np.zeros((0, 3)), first, 8.0, 3) == []


def test_a_second_place_is_apart_from_the_first() -> None:
    first = np.vstack([_wall(10, (-12, 12), 2), _wall(-12, (5, 9), 3)])
    places = busiest_places(first, first, 8.0, 2)
    assert len(places) == 2
    assert np.abs(places[0][0] - places[1][0])[:2].max() >= 6.0


def test_the_spread_of_a_point_grows_with_its_range() -> None:
    extrinsic = _extrinsic(np.eye(4))
    assert point_sd_m(extrinsic, 0.0) == pytest.approx(0.005)
    assert point_sd_m(extrinsic, 10.0) == pytest.approx(np.hypot(0.005, 0.05))


def test_before_is_the_given_place_and_after_the_found_one() -> None:
    found, given = np.eye(4), np.eye(4)
    found[0, 3], given[0, 3] = 1.0, 2.0
    scene = {"top": np.zeros((2, 3)), "left": np.zeros((3, 3))}
    before, after = clouds_in_reference(_result(_extrinsic(found, given)), scene)
    assert before["left"][:, 0] == pytest.approx(2.0)
    assert after["left"][:, 0] == pytest.approx(1.0)
    before, after = clouds_in_reference(_result(_extrinsic(None)), scene)
    assert set(after) == {"top"}
    assert before["left"][:, 0] == pytest.approx(0.0)


@pytest.mark.parametrize("T", [np.eye(4), None])
def test_the_report_says_what_is_not_known(T: Points | None) -> None:
    scene = {"top": _wall(10, (-3, 3), 2), "left": _wall(10, (-3, 3), 5)}
    content = lidar_calibration_report(
        _result(_extrinsic(T)), [scene], inputs=[], settings={"voxel_m": 0.1}
    )
    assert content.verdict is _extrinsic(T).verdict
    titles = [section.title for section in content.sections]
    assert titles[0] == "All LiDARs over each other"
    assert titles[-1] == "Residuals"
    text = str(content.sections)
    assert ("not known" in text) is True
    assert ("there is no place to look at" in text) is (T is None)
