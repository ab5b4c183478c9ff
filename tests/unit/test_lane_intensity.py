"""Paint in the intensity of LiDAR points on a made road."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.lane_markings import PaintObservation, Sight
from percept.lanes.ground import GroundSurface, flat_ground
from percept.lanes.intensity import observe_intensity

_F64 = NDArray[np.float64]


def _road(lines_m: tuple[float, ...], paint: float = 200.0, count: int = 400_000) -> _F64:
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-10, 20, count), rng.uniform(-9, 9, count)
    z = rng.normal(0, 0.02, count)
    intensity = rng.gamma(8.0, 1.25, count)
    on_line = np.min([np.abs(y - line) for line in lines_m], axis=0) < 0.06
    intensity[on_line] = rng.normal(paint, 0.1 * paint, int(on_line.sum()))
    return np.column_stack([x, y, z, intensity])


def _look(points: _F64, ground: GroundSurface | None = None) -> PaintObservation:
    return observe_intensity(
        points,
        stamp_ns=7,
        sensor="lidar_top",
        frame_id="base_link",
        ground=flat_ground() if ground is None else ground,
    )


def _sight(seen: PaintObservation, x: float, y: float) -> int:
    return int(seen.coverage.at(np.array([[x, y]]))[0])


def test_lines_are_found_where_they_are_and_nothing_else() -> None:
    seen = _look(_road((-3.51, 1.74)))
    y = seen.strokes_m[:, 1]
    off = np.minimum(np.abs(y + 3.51), np.abs(y - 1.74))
    assert off.max() < 0.03
    for line in (-3.51, 1.74):
        assert np.ptp(seen.strokes_m[np.abs(y - line) < 0.1, 0]) > 28
    assert len(y) == pytest.approx(2 * 30 / seen.step_m, rel=0.05)
    assert np.abs(seen.direction_rad).max() < 0.01
    assert np.median(seen.width_m) == pytest.approx(0.12, abs=0.04)
    assert np.isnan(seen.yellow).all()
    assert seen.notes == ()


def test_a_pair_of_lines_is_two_rows_of_strokes() -> None:
    y = _look(_road((-0.12, 0.12))).strokes_m[:, 1]
    assert (np.abs(np.abs(y) - 0.12) < 0.04).mean() > 0.95
    assert (y > 0).mean() == pytest.approx(0.5, abs=0.1)


def test_a_slanting_line_has_its_direction() -> None:
    points = _road((100.0,))
    on_line = np.abs(points[:, 1] - 0.2 * points[:, 0]) < 0.06
    points[on_line, 3] = 200
    seen = _look(points)
    assert len(seen.strokes_m) > 40
    assert np.median(seen.direction_rad) == pytest.approx(np.arctan(0.2), abs=0.01)


def test_what_stands_on_the_road_is_no_paint() -> None:
    points = _road((-3.5,))
    bright = points.copy()
    bright[:, 1], bright[:, 2], bright[:, 3] = 2.0, 0.5, 250.0
    seen = _look(np.vstack([points, bright[:20_000]]))
    assert (np.abs(seen.strokes_m[:, 1] + 3.5) < 0.05).all()


def test_the_ground_follows_the_surface_that_is_given() -> None:
    points = _road((1.0,))
    points[:, 2] += 0.05 * points[:, 0]
    seen = _look(points, flat_ground().with_pitch(np.arctan(0.05)))
    assert len(seen.strokes_m) > 50
    np.testing.assert_allclose(seen.strokes_m[:, 2], 0.05 * seen.strokes_m[:, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("intensity", "why"),
    [
        (lambda count: np.full(count, 3.0), "hardly any values"),
        (lambda count: np.random.default_rng(1).uniform(9, 10, count), "the same all over"),
    ],
    ids=["constant", "flat"],
)
def test_intensity_that_tells_nothing_is_named_and_nothing_counts_as_seen(
    intensity: object, why: str
) -> None:
    points = _road((1.0,))
    assert callable(intensity)
    points[:, 3] = intensity(len(points))
    seen = _look(points)
    assert len(seen.strokes_m) == 0
    assert why in " ".join(seen.notes)
    assert not (seen.coverage.sights == Sight.SEEN).any()
    assert _sight(seen, 5, 0) == Sight.TOO_DARK


def test_few_points_are_named() -> None:
    seen = _look(_road((1.0,), count=500))
    assert "too few" in " ".join(seen.notes)
    assert not (seen.coverage.sights == Sight.SEEN).any()


def test_coverage_is_where_points_are_dense() -> None:
    points = _road((1.0,))
    sparse = points[:, 0] > 10
    thinned = np.vstack([points[~sparse], points[sparse][::60]])
    seen = _look(thinned[(thinned[:, 1] > -4)])
    assert _sight(seen, 5, 0) == Sight.SEEN
    assert _sight(seen, 5, -6) == Sight.OUT_OF_VIEW
    far = seen.coverage.sights[-20:, 30:]
    assert (far != Sight.SEEN).mean() > 0.9
    assert (seen.strokes_m[:, 0] < 11).all()


def test_points_without_intensity_are_refused() -> None:
    with pytest.raises(GeometryError, match=r"\(N, 4\)"):
        _look(np.zeros((10, 3)))


def test_that_only_lines_are_told_is_said() -> None:
    assert _look(_road((-3.5,))).lines_only
