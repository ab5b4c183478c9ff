"""Findings as a table, as GeoJSON and as pictures."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.geodesy import LocalFrame
from percept.core.lane_markings import GroundCoverage, PaintObservation
from percept.core.map_findings import Discrepancy, Kind, Look, Status
from percept.core.rig import CameraSensor
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform, rotation_from_rpy
from percept.export.coverage_table import COVERAGE, coverage_rows, offset_rows
from percept.export.discrepancy_geojson import write_discrepancies_geojson
from percept.export.discrepancy_table import (
    DISCREPANCIES,
    degrees_of,
    discrepancy_rows,
    read_discrepancies,
)
from percept.export.map_evidence import (
    EXPECTED_RGB,
    OBSERVED_RGB,
    EvidenceLook,
    evidence_of_look,
)
from percept.export.map_lines import write_map_lines
from percept.export.tables import write_parquet
from percept.export.view.map import MapView
from percept.hdmap.elements import MapMarking
from percept.hdmap.road_heights import RoadHeights
from percept.hdmap.validate import ElementCoverage, StretchOffset

_FRAME = LocalFrame(43.78, -79.46, 160.0)
_R_BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def _geodetic(points_map: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([_FRAME.geodetic(point) for point in points_map]).reshape(-1, 3)


def _finding(observed: str = "seen 0.6 m to the left", **others: object) -> Discrepancy:
    values: dict[str, object] = {
        "finding_id": "moved-12-0",
        "kind": Kind.MOVED,
        "map_element_id": 12,
        "along_m": 0.0,
        "offset_m": 0.6,
        "length_m": 20.0,
        "sd_m": 0.03,
        "observations": 14,
        "visits": 1,
        "confidence": 0.97,
        "expected": "white solid",
        "observed": observed,
        "points_map": np.array([[5.0, 2.3, 0.0], [25.0, 2.3, 0.0]]),
        "points_expected_map": np.array([[5.0, 1.7, 0.0], [25.0, 1.7, 0.0]]),
        "looks": (Look(0, "cam", 5, 6.0),),
        **others,
    }
    return Discrepancy(**values)  # type: ignore[arg-type] # a table of fields


def test_the_table_reads_back_what_was_written(tmp_path: Path) -> None:
    lost = _finding(
        finding_id="missing-9", kind=Kind.MISSING_ON_ROAD, offset_m=np.nan, sd_m=np.nan, looks=()
    )
    findings = [_finding(), lost]
    rows = discrepancy_rows(findings, {"moved-12-0": "evidence/0001.png"}, None)
    path = tmp_path / "discrepancies.parquet"
    assert write_parquet(path, DISCREPANCIES, [rows]) == 2
    moved, missing = read_discrepancies(path)
    assert (moved.kind, moved.map_element_id, moved.offset_m) == (Kind.MOVED, 12, 0.6)
    assert (moved.x_m, moved.y_m) == (15.0, 2.3)
    assert np.isnan(missing.offset_m)
    assert missing.status is Status.OPEN
    np.testing.assert_allclose(moved.points_m, [[5.0, 2.3], [25.0, 2.3]])
    assert rows.column("evidence").to_pylist() == ["evidence/0001.png", ""]
    assert rows.column("latitude").null_count == 2


def test_a_foreign_table_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "discrepancies.parquet"
    path.write_bytes(b"PAR1 or not")
    with pytest.raises(InputError, match="cannot be read as Parquet"):
        read_discrepancies(path)


def test_middles_lie_where_the_frame_says() -> None:
    degrees = degrees_of([_finding()], _geodetic)
    assert degrees is not None
    np.testing.assert_allclose(
        degrees[0], _FRAME.geodetic(np.array([15.0, 2.3, 0.0]))[:2], atol=1e-12
    )


def test_geojson_has_longitude_first_and_keeps_text_as_text(tmp_path: Path) -> None:
    path = tmp_path / "discrepancies.geojson"
    write_discrepancies_geojson(path, [_finding("<script>alert(1)</script>")], {}, _geodetic)
    collection = json.loads(path.read_text())
    (feature,) = collection["features"]
    assert collection["type"] == "FeatureCollection"
    assert feature["geometry"]["type"] == "LineString"
    longitude, latitude = feature["geometry"]["coordinates"][0]
    assert (round(longitude, 2), round(latitude, 2)) == (-79.46, 43.78)
    assert feature["properties"]["observed"] == "<script>alert(1)</script>"


def test_geojson_without_a_place_on_earth_has_no_geometry(tmp_path: Path) -> None:
    path = tmp_path / "discrepancies.geojson"
    write_discrepancies_geojson(path, [_finding(offset_m=np.nan)], {}, None)
    (feature,) = json.loads(path.read_text())["features"]
    assert feature["geometry"] is None
    assert feature["properties"]["offset_m"] is None
    assert feature["properties"]["points_m"][0] == [5.0, 2.3, 0.0]


def _camera() -> CameraSensor:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(0.0, 0.05, 0.0) @ _R_BODY_OPTICAL
    matrix[:3, 3] = 1.5, 0.0, 1.6
    return CameraSensor(
        "cam", "/cam", "cam", (640, 400), "pinhole", (420, 420, 319.5, 199.5), (0.0,) * 5,
        Transform("base_link", "cam", matrix),
    )  # fmt: skip


def _look() -> EvidenceLook:
    def flat(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.zeros(len(points_m))

    return EvidenceLook(_camera(), Transform.identity("map", "base_link"), flat)


def _marking(points: list[list[float]], element_id: int = 1) -> MapMarking:
    return MapMarking(
        element_id=element_id, kind="line", points_map=np.array(points), type="solid",
        colour="white", painted=True, width_m=0.15, name=f"way {element_id}",
    )  # fmt: skip


@pytest.mark.parametrize("map_height", [0.0, 130.0])
def test_evidence_shows_map_and_paint_whatever_the_heights_of_the_map(map_height: float) -> None:
    image = np.full((400, 640, 3), 90, np.uint8)
    marking = _marking([[-10.0, -1.7, map_height], [40.0, -1.7, map_height]])
    finding = _finding(
        points_map=np.array([[5.0, 2.3, map_height], [25.0, 2.3, map_height]]),
        points_expected_map=np.array([[5.0, 1.7, map_height], [25.0, 1.7, map_height]]),
    )
    picture = evidence_of_look(finding, image, _look(), [marking])
    assert picture is not None
    assert picture.shape[1] == 2 * 640 + 6
    body = picture[60:]
    for half in (body[:, :640], body[:, 646:]):
        for colour in (OBSERVED_RGB, EXPECTED_RGB):
            near = np.abs(half.astype(int) - colour[::-1]).max(axis=2) < 40
            assert near.sum() > 30


def test_what_lies_behind_the_camera_has_no_picture() -> None:
    behind = _finding(
        points_map=np.array([[-30.0, 0.0, 0.0], [-20.0, 0.0, 0.0]]),
        points_expected_map=np.zeros((0, 3)),
    )
    image = np.zeros((400, 640, 3), np.uint8)
    assert evidence_of_look(behind, image, _look(), []) is None


def _shows(picture: NDArray[np.uint8] | None, colour: tuple[int, int, int]) -> NDArray[np.bool_]:
    """Where the part of a picture that the camera saw has a colour."""
    assert picture is not None
    near: NDArray[np.bool_] = np.abs(picture[60:, :640].astype(int) - colour[::-1]).max(axis=2) < 40
    return near


def test_what_was_not_seen_is_not_drawn_as_seen() -> None:
    image = np.full((400, 640, 3), 90, np.uint8)
    line = np.array([[5.0, 1.7, 0.0], [25.0, 1.7, 0.0]])
    missing = _finding(
        kind=Kind.MISSING_ON_ROAD, points_map=line, points_expected_map=line, offset_m=np.nan
    )
    picture = evidence_of_look(missing, image, _look(), [])
    assert _shows(picture, EXPECTED_RGB).sum() > 30
    assert not _shows(picture, OBSERVED_RGB).any()


def test_evidence_brings_the_map_to_the_paint_by_the_shift_of_the_stretch() -> None:
    camera = _camera()
    assert camera.T_base_sensor is not None
    paint = np.array([[5.0, 0.5, 0.0], [25.0, 0.5, 0.0]])
    pixels, _ = camera.camera().project(camera.T_base_sensor.inverse().apply(paint))
    image = np.full((400, 640, 3), 90, np.uint8)
    first, last = np.rint(pixels).astype(int).tolist()
    cv2.line(image, first, last, (255, 255, 255), 1)
    line = np.array([[5.0, 0.0, 0.0], [25.0, 0.0, 0.0]])  # where the map has that paint
    finding = _finding(kind=Kind.MISSING_ON_ROAD, points_map=line, points_expected_map=line)
    left = []
    for look in (_look(), _look()._replace(lateral_m=0.5)):
        picture = evidence_of_look(finding, image, look, [])
        assert picture is not None
        left.append(int((picture[60:, :640].min(axis=2) > 200).sum()))
    assert left[0] > 50
    assert left[1] < 0.3 * left[0]  # the line of the map hides it


def test_type_findings_leave_their_paint_to_be_seen() -> None:
    image = np.full((400, 640, 3), 90, np.uint8)
    line = np.array([[5.0, 0.0, 0.0], [25.0, 0.0, 0.0]])
    wrong = _finding(kind=Kind.TYPE, points_map=line, points_expected_map=line, offset_m=np.nan)
    row = _shows(evidence_of_look(wrong, image, _look(), []), OBSERVED_RGB)[-60]
    columns = np.flatnonzero(row)
    assert columns.min() < 310
    assert columns.max() > 330
    assert not row[316:324].any()


@pytest.mark.parametrize("over_m", [0.5, 37.0, -160.0])
def test_poses_are_brought_to_the_heights_of_the_map(over_m: float) -> None:
    line = np.array([[0.0, 2.0, 5.0], [100.0, 2.0, 15.0]])
    matrices = np.tile(np.eye(4), (50, 1, 1))
    matrices[:, 0, 3] = np.arange(50)
    matrices[:, 2, 3] = 5.0 + 0.1 * np.arange(50) + over_m
    poses = Trajectory("map", "base_link", np.arange(50, dtype=np.int64), matrices)
    levelled, lift_m = RoadHeights([line]).levelled(poses)
    kept = abs(over_m) < 3
    assert lift_m == pytest.approx(0.0 if kept else -over_m, abs=0.1)
    assert levelled.matrices[7, 2, 3] == pytest.approx(5.7 + (over_m if kept else 0.0), abs=0.1)
    assert poses.matrices[7, 2, 3] == pytest.approx(5.7 + over_m)


def test_lights_without_heights_do_not_hang() -> None:
    heights = RoadHeights([np.array([[0.0, 0.0, 5.0], [100.0, 0.0, 5.0]])])
    high, low = np.array([[10.0, 3.0, 10.0]]), np.array([[20.0, 3.0, 5.0]])
    assert heights.hang([high, low]) == 1
    assert RoadHeights([]).hang([low]) == 1


def test_coverage_and_offsets_are_tables() -> None:
    stretch = ElementCoverage(
        map_element_id=7, along_m=0.0, length_m=10.0, observed_share=0.5, visits=1, reason="too far"
    )
    rows = coverage_rows([stretch])
    assert rows.schema.equals(COVERAGE)
    assert rows.to_pylist() == [dataclasses.asdict(stretch)]
    offset = StretchOffset(
        drive=0, along_m=1.0, x_m=2.0, y_m=3.0, yaw_rad=0.1, lateral_m=0.2, heading_rad=0.0,
        sd_m=0.05, lines=2.5, ambiguous=True,
    )  # fmt: skip
    assert offset_rows([offset]).to_pylist() == [dataclasses.asdict(offset)]
    assert coverage_rows([]).num_rows == offset_rows([]).num_rows == 0


def test_a_long_view_draws_some_looks_and_says_so(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 255, (100, 160, 3), dtype=np.uint8)
    place = np.array([500_000.0, 4_800_000.0, 100.0])
    paint = PaintObservation(
        stamp_ns=1, sensor="cam", frame_id="base_link", strokes_m=np.zeros((0, 3)),
        direction_rad=np.zeros(0), width_m=np.zeros(0), sd_m=np.zeros(0), yellow=np.zeros(0),
        strength=np.zeros(0), step_m=0.5,
        coverage=GroundCoverage((0.0, 0.0), 1.0, np.zeros((1, 1), np.uint8)),
    )  # fmt: skip
    with MapView(
        tmp_path / "view.rrd", run_id="run", cameras=["cam"], looks_expected=40,
        about_m=place, budget_bytes=50_000,
    ) as view:  # fmt: skip
        view.add_map([_marking([[0, 2, 0], [30, 2, 0]])])
        for stamp in range(40):
            here = Transform.identity("map", "base_link")
            view.add_look(1_000_000 * stamp, "cam", image, here, paint)
        view.add_findings([_finding()])
        looks, moved = view.notes
    size = (tmp_path / "view.rrd").stat().st_size
    assert size < 150_000
    assert "of 40 looks" in looks
    assert "(-500000, -4800000, +0) m" in moved


def test_a_view_that_fails_leaves_no_file(tmp_path: Path) -> None:
    with (
        pytest.raises(ValueError, match="stop"),
        MapView(tmp_path / "view.rrd", run_id="run", cameras=["cam"]),
    ):
        raise ValueError("stop")
    assert not list(tmp_path.iterdir())


def test_map_lines_hold_what_is_near_the_way(tmp_path: Path) -> None:
    stamps = np.arange(50, dtype=np.int64)
    matrices = np.tile(np.eye(4), (50, 1, 1))
    matrices[:, 0, 3] = np.arange(50)
    way = Trajectory("map", "base_link", stamps, matrices)
    lines = [_marking([[0, 2, 0], [30, 2, 0]], 1), _marking([[5000, 2, 0], [5030, 2, 0]], 2)]
    path = tmp_path / "map_lines.json"
    write_map_lines(path, lines, [way])
    content = json.loads(path.read_text())
    assert [line["id"] for line in content["lines"]] == [1]
    assert content["paths"][0]["points"][-1] == [49.0, 0.0]
    assert way.length_m == pytest.approx(49.0)
