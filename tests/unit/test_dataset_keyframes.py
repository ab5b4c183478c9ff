"""Moments of keyframes, on made-up ways."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.trajectory import Trajectory
from percept.core.transform import rotation_from_rpy
from percept.datasets.labelling.choice.evidence import (
    FrameEvidence,
    label_counts,
    rarity,
    strength,
    uncertainty,
)
from percept.datasets.labelling.choice.keyframes import KeyframeConfig, choose_instants

_SECOND = 1_000_000_000
_CONFIG = KeyframeConfig()


def _stamps(seconds: float, rate: float = 10.0) -> NDArray[np.int64]:
    return (np.arange(round(seconds * rate)) * _SECOND / rate).astype(np.int64) + 7 * _SECOND


def _way(
    stamps: NDArray[np.int64],
    x_m: NDArray[np.float64],
    yaw_rad: NDArray[np.float64] | None = None,
    gaps_ns: NDArray[np.int64] | None = None,
) -> Trajectory:
    matrices = np.tile(np.eye(4), (len(stamps), 1, 1))
    matrices[:, 0, 3] = x_m
    if yaw_rad is not None:
        matrices[:, :3, :3] = [rotation_from_rpy(0.0, 0.0, yaw) for yaw in yaw_rad]
    none = np.zeros((0, 2), np.int64)
    return Trajectory("map", "base_link", stamps, matrices, none if gaps_ns is None else gaps_ns)


def _evidence(
    stamp_ns: int,
    labels: tuple[str, ...] = ("car",),
    confidence: float = 0.9,
    disagreement: float = 0.0,
) -> FrameEvidence:
    confidences = np.full(len(labels), confidence)
    return FrameEvidence(
        stamp_ns=stamp_ns, labels=labels, confidences=confidences, disagreement=disagreement
    )


def test_a_moving_vehicle_gets_one_every_few_metres() -> None:
    stamps = _stamps(10.0)
    instants = choose_instants(stamps, _way(stamps, 10.0 * (stamps - stamps[0]) / 1e9), _CONFIG)
    assert [i.stamp_ns for i in instants] == stamps[::5].tolist()
    assert [i.reason for i in instants] == ["first"] + ["distance"] * 19


def test_a_standing_vehicle_gets_one_every_few_seconds() -> None:
    stamps = _stamps(10.0)
    instants = choose_instants(stamps, _way(stamps, np.zeros(100)), _CONFIG)
    assert [i.stamp_ns for i in instants] == stamps[::20].tolist()
    assert {i.reason for i in instants[1:]} == {"time"}


def test_a_turn_on_the_spot_gets_one_every_few_degrees() -> None:
    stamps = _stamps(6.0)
    yaw = np.radians(30.0) * (stamps - stamps[0]) / 1e9
    instants = choose_instants(stamps, _way(stamps, np.zeros(60), yaw), _CONFIG)
    steps = np.diff([i.stamp_ns for i in instants]) / 1e9
    assert {i.reason for i in instants[1:]} == {"turn"}
    np.testing.assert_allclose(steps, 0.5, atol=0.1001)


def test_without_poses_time_alone_counts() -> None:
    stamps = _stamps(10.0)
    assert [i.stamp_ns for i in choose_instants(stamps, None, _CONFIG)] == stamps[::20].tolist()


def test_a_gap_in_the_poses_is_bridged_by_time() -> None:
    stamps = _stamps(20.0)
    gap = np.array([[stamps[50], stamps[150]]])
    way = _way(stamps, 10.0 * (stamps - stamps[0]) / 1e9, gaps_ns=gap)
    instants = choose_instants(stamps, way, _CONFIG)
    inside = [i for i in instants if stamps[50] < i.stamp_ns < stamps[150]]
    assert {i.reason for i in inside} == {"time"}
    assert 4 <= len(inside) <= 5
    assert {i.reason for i in instants if i.stamp_ns > stamps[160]} == {"distance"}


def test_never_sooner_than_the_least_gap() -> None:
    stamps = _stamps(2.0)
    way = _way(stamps, 100.0 * (stamps - stamps[0]) / 1e9)
    instants = choose_instants(stamps, way, KeyframeConfig(min_gap_s=0.4))
    assert [i.stamp_ns for i in instants] == stamps[::4].tolist()


def test_the_order_and_repeats_of_stamps_do_not_matter() -> None:
    stamps = _stamps(10.0)
    mixed = np.random.default_rng(0).permutation(np.concatenate([stamps, stamps[::3]]))
    assert choose_instants(mixed, None, _CONFIG) == choose_instants(stamps, None, _CONFIG)


def test_no_stamps_give_no_moments() -> None:
    none = np.zeros(0, np.int64)
    assert choose_instants(none, None, _CONFIG, [_evidence(0)]) == ()


@given(
    st.lists(st.integers(0, 400), min_size=1, max_size=60),
    st.lists(st.floats(-3, 3), min_size=60, max_size=60),
    st.floats(0.0, 1.0),
)
def test_no_moment_that_is_due_is_left_out(
    ticks: list[int], steps_m: list[float], min_gap_s: float
) -> None:
    stamps = np.unique(np.array(ticks)) * (_SECOND // 10)
    x_m = np.cumsum(steps_m[: len(stamps)])
    config = KeyframeConfig(min_gap_s=min_gap_s)
    instants = choose_instants(stamps, _way(stamps, x_m), config)
    chosen = [int(np.searchsorted(stamps, i.stamp_ns)) for i in instants]
    assert chosen[0] == 0
    for last, stop in zip(chosen, [*chosen[1:], len(stamps)], strict=True):
        for between in range(last + 1, stop):
            after_s = (stamps[between] - stamps[last]) / 1e9
            due = after_s >= 2.0 or abs(x_m[between] - x_m[last]) >= 5.0
            assert not due or after_s < min_gap_s
    gaps_s = np.diff([i.stamp_ns for i in instants]) / 1e9
    assert np.all(gaps_s >= min(min_gap_s, np.inf) - 1e-9)


@pytest.mark.parametrize("cut", [1, 2, 3, 4, 5, 30])
def test_a_part_cut_out_of_a_log_gets_the_moments_of_the_whole(cut: int) -> None:
    stamps = _stamps(20.0)
    way = _way(stamps, 8.0 * (stamps - stamps[0]) / 1e9)
    whole = [i.stamp_ns for i in choose_instants(stamps, way, _CONFIG)]
    part = choose_instants(stamps[cut:], way, _CONFIG, (), np.array(whole))
    first = int(np.searchsorted(whole, part[1].stamp_ns))
    assert part[0].stamp_ns == stamps[cut]
    assert [i.stamp_ns for i in part[1:]] == whole[first:]
    assert part[1].stamp_ns - part[0].stamp_ns <= 1.5 * 0.7 * _SECOND
    others = np.array(whole) + 1
    assert choose_instants(stamps, way, _CONFIG, (), others) == choose_instants(
        stamps, way, _CONFIG
    )


def test_strong_evidence_adds_moments_the_strongest_first_and_apart() -> None:
    stamps = _stamps(40.0)
    usual = [_evidence(int(s)) for s in stamps]
    odd = [
        _evidence(int(stamps[33]), ("deer",), 0.5, disagreement=1.0),
        _evidence(int(stamps[34]), ("deer",), 0.5, disagreement=0.9),
        _evidence(int(stamps[71]) + 20_000_000, ("car",), 0.5, disagreement=0.9),
        _evidence(int(stamps[-1]) + 5 * _SECOND, ("deer",), 0.5, disagreement=1.0),
    ]
    plain = choose_instants(stamps, None, _CONFIG)
    instants = choose_instants(stamps, None, _CONFIG, [*usual, *odd])
    extra = [i for i in instants if i.reason == "evidence"]
    assert [i.stamp_ns for i in extra] == [stamps[33], stamps[71]]
    assert extra[0].score > extra[1].score >= _CONFIG.evidence_least
    assert [i.stamp_ns for i in instants if i.reason != "evidence"] == [i.stamp_ns for i in plain]


def test_no_more_evidence_than_its_share() -> None:
    stamps = _stamps(40.0)
    odd = [_evidence(int(s), ("car",), 0.5, disagreement=1.0) for s in stamps]
    instants = choose_instants(stamps, None, _CONFIG, odd)
    assert sum(i.reason == "evidence" for i in instants) == 5
    assert len(instants) == 25


def test_signs_of_evidence() -> None:
    moments = [_evidence(i) for i in range(98)] + [_evidence(98, ("car", "deer"))]
    counts = label_counts(moments)
    assert counts == {"car": 99, "deer": 1}
    assert rarity(moments[-1], counts) == 1.0
    assert rarity(moments[0], counts) < 0.01
    assert rarity(_evidence(0, ()), counts) == 0.0
    assert uncertainty(_evidence(0, ("car",), 0.5)) == 1.0
    assert uncertainty(_evidence(0, ("car",), 1.0)) == 0.0
    assert uncertainty(_evidence(0, ("car",), float("nan"))) == 0.0
    assert strength(_evidence(0, ("deer",), 0.5, disagreement=1.0), counts) == 1.0


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
def test_a_disagreement_is_a_share(share: float) -> None:
    with pytest.raises(GeometryError, match="share"):
        _evidence(0, disagreement=share)


def test_columns_of_evidence_have_one_length() -> None:
    with pytest.raises(GeometryError, match="2 labels"):
        FrameEvidence(stamp_ns=0, labels=("car", "car"), confidences=np.ones(1))
    with pytest.raises(GeometryError, match="1 labels"):
        FrameEvidence(
            stamp_ns=0, labels=("car",), confidences=np.ones(1), track_ids=np.zeros(2, np.int64)
        )
