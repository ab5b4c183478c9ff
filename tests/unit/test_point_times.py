"""Per-point times in the units of the wild: what is resolved, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.datasets.decoding.point_times import UnclearTimesError, offsets_from_pair, offsets_ns

STAMP_NS = 1_700_000_000_123_456_789
SWEEP_NS = np.array([0, 12_345_678, 50_000_000, 99_999_999])


@pytest.mark.parametrize(
    ("name", "values", "tolerance_ns"),
    [
        ("t", SWEEP_NS.astype("u4"), 0),
        ("offset_time", SWEEP_NS.astype("i4"), 0),
        ("time", (SWEEP_NS * 1e-9).astype("f4"), 10),
        ("time", SWEEP_NS * 1e-9, 0),
        ("timestamp", SWEEP_NS * 1e-6, 0),
        ("time", (SWEEP_NS // 1000).astype("u4"), 1000),
        ("timestamp", SWEEP_NS.astype("u4"), 0),
        ("timestamps", (STAMP_NS + SWEEP_NS) * 1e-9, 250),
        ("timestamp", (STAMP_NS + SWEEP_NS).astype("f8"), 250),
        ("timestamp", STAMP_NS + SWEEP_NS, 0),
        ("time_stamp", (STAMP_NS + SWEEP_NS) // 1000, 1000),
        ("timestamp", (STAMP_NS + SWEEP_NS) * 1e-3, 300),
    ],
)
def test_units_are_told_by_magnitude(name: str, values: NDArray[Any], tolerance_ns: int) -> None:
    offsets = offsets_ns(values, name, STAMP_NS)
    assert offsets.dtype == np.int64
    assert np.abs(offsets - SWEEP_NS).max() <= tolerance_ns


def test_relative_times_may_lie_before_the_stamp() -> None:
    values = (SWEEP_NS - 100_000_000) * 1e-9
    np.testing.assert_allclose(offsets_ns(values, "time", STAMP_NS), SWEEP_NS - 100_000_000)


def test_absolute_seconds_keep_what_their_float_knows() -> None:
    # Scaling an epoch to ns in float64 would add errors of its own to the 238 ns of the input.
    values = np.array([1_700_000_000.123456717])
    exact = int(np.rint((values[0] - 1_700_000_000) * 1e9)) - 123_456_789
    assert offsets_ns(values, "timestamp", STAMP_NS)[0] == exact


def test_without_a_stamp_it_stands_for_the_earliest_point() -> None:
    values = (STAMP_NS + SWEEP_NS[::-1]) * 1e-9
    offsets = offsets_ns(values, "timestamp", None)
    assert offsets.min() == 0
    np.testing.assert_allclose(offsets, SWEEP_NS[::-1], atol=500)


@pytest.mark.parametrize(
    ("name", "values", "reason"),
    [
        ("timestamp", np.array([0.0, np.nan]), "finite"),
        ("timestamp", np.zeros(5), "zero"),
        ("timestamp", np.array([1_600_000_000.0, 1_600_000_000.1]), "another clock"),
        ("timestamp", np.array([500_000_000, 500_100_000], dtype="u4"), "another clock"),
        ("timestamp", np.array([0, 3_000_000_000], dtype="u4"), "no unit"),
        ("timestamp", np.array([0.0, 1e300]), "no unit"),
        ("t", np.array([0, 2**63], dtype="u8"), "no unit"),
    ],
)
def test_what_fits_no_rule_is_refused(name: str, values: NDArray[Any], reason: str) -> None:
    with pytest.raises(UnclearTimesError, match=reason):
        offsets_ns(values, name, STAMP_NS)


def test_small_epochs_are_not_taken_for_relative_times() -> None:
    # A simulated clock that started a minute ago: absolute, and near its stamp.
    values = 60.2 + SWEEP_NS * 1e-9
    np.testing.assert_allclose(offsets_ns(values, "time", 60_200_000_000), SWEEP_NS, atol=1)


def test_a_pair_of_seconds_and_nanoseconds_is_exact() -> None:
    seconds, nanoseconds = np.divmod(STAMP_NS + SWEEP_NS, 10**9)
    offsets = offsets_from_pair(seconds.astype("u4"), nanoseconds.astype("u4"), STAMP_NS)
    assert offsets.tolist() == SWEEP_NS.tolist()
    earliest = offsets_from_pair(seconds, nanoseconds, None)
    assert earliest.tolist() == SWEEP_NS.tolist()


def test_a_pair_far_from_the_stamp_is_refused() -> None:
    with pytest.raises(UnclearTimesError, match="1 s"):
        offsets_from_pair(np.array([5]), np.array([0]), STAMP_NS)
    with pytest.raises(UnclearTimesError, match="1970"):
        offsets_from_pair(np.array([2**62]), np.array([0]), STAMP_NS)


def test_no_points_have_no_times() -> None:
    assert offsets_ns(np.zeros(0), "t", STAMP_NS).shape == (0,)
    assert offsets_from_pair(np.zeros(0), np.zeros(0), STAMP_NS).shape == (0,)
