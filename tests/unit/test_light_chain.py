"""The chain of light states: steps of any length, and what they allow."""

from __future__ import annotations

import numpy as np
import pytest

from percept.core.errors import ConfigError
from percept.core.settings import parse_settings
from percept.lights.chain import LightChain
from percept.lights.config import LightConfig, SignalConfig
from percept.lights.states import CLASSES, LightStateSpace

_S = 1_000_000_000


@pytest.fixture(scope="module")
def chain() -> LightChain:
    return LightChain(LightStateSpace(LightConfig()))


def _class_after(chain: LightChain, start: str, dt_s: float) -> dict[str, float]:
    first = chain.space.seen_right(CLASSES.index(start))
    shares = chain.step(round(dt_s * _S))[first] @ chain.space.to_classes
    return dict(zip(CLASSES, shares.tolist(), strict=True))


@pytest.mark.parametrize("dt_s", [0.0, 0.02, 0.1, 3.0, 3600.0])
def test_steps_keep_probability(chain: LightChain, dt_s: float) -> None:
    step = chain.step(round(dt_s * _S))
    assert (step >= 0).all()
    np.testing.assert_allclose(step.sum(axis=1), 1, atol=1e-5)


def test_two_steps_are_one_long_step(chain: LightChain) -> None:
    two = chain.step(_S // 10) @ chain.step(_S // 5)
    np.testing.assert_allclose(two, chain.step(3 * _S // 10), atol=2e-6)


def test_colours_follow_the_regulations(chain: LightChain) -> None:
    after = _class_after(chain, "red", 0.1)
    assert after["green"] == pytest.approx(0.1 / 30, rel=0.02)
    assert after["yellow"] < 1e-5
    assert _class_after(chain, "green", 0.1)["red"] < 1e-4
    assert _class_after(chain, "yellow", 0.1)["green"] < 1e-4


def test_a_long_gap_leaves_the_state_open(chain: LightChain) -> None:
    after = _class_after(chain, "red", 120)
    assert max(after["red"], after["green"]) < 0.6


def test_red_with_yellow_comes_before_green_where_signals_have_it() -> None:
    signals = SignalConfig(red_yellow=True)
    chain = LightChain(LightStateSpace(LightConfig(signals=signals)))
    assert _class_after(chain, "red", 0.1)["green"] < 3e-4
    assert _class_after(chain, "red", 6.0)["green"] > 0.1


def test_flash_has_its_duty_cycle_and_period(chain: LightChain) -> None:
    space = chain.space
    lit, dark = space.lit_cells(0), space.dark_cells(0)
    start = np.zeros(space.size)
    start[lit[0]] = 1
    shares = np.array([(start @ chain.step(round(t * _S)))[lit].sum() for t in (0.3, 0.85, 1.38)])
    assert shares[0] > 0.9
    assert shares[1] < 0.2
    assert shares[2] > 0.8
    ring = np.concatenate([lit, dark])
    after = (start @ chain.step(20 * _S))[ring]
    assert 0.5 < after[: len(lit)].sum() / after.sum() < 2 / 3


def test_prior_and_emissions_are_probabilities(chain: LightChain) -> None:
    assert chain.space.prior.sum() == pytest.approx(1)
    np.testing.assert_allclose(chain.space.emissions.sum(axis=1), 1)
    np.testing.assert_array_equal(chain.space.to_classes.sum(axis=1), 1)


def test_confusion_that_is_no_share_is_refused() -> None:
    rows = [[0.9, 0.05, 0.05, 0.05], *[[0.25] * 4] * 3]
    with pytest.raises(ConfigError, match="sums to 1"):
        parse_settings(LightConfig, {"detector": {"confusion": rows}}, where="lights.yaml")
