"""KITTI tracking text and MOTChallenge text: what they say, round trips, and bad lines."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from percept.core.errors import InputError
from percept.datasets.labels.kitti_tracking import (
    from_kitti_boxes,
    read_kitti_detections,
    read_kitti_tracks,
    to_kitti_boxes,
    write_kitti_tracks,
)
from percept.datasets.labels.mot import read_mot

_TRACK = "3 7 Car 0 2 -1.5 10 20 110 70 1.5 1.6 4.0 2.0 1.7 20.0 -1.57"
_DETECTION = "3,2,10,20,110,70,13.85,1.5,1.6,4.0,2.0,1.7,20.0,-1.57,-1.8"
_MOT = "1,3,10,20,30,40,1,-1,-1,-1"


def test_a_box_of_the_camera_stands_upright(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(
        f"{_TRACK}\n0 -1 DontCare -1 -1 -10 1 2 3 4 -1000 -1000 -1000 -10 -1 -1 -1\n"
    )
    boxes = read_kitti_tracks(tmp_path / "a.txt")
    assert boxes.frames.tolist() == [0, 3]
    assert boxes.labels == ("DontCare", "Car")
    assert np.isnan(boxes.boxes_m[0]).all()
    # 20 m ahead, 2 m to the right, the bottom 1.7 m below the camera; it drives straight ahead.
    wanted = [20.0, -2.0, 0.75 - 1.7, 4.0, 1.6, 1.5, 1.57 - math.pi / 2]
    np.testing.assert_allclose(boxes.boxes_m[1], wanted, atol=1e-12)
    assert (boxes.truncated[1], boxes.occluded[1], boxes.ids[1]) == (0, 2, 7)
    assert np.isnan(boxes.scores).all()


@given(
    st.lists(
        st.tuples(
            *[st.floats(0.1, 20.0)] * 3, *[st.floats(-80.0, 80.0)] * 3,
            st.floats(-math.pi + 1e-6, math.pi),
        ),
        min_size=1, max_size=5,
    )
)  # fmt: skip
def test_boxes_come_back_from_the_camera(rows: list[tuple[float, ...]]) -> None:
    kitti = np.array(rows)
    np.testing.assert_allclose(to_kitti_boxes(from_kitti_boxes(kitti)), kitti, atol=1e-9)


def test_tracks_are_read_as_they_were_written(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(f"{_TRACK} 0.75\n")
    boxes = read_kitti_tracks(tmp_path / "a.txt")
    write_kitti_tracks(tmp_path / "b.txt", boxes)
    words = (tmp_path / "b.txt").read_text().split()
    assert (len(words), words[2], float(words[-1])) == (18, "Car", 0.75)
    assert float(words[5]) == pytest.approx(-1.57 - math.atan2(2.0, 20.0), abs=1e-6)
    again = read_kitti_tracks(tmp_path / "b.txt")
    np.testing.assert_allclose(again.boxes_m, boxes.boxes_m, atol=2e-6)
    np.testing.assert_allclose(again.boxes_px, boxes.boxes_px, atol=2e-6)
    assert (again.ids.tolist(), again.frames.tolist()) == ([7], [3])


def test_detections_of_several_files_are_one_sequence(tmp_path: Path) -> None:
    (tmp_path / "car.txt").write_text(f"{_DETECTION}\n")
    (tmp_path / "ped.txt").write_text(_DETECTION.replace("3,2,", "1,1,", 1) + "\n")
    boxes = read_kitti_detections([tmp_path / "car.txt", tmp_path / "ped.txt"])
    assert boxes.labels == ("Pedestrian", "Car")
    assert boxes.frames.tolist() == [1, 3]
    assert boxes.scores.tolist() == [13.85, 13.85]
    assert boxes.ids.tolist() == [-1, -1]
    (tmp_path / "none.txt").write_text("\n")
    assert not len(read_kitti_detections([tmp_path / "none.txt"]))


def test_labels_that_are_not_to_be_scored_are_counted(tmp_path: Path) -> None:
    (tmp_path / "gt.txt").write_text(f"{_MOT}\n1,4,10,20,30,40,0,-1,-1,-1\n")
    boxes, dropped = read_mot(tmp_path / "gt.txt", labels=True)
    assert boxes.boxes_px.tolist() == [[10, 20, 40, 60]]
    assert sum(dropped.values()) == 1
    tracks, dropped = read_mot(tmp_path / "gt.txt", labels=False)
    assert (len(tracks), sum(dropped.values())) == (2, 0)


def _read_labels(path: Path) -> object:
    return read_kitti_tracks(path)


def _read_detections(path: Path) -> object:
    return read_kitti_detections([path])


def _read_mot(path: Path) -> object:
    return read_mot(path, labels=True)


@pytest.mark.parametrize(
    ("read", "good", "bad", "message"),
    [
        (_read_labels, _TRACK, "0 1 Car", "line 2 has 3 columns"),
        (_read_labels, _TRACK, _TRACK, "line 2: id 7 comes twice in frame 3"),
        (_read_labels, _TRACK, _TRACK.replace("3 7", "4 x", 1), "line 2: could not convert"),
        (_read_labels, _TRACK, _TRACK.replace("3 7", "4.5 7", 1), "'4.5' is no whole number"),
        (_read_labels, _TRACK, _TRACK.replace("3 7", "-4 7", 1), "line 2: frame -4 is negative"),
        (_read_labels, _TRACK, _TRACK.replace("3 7", "4 7").replace("1.5 1.6", "0 1.6"), "no size"),
        (_read_labels, _TRACK, _TRACK.replace("20.0", "nan"), "line 2: a number is not finite"),
        (_read_detections, _DETECTION, _DETECTION + ",1", "line 2 has 16 columns"),
        (_read_detections, _DETECTION, _DETECTION.replace("3,2", "3,4"), "line 2: type 4 is none"),
        (_read_detections, _DETECTION, _DETECTION.replace("13.85", "high"), "line 2: could not"),
        (_read_mot, _MOT, "1 4 10 20 30 40", "line 2 has 1 columns"),
        (_read_mot, _MOT, _MOT, "line 2: id 3 comes twice in frame 1"),
        (_read_mot, _MOT, _MOT.replace("30,40", "30,0"), "line 2: a box of negative or no size"),
    ],
)
def test_a_bad_line_is_named(
    read: Callable[[Path], object], good: str, bad: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "0001.txt"
    path.write_text(f"{good}\n{bad}\n")
    with pytest.raises(InputError) as caught:
        read(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_what_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(InputError, match="cannot be read"):
        read_kitti_tracks(tmp_path / "a.txt")
