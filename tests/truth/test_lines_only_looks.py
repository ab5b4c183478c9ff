"""Looks that tell lines and nothing else, as those of LiDARs do, against maps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_paint import MEDIUM, World, drive, made_world
from paint_changes import changed, kinds

from percept.core.lane_markings import PaintObservation
from percept.core.map_findings import Kind
from percept.core.trajectory import Trajectory
from percept.hdmap.validate import Validation, validate_lanes

_TOLD = {Kind.MISSING_ON_ROAD, Kind.MISSING_IN_MAP, Kind.MOVED}


def _as_lidar(look: PaintObservation) -> PaintObservation:
    """Return what a LiDAR would show of the same: no bar, no colour, of a pair one line."""
    first = np.ones(len(look.strokes_m), dtype=bool)
    apart = np.linalg.norm(look.strokes_m[:, None, :2] - look.strokes_m[None, :, :2], axis=2)
    first[np.unique(np.nonzero(np.triu(apart < 0.4, 1))[1])] = False
    return replace(
        look,
        sensor="lidars",
        strokes_m=look.strokes_m[first],
        direction_rad=look.direction_rad[first],
        width_m=look.width_m[first],
        sd_m=look.sd_m[first],
        yellow=np.full(int(first.sum()), np.nan),
        strength=look.strength[first],
        bars_m=np.zeros((0, 2, 2)),
        bar_width_m=np.zeros(0),
        bar_sd_m=np.zeros(0),
        lines_only=True,
    )


def _validated(world: World, poses: Trajectory, looks: list[PaintObservation]) -> Validation:
    return validate_lanes(world, [("drive", poses, looks)])


@pytest.fixture(scope="module")
def world() -> World:
    return changed(made_world(480.0), 0, 13)[0]


def test_lines_only_says_nothing_of_bars_pairs_and_colours(world: World) -> None:
    poses, looks = drive(world, MEDIUM, 0)
    found = _validated(world, poses, [_as_lidar(look) for look in looks]).discrepancies
    assert {finding.kind for finding in found} == _TOLD | {Kind.TYPE}
    types = {finding.observed.split()[0] for finding in found if finding.kind is Kind.TYPE}
    assert types == {"dashed"}


def test_beside_images_they_take_nothing_away_and_pictures_are_of_images(world: World) -> None:
    poses, looks = drive(world, MEDIUM, 0)
    seen = list(looks)
    alone = _validated(world, poses, seen)
    both = [one for look in seen for one in (look, _as_lidar(look))]
    together = _validated(world, poses, both)
    assert set(kinds(alone)) <= set(kinds(together))
    sensors = {look.sensor for finding in together.discrepancies for look in finding.looks[:1]}
    assert "lidars" not in sensors
