"""Paint seen by the front camera of a small world against its map: changed, right, and shifted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from looks_at_road import RoadDrive

from percept.core.lane_markings import PaintObservation
from percept.core.map_findings import Discrepancy, Kind
from percept.datasets.synthetic.lanelet_map import StreetMap, write_map
from percept.evaluation.map_findings import (
    MapScores,
    PlacedFinding,
    planted_changes,
    score_findings,
)
from percept.hdmap import load_map
from percept.hdmap.validate import validate_lanes

SEED, SECONDS, NOISE, CHANGES = 3, 12.0, 1.0, 5
LIGHTS = (Kind.TRAFFIC_LIGHT_MISSING, Kind.TRAFFIC_LIGHT_MISSING_IN_MAP)


@pytest.fixture(scope="module")
def drive() -> RoadDrive:
    return RoadDrive.of(SEED, SECONDS, NOISE)


@pytest.fixture(scope="module")
def looks(drive: RoadDrive) -> list[PaintObservation]:
    return list(drive.looks())


def findings(
    street: StreetMap, drive: RoadDrive, looks: Sequence[PaintObservation], folder: Path
) -> tuple[Discrepancy, ...]:
    write_map(street, folder / "map.osm")
    found = validate_lanes(load_map(folder / "map.osm"), [("drive", drive.poses, looks)])
    return found.discrepancies


def scores(found: Sequence[Discrepancy], rows: list[object]) -> MapScores:
    placed = [_placed(finding) for finding in found]
    planted = [c for c in planted_changes(rows, "planted") if c.kind not in LIGHTS]
    return score_findings(placed, planted)


def _placed(finding: Discrepancy) -> PlacedFinding:
    points = finding.points_map if len(finding.points_map) else finding.points_expected_map
    x, y = points[:, :2].mean(axis=0).tolist()
    return PlacedFinding(
        finding_id=finding.finding_id,
        kind=finding.kind,
        map_element_id=finding.map_element_id,
        offset_m=finding.offset_m,
        middle_m=(x, y),
        points_m=points[:, :2],
    )


def test_planted_changes_are_found(
    drive: RoadDrive, looks: list[PaintObservation], tmp_path: Path
) -> None:
    _, street, planted = drive.maps(CHANGES)
    scored = scores(findings(street, drive, looks, tmp_path), [c.row() for c in planted])
    said = [one.summary() for one in (*scored.missed, *scored.false)]
    assert scored.total.planted >= 4
    assert not scored.false, said
    assert not scored.missed, said
    assert all(abs(error) < 0.15 for error in scored.total.offset_errors_m)


def test_a_map_that_is_right_gives_no_finding(
    drive: RoadDrive, looks: list[PaintObservation], tmp_path: Path
) -> None:
    street = drive.maps(0)[0]
    assert not findings(street, drive, looks, tmp_path)


def test_a_shifted_map_gives_one_global_offset(
    drive: RoadDrive, looks: list[PaintObservation], tmp_path: Path
) -> None:
    street = drive.maps(0)[0]
    street.nodes = {node: (x, y + 0.5, z) for node, (x, y, z) in street.nodes.items()}
    found = findings(street, drive, looks, tmp_path)
    assert [finding.kind for finding in found] == [Kind.GLOBAL_OFFSET]
    assert found[0].offset_m == pytest.approx(0.5, abs=0.05)
    assert np.isfinite(found[0].sd_m)
