"""Simulated lights, read by a detector that errs in ways that the model does not know."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from light_sequences import (
    DetectorErrors,
    LightTruth,
    draw_cycles,
    draw_flashes,
    draw_outages,
    flash_delays,
    hard_errors,
    plain_errors,
    read_lights,
    red_as_green,
    track_readings,
)

from percept.lights import LightConfig

_LIGHTS = 60
_NOT_SAID = 4
_Draw = Callable[[int, float, np.random.Generator], LightTruth]


@pytest.mark.parametrize("rate_hz", [5, 10, 20])
@pytest.mark.parametrize("errors", [plain_errors(0.95), hard_errors(0.95)], ids=["plain", "hard"])
def test_flashes_are_found_and_named(rate_hz: int, errors: DetectorErrors) -> None:
    rng = np.random.default_rng([rate_hz, 1])
    truth = draw_flashes(_LIGHTS, rate_hz, rng)
    readings = read_lights(truth, errors, rng)
    said = track_readings(truth, readings, LightConfig())
    assert red_as_green(truth, said) == 0
    delays = flash_delays(truth, readings, said)
    assert np.isfinite(delays).all()
    assert (delays >= 1.2 - 1e-9).all()  # no light is called flashing within its first cycle
    if errors == plain_errors(0.95):
        late = np.percentile(delays - truth.period_s, 95)
        assert late <= {5: 2.4, 10: 1.2, 20: 1.2}[rate_hz]
        wrong = said.flashing & (said.codes != truth.colours) & (said.codes != _NOT_SAID)
        assert wrong.mean() < 0.002


@pytest.mark.parametrize(
    ("draw", "errors", "most"),
    [
        (draw_cycles, plain_errors(0.9), 0),
        (draw_cycles, hard_errors(0.95), 0),
        (draw_outages, plain_errors(0.9), 0),
        # glare and errors that last light up a dead lamp now and then as a flash would
        (draw_outages, hard_errors(0.95), 1),
    ],
    ids=["cycles-plain", "cycles-hard", "outages-plain", "outages-hard"],
)
def test_nothing_else_is_called_flashing_and_red_never_green(
    draw: _Draw, errors: DetectorErrors, most: int
) -> None:
    rng = np.random.default_rng([int(100 * errors.accuracy), 2])
    truth = draw(_LIGHTS, 10, rng)
    said = track_readings(truth, read_lights(truth, errors, rng), LightConfig())
    assert red_as_green(truth, said) == 0
    assert said.flashing.any(axis=1).sum() <= most
    assert (said.codes == truth.colours).mean() > 0.75


def test_hindsight_is_right_where_the_car_was_late() -> None:
    rng = np.random.default_rng(4)
    for draw, least in ((draw_cycles, 0.98), (draw_flashes, 0.98), (draw_outages, 0.95)):
        truth = draw(_LIGHTS, 10, rng)
        readings = read_lights(truth, plain_errors(0.95), rng)
        said = track_readings(truth, readings, LightConfig(), smoothed=True)
        assert red_as_green(truth, said) == 0
        right = (said.codes == truth.colours) & (said.flashing == truth.flashing)
        assert right[:, 1:].mean() > least
