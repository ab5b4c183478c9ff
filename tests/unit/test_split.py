"""Which part of a set a place belongs to: a margin between parts, and the same for ever."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from percept.core.errors import GeometryError, UsageError
from percept.core.geodesy import LocalFrame
from percept.core.settings import parse_settings
from percept.datasets.labelling.labelled_set import SPLITS
from percept.datasets.labelling.places.distances import nearest_across
from percept.datasets.labelling.places.split import Assignment, SplitConfig, assign_splits

_F = NDArray[np.float64]

_EARTH_M = 6371008.8
_M_PER_DEGREE = math.pi / 180 * _EARTH_M
_WRITTEN = "arrrarrarerrerarrerrrrra"  # second letters: tRain, vAl, tEst
_DRIVES = "rrrrrrrrerrr"
_MARGINS_M = (0.0, 1.0, 20.0, 100.0, 5000.0)
_ANYWHERE = st.tuples(
    st.one_of(st.sampled_from([-90.0, -89.9995, 0.0, 89.9995, 90.0]), st.floats(-90, 90)),
    st.one_of(st.sampled_from([-180.0, 0.0, 179.9999, 180.0]), st.floats(-180, 180)),
)


def _around(latitude: float, longitude: float, reach_m: float, seed: int, count: int = 300) -> _F:
    """Return places (N, 2) in degrees about one, also beyond the pole and the date line."""
    random = np.random.default_rng(seed)
    frame = LocalFrame(latitude, longitude, 0.0)
    flat = random.uniform(-reach_m, reach_m, (count, 2))
    # Down to the ground, so that far places keep their distances.
    down = -(flat**2).sum(axis=1, keepdims=True) / (2 * _EARTH_M)
    return frame.geodetics(np.hstack([flat, down]))[:, :2]


def _haversine_m(one: _F, other: _F) -> _F:
    a, b = np.radians(one)[:, None], np.radians(other)[None]
    half = np.sin((a - b) / 2) ** 2
    share = half[..., 0] + np.cos(a[..., 0]) * np.cos(b[..., 0]) * half[..., 1]
    return np.asarray(2 * _EARTH_M * np.arcsin(np.sqrt(np.minimum(share, 1.0))))


def _local_m(one: _F, other: _F) -> _F:
    """Return distances in a plane that touches the ellipsoid at the first place."""
    frame = LocalFrame(float(one[0, 0]), float(one[0, 1]), 0.0)
    a, b = (frame.local(np.column_stack([p, np.zeros(len(p))]))[:, :2] for p in (one, other))
    return np.asarray(np.linalg.norm(a[:, None] - b[None], axis=2))


def _splits(places: _F, config: SplitConfig) -> list[Any]:
    found = assign_splits(places[:, 0], places[:, 1], ["drive"] * len(places), config)
    return [one.split for one in found]


def _least_m(places: _F, splits: Sequence[Any]) -> float:
    """Return the least of all measures between places of different parts."""
    names = np.array(splits, dtype=object)
    held = [places[names == split] for split in SPLITS]
    least = [math.inf]
    for one, other in combinations([part for part in held if len(part)], 2):
        least += [float(_haversine_m(one, other).min()), float(_local_m(one, other).min())]
    measured = nearest_across(places[:, 0], places[:, 1], ["" if s is None else s for s in splits])
    return min([*least, *(float(found.distances_m.min()) for found in measured)])


@given(
    place=_ANYWHERE,
    margin_m=st.sampled_from(_MARGINS_M),
    tight=st.booleans(),
    seed=st.integers(0, 2**63 - 1),
)
@example(place=(90.0, 0.0), margin_m=100.0, tight=True, seed=0)
@example(place=(-90.0, 12.0), margin_m=5000.0, tight=True, seed=1)
@example(place=(0.0, 180.0), margin_m=20.0, tight=True, seed=2)
@example(place=(48.2, 16.37), margin_m=1.0, tight=False, seed=3)
def test_places_of_different_parts_are_a_margin_apart(
    place: tuple[float, float], margin_m: float, seed: int, *, tight: bool
) -> None:
    cell_m = max(2 * margin_m, 1.0) if tight else None
    config = SplitConfig(margin_m=margin_m, cell_m=cell_m, seed=seed)
    places = _around(*place, reach_m=2 * config.side_m, seed=seed % 1000)
    assert _least_m(places, _splits(places, config)) >= margin_m


@pytest.mark.parametrize("latitude", [-90.0, 90.0])
@pytest.mark.parametrize("seed", range(4))
def test_the_poles_are_places_as_others(latitude: float, seed: int) -> None:
    """Where columns are few and a step to the east goes far, with places close together."""
    config = SplitConfig(margin_m=100.0, cell_m=200.0, seed=seed)
    places = _around(latitude, 0.0, reach_m=700.0, seed=seed, count=20_000)
    splits = ["" if split is None else split for split in _splits(places, config)]
    least = [
        found.distances_m.min() for found in nearest_across(places[:, 0], places[:, 1], splits)
    ]
    assert 100.0 <= min(least) < 110.0


def test_places_just_beyond_the_margin_are_kept() -> None:
    """The rule is no wider than it has to be: kept places of two parts come near the margin."""
    config = SplitConfig(margin_m=20.0)
    places = _around(48.2, 16.37, reach_m=300.0, seed=1, count=3000)
    splits = _splits(places, config)
    assert 20.0 <= _least_m(places, splits) < 23.0
    assert 0.6 < sum(split is not None for split in splits) / len(splits) < 0.9


def test_without_a_margin_nothing_is_left_out() -> None:
    places = _around(48.2, 16.37, reach_m=3000.0, seed=2)
    splits = _splits(places, SplitConfig(margin_m=0.0))
    assert set(splits) == set(SPLITS)


@given(
    place=_ANYWHERE,
    others=st.lists(_ANYWHERE, max_size=5),
    turns=st.integers(-2, 2),
    margin_m=st.sampled_from(_MARGINS_M),
)
def test_what_is_added_changes_nothing(
    place: tuple[float, float],
    others: list[tuple[float, float]],
    turns: int,
    margin_m: float,
) -> None:
    config = SplitConfig(margin_m=margin_m)
    old = _around(*place, reach_m=1000.0, seed=3, count=20)
    before = assign_splits(old[:, 0], old[:, 1], ["old"] * 20, config)
    new = np.vstack([*(_around(*other, 1000.0, 4, 20) for other in others), old])
    drives = [f"new {number // 20}" for number in range(len(new) - 20)] + ["old"] * 20
    after = assign_splits(new[:, 0], new[:, 1], drives, config)
    assert after[-20:] == before
    # The other way of saying where it is, to within rounding: no place is at the very border.
    turned = assign_splits(old[:, 0], old[:, 1] + 360.0 * turns, ["old"] * 20, config)
    assert turned == before


def test_the_parts_stay_what_they_were_when_this_was_written() -> None:
    """A data set lives for years: the grid and its hash may never change."""
    latitude = np.linspace(-89.0, 89.0, 24)
    longitude = np.linspace(-180.0, 180.0, 24)
    found = assign_splits(latitude, longitude, ["drive"] * 24, SplitConfig(margin_m=0.0))
    assert "".join("?" if one.split is None else one.split[1] for one in found) == _WRITTEN
    unplaced = assign_splits([math.nan] * 12, [math.nan] * 12, [f"{n:064x}" for n in range(12)])
    assert "".join("?" if one.split is None else one.split[1] for one in unplaced) == _DRIVES


@pytest.mark.parametrize("ratios", [(0.7, 0.15, 0.15), (0.5, 0.5, 0.0), (0.0, 0.1, 0.9)])
def test_shares_of_many_places_are_near_the_ratios(ratios: tuple[float, float, float]) -> None:
    train, val, test = ratios
    config = SplitConfig(train=train, val=val, test=test, margin_m=0.0)
    random = np.random.default_rng(5)
    count = 20_000  # each in a cell of its own
    latitude = np.degrees(np.arcsin(random.uniform(-1, 1, count)))
    found = assign_splits(latitude, random.uniform(-180, 180, count), ["d"] * count, config)
    for split, ratio in zip(SPLITS, ratios, strict=True):
        share = sum(one.split == split for one in found) / count
        assert share == pytest.approx(ratio, abs=4 * math.sqrt(0.25 / count))
        assert (share == 0) == (ratio == 0)


def test_neighbouring_cells_have_nothing_to_do_with_each_other() -> None:
    """A hash that goes by rows would give a whole street to one part."""
    config = SplitConfig(margin_m=0.0)
    steps = np.arange(4000) * config.side_m / _M_PER_DEGREE
    for latitude, longitude in ((steps, 0 * steps), (0 * steps, steps)):
        splits = _splits(np.column_stack([latitude, longitude]), config)
        same = sum(a == b for a, b in pairwise(splits)) / 3999
        assert same == pytest.approx(0.7**2 + 2 * 0.15**2, abs=0.04)


def test_another_seed_splits_in_another_way() -> None:
    places = _around(48.2, 16.37, reach_m=20_000.0, seed=6)
    one, other = (_splits(places, SplitConfig(margin_m=0.0, seed=seed)) for seed in (0, 1))
    assert one != other


def test_a_street_along_the_border_of_cells_has_one_part_on_both_sides() -> None:
    """What is kept of it lies between cells of one part; all else is within the margin."""
    config = SplitConfig(margin_m=20.0)
    # The meridian of Greenwich is a border of columns in each row.
    latitude = np.arange(0.0, 30_000.0, 5.0) / _M_PER_DEGREE + 10.0
    weave_deg = np.tile([-4.0, 4.0], len(latitude) // 2) / _M_PER_DEGREE
    places = np.column_stack([latitude, weave_deg])
    splits = _splits(places, config)
    assert _least_m(places[::3], splits[::3]) >= 20.0
    kept = [(a, b) for a, b in pairwise(splits) if a is not None and b]
    assert kept
    assert all(a == b for a, b in kept)
    by_side = [
        _splits(np.column_stack([latitude, side + 0 * latitude]), SplitConfig(margin_m=0.0))
        for side in (-4.0 / _M_PER_DEGREE, 4.0 / _M_PER_DEGREE)
    ]
    differ = np.array([a != b for a, b in zip(*by_side, strict=True)])
    assert 0.3 < differ.mean() < 0.6
    assert all(split is None for split, is_other in zip(splits, differ, strict=True) if is_other)


def test_drives_without_a_place_stay_whole_and_others_lose_what_has_none() -> None:
    nan = math.nan
    drives = ["placed"] * 3 + ["lost"] * 3 + ["half"] * 2
    latitude = [48.2, nan, 48.2, nan, nan, 48.0, nan, 91.0]
    longitude = [16.3, 16.3, nan, nan, 16.0, nan, nan, 0.0]
    found = assign_splits(latitude, longitude, drives, SplitConfig(margin_m=0.0))
    assert [one.reason for one in found] == [
        "place", "place_unknown", "place_unknown", "drive", "drive", "drive", "drive", "drive",
    ]  # fmt: skip
    assert found[1] == Assignment(None, "place_unknown")
    assert len({one.split for one in found[3:6]}) == 1
    many = [f"drive {number}" for number in range(2000)]
    alone = assign_splits([nan] * 2000, [nan] * 2000, many)
    share = sum(one.split == "train" for one in alone) / 2000
    assert share == pytest.approx(0.7, abs=0.04)


def test_no_places_are_no_error_and_wrong_lengths_are() -> None:
    assert assign_splits([], [], []) == ()
    with pytest.raises(GeometryError, match="as many latitudes"):
        assign_splits([1.0], [1.0, 2.0], ["a"])
    with pytest.raises(GeometryError, match="as many latitudes"):
        assign_splits([[1.0]], [[1.0]], ["a"])


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"train": 0.9}, "add up to 1"),
        ({"margin_m": 80.0, "cell_m": 100.0}, "twice margin_m"),
        ({"margin_m": -1.0}, "margin_m"),
        ({"margin_m": math.inf}, "margin_m"),
        ({"cell_m": 0.0}, "cell_m"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings: dict[str, float], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        parse_settings(SplitConfig, settings, "split")
