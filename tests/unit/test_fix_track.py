"""Places of moments between fixes that a receiver says, right or wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.geodesy import LocalFrame
from percept.core.samples import GnssFix
from percept.datasets.labelling.places.positions import FixTrack

_SECOND = 1_000_000_000
_START = 1_700_000_000 * _SECOND


def _fixes(count: int = 30, longitude: float = 16.37, speed: float = 15.0) -> list[GnssFix]:
    """Fixes once a second on a way to the east."""
    frame = LocalFrame(48.2, longitude, 0.0)
    fixes = []
    for number in range(count):
        latitude, east, _ = frame.geodetic(np.array([speed * number, 0.0, 0.0]))
        at_ns = _START + number * _SECOND
        fixes.append(
            GnssFix(
                topic="/gnss", stamp_ns=at_ns, log_time_ns=at_ns, frame="gnss",
                latitude_deg=float(latitude), longitude_deg=float(east), altitude_m=0.0,
            )
        )  # fmt: skip
    return fixes


def _moments(count: int = 30) -> NDArray[np.int64]:
    return np.arange(0, 10 * (count - 1)) * (_SECOND // 10) + _START


@pytest.mark.parametrize(
    "spoil",
    [
        lambda fix: replace(fix, latitude_deg=0.0, longitude_deg=0.0),
        lambda fix: replace(fix, latitude_deg=1e-7, longitude_deg=-1e-7),
        lambda fix: replace(fix, latitude_deg=fix.latitude_deg + 0.3),
        lambda fix: replace(fix, latitude_deg=float("nan")),
        lambda fix: replace(fix, status=-1),
    ],
)
def test_a_wrong_fix_is_no_fix(spoil: Callable[[GnssFix], GnssFix]) -> None:
    fixes = _fixes()
    wrong = [0, 7, 8, 20, 29]
    spoilt = [spoil(fix) if n in wrong else fix for n, fix in enumerate(fixes)]
    moments = _moments()[10:-10]
    expected, found = FixTrack(fixes).at(moments), FixTrack(spoilt)
    assert found.dropped == len(wrong)
    for at, where in zip(found.at(moments), expected, strict=True):
        np.testing.assert_allclose(at, where, atol=1e-9)


def test_between_places_that_no_car_drives_between_nothing_is_known() -> None:
    """A receiver that goes on somewhere else for good: nobody knows when it was right."""
    fixes = [
        replace(fix, latitude_deg=fix.latitude_deg + (0.1 if number >= 15 else 0.0))
        for number, fix in enumerate(_fixes())
    ]
    track = FixTrack(fixes)
    latitudes, _ = track.at(_moments())
    known = np.isfinite(latitudes)
    assert not known[141:150].any()
    assert known[:141].all()
    assert known[150:].all()
    way = track.trajectory()
    assert way is not None
    _, poses_known = way.poses_at(_moments()[141:150])
    assert not poses_known.any()


def test_a_bend_and_a_fast_car_are_no_jumps() -> None:
    fixes = _fixes(speed=60.0)
    turned = [
        replace(fix, latitude_deg=fix.latitude_deg + max(0, n - 15) * 60 / 111_000)
        for n, fix in enumerate(fixes)
    ]
    assert FixTrack(fixes).dropped == FixTrack(turned).dropped == 0
    assert np.isfinite(FixTrack(turned).at(_moments())[0]).all()


def test_a_gap_is_not_filled() -> None:
    track = FixTrack([fix for n, fix in enumerate(_fixes()) if not 10 < n < 20])
    known = np.isfinite(track.at(_moments())[0])
    assert not known[101:200].any()
    assert known[:101].all()
    assert known[200:].all()


def test_180_degrees_are_crossed() -> None:
    track = FixTrack(
        [replace(f, longitude_deg=(f.longitude_deg + 180) % 360 - 180) for f in _fixes(30, 179.998)]
    )
    assert track.dropped == 0
    _, longitudes = track.at(_moments())
    assert longitudes.max() > 179.99
    assert longitudes.min() < -179.99
    assert (np.abs(longitudes) > 179.99).all()
    way = track.trajectory()
    assert way is not None
    places, known = way.poses_at(_moments()[[0, -1]])
    assert known.all()
    assert np.linalg.norm(places[1, :3, 3] - places[0, :3, 3]) == pytest.approx(433.5, abs=2)


def test_without_stamps_the_times_of_recording_count() -> None:
    fixes = _fixes()
    for stamp_ns in (0, 77):
        track = FixTrack(replace(fix, stamp_ns=stamp_ns) for fix in fixes)
        np.testing.assert_array_equal(track.at(_moments()), FixTrack(fixes).at(_moments()))


def test_no_fix_is_no_place() -> None:
    track = FixTrack(())
    assert (len(track), track.trajectory()) == (0, None)
    assert np.isnan(track.at([_START])[0]).all()
    assert len(FixTrack(_fixes(1)).at([_START])[0]) == 1
