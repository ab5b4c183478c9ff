"""Running statistics stay small and come near the truth."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest

from percept.export.running import EvenSample, MillisecondQuantiles


@pytest.mark.parametrize("length", [0, 1, 3, 4, 5, 7, 8, 9, 100, 1000, 4096])
def test_sample_is_even_over_any_length(length: int) -> None:
    sample: EvenSample[int] = EvenSample(4)
    made: list[int] = []

    def make(item: int) -> int:
        made.append(item)
        return item

    for i in range(length):
        sample.offer(partial(make, i))
    chosen = sample.chosen()
    assert len(chosen) == min(4, length)
    assert chosen[:1] == list(range(min(length, 1)))
    if length > 4:
        gaps = np.diff(chosen)
        assert gaps.min() >= length / 16
        assert gaps.max() <= length / 2
        assert chosen[-1] >= length / 2
    assert len(made) <= 4 * (2 + math.log2(max(length, 1)))


@pytest.mark.parametrize("scale_ms", [0.02, 5.0, 3000.0])
def test_quantiles_are_right_to_one_per_cent(scale_ms: float) -> None:
    durations = scale_ms * np.random.default_rng(1).lognormal(size=5000)
    quantiles = MillisecondQuantiles()
    for duration in durations:
        quantiles.add(duration)
    for share in (0.5, 0.95, 1.0):
        truth = np.quantile(durations, share, method="inverted_cdf")
        assert quantiles.quantile_ms(share) == pytest.approx(truth, rel=0.0101)
    assert quantiles.count == 5000
    assert quantiles.total_ms == pytest.approx(durations.sum())


def test_no_durations_have_no_quantile() -> None:
    assert math.isnan(MillisecondQuantiles().quantile_ms(0.5))
