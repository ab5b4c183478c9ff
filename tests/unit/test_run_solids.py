"""Tracks between two of their moments, and 3D boxes in the frame of the vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_tracks import START_NS, STEP_NS, make_tracks

from percept.core.errors import GeometryError
from percept.core.results import Detections3D
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.labelling.prelabels.run_solids import (
    solids_of_scans,
    solids_of_tracks,
    tracks_between,
)


def _turned(yaw_rad: float, x: float = 0.0) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(0, 0, yaw_rad)
    matrix[0, 3] = x
    return Transform("base", "map", matrix)


def test_tracks_are_interpolated() -> None:
    between = tracks_between(make_tracks(4), make_tracks(5), START_NS + 4 * STEP_NS + 25_000_000)
    assert between is not None
    steps = make_tracks(4), make_tracks(5)
    expected = 0.75 * steps[0].boxes_m + 0.25 * steps[1].boxes_m
    assert between.boxes_m == pytest.approx(expected)
    assert between.stamp_ns == START_NS + 4 * STEP_NS + 25_000_000


def test_moment_itself_is_taken_as_it_is() -> None:
    at = make_tracks(4)
    found = tracks_between(at, make_tracks(5), at.stamp_ns)
    assert found is not None
    assert found.boxes_m == pytest.approx(at.boxes_m)


def test_yaw_takes_the_shorter_arc() -> None:
    before, after = make_tracks(1, 1), make_tracks(2, 1)
    before.boxes_m[0, 6], after.boxes_m[0, 6] = 3.1, -3.1
    found = tracks_between(before, after, before.stamp_ns + STEP_NS // 2)
    assert found is not None
    assert abs(found.boxes_m[0, 6]) == pytest.approx(np.pi)


@pytest.mark.parametrize(("share", "ids"), [(0.4, [1, 2]), (0.6, [1, 2, 3])])
def test_object_of_one_moment_is_there_while_that_is_nearer(share: float, ids: list[int]) -> None:
    before, after = make_tracks(1, 2), make_tracks(2, 3)
    found = tracks_between(before, after, before.stamp_ns + round(share * STEP_NS))
    assert found is not None
    assert found.ids.tolist() == ids
    if len(ids) == 3:  # moved back with its velocity
        assert found.boxes_m[2, 0] == pytest.approx(after.boxes_m[2, 0] - 0.04 * 4.0)


def test_moments_far_away_say_nothing() -> None:
    at = make_tracks(1)
    assert tracks_between(at, None, at.stamp_ns + 400_000_000) is not None
    assert tracks_between(at, None, at.stamp_ns + 600_000_000) is None
    assert tracks_between(None, None, at.stamp_ns) is None


def test_tracks_in_the_frame_of_the_vehicle() -> None:
    tracks = make_tracks(0, 3)
    solids = solids_of_tracks(tracks, _turned(np.pi / 2, x=1.0))
    assert solids.track_ids.tolist() == [1, 2]  # the third is on trial
    assert solids.ids.tolist() == [1, 2]
    assert solids.boxes_m[0, :3] == pytest.approx([1 + 4, 10, 0.8])
    assert solids.boxes_m[0, 6] == pytest.approx(0.1 + np.pi / 2)
    assert solids.velocities_mps[0] == pytest.approx([0, 2])
    assert solids.confidences == pytest.approx([0.9, 0.75])
    assert solids.points.tolist() == [-1, -1]
    assert set(solids.sources) == {"tracks"}
    assert len(solids_of_tracks(tracks, _turned(0.0), trial=True)) == 3


def test_tracks_of_another_frame_are_refused() -> None:
    with pytest.raises(GeometryError, match="enu"):
        solids_of_tracks(replace(make_tracks(0), frame_id="enu"), _turned(0.0))


def test_scans_of_several_sensors_become_one_set() -> None:
    box = np.array([[5.0, 0, 1, 4, 2, 1.5, 0]])
    scans = [
        Detections3D(1, name, "map", box, ("car",), np.array([0.8]), points=np.array([count]))
        for name, count in (("left", 12), ("right", 0))
    ]
    solids = solids_of_scans(scans, [_turned(0.0), _turned(0.0, x=2.0)])
    assert solids.boxes_m[:, 0].tolist() == [5.0, 7.0]
    assert solids.points.tolist() == [12, -1]
    assert solids.track_ids.tolist() == [-1, -1]
    assert np.isnan(solids.velocities_mps).all()
    assert not len(solids_of_scans([], []))


def test_velocity_against_the_vehicle_is_not_one_over_the_ground() -> None:
    solids = solids_of_tracks(make_tracks(0, frame_id="base"), Transform.identity("base", "base"))
    assert np.isnan(solids.velocities_mps).all()
    assert solids.boxes_m[0, 0] == 10
