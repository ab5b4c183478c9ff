"""The report of `percept calib camera-lidar`: does the cloud lie where the image says."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from percept.calib.camera_lidar.result import CameraLidarCalibration, Estimate, PairResult
from percept.calib.camera_lidar.spread import Split
from percept.core.rig import CameraSensor, LidarSensor
from percept.core.transform import Transform
from percept.export.calibration.camera_lidar_album import CameraLidarAlbum, ShownPair, moved
from percept.export.calibration.camera_lidar_pictures import boards_in_space, plate_outline
from percept.export.calibration.view import write_calibration_view
from percept.export.detection_report import installed_versions
from percept.export.pictures import png_data_uri
from percept.export.report import Block, Paragraph, Picture, ReportContent, Section, Table

__all__ = ["ShownPair", "camera_lidar_report", "write_camera_lidar_view"]

_F64 = NDArray[np.float64]

_RANGES_M = (10, 30, 50)


def camera_lidar_report(
    result: CameraLidarCalibration,
    shown: Sequence[ShownPair],
    camera: CameraSensor,
    lidar: LidarSensor,
    plate_size_m: tuple[float, float],
    *,
    inputs: Sequence[Mapping[str, object]],
    settings: Mapping[str, object],
    notes: Sequence[str] = (),
) -> ReportContent:
    """Return the report of a calibration of a camera and a LiDAR.

    Args:
        result: What was found.
        shown: The pairs, as many as the result has.
        camera: The camera, with its intrinsics.
        lidar: The LiDAR.
        plate_size_m: Width and height of the plate.
        inputs: The files of `run.json`: `path`, `bytes` and what else is known of them.
        settings: The resolved configuration.
        notes: What else should be known, such as where the intrinsics come from.
    """
    album = CameraLidarAlbum(result, shown, camera, plate_size_m)
    sections = (
        Section("The cloud in the image", tuple(album.whole_images())),
        Section("Each board under its points", tuple(album.close_ups())),
        Section("Where the boards stood", tuple(_space(result, camera, plate_size_m))),
        Section("What the uncertainty means", tuple(_meaning(result, camera))),
        Section("The transform, both ways", tuple(_transform(result, camera, lidar))),
        Section("Tests that the result went through", (_tests(result),)),
        Section("Pairs", (_pairs(result),)),
        Section("Board detections", tuple(album.detections())),
        Section("Inputs", (_inputs(inputs), *(Paragraph(note) for note in notes))),
        Section("Settings and versions", (_named(settings), _named(dict(installed_versions())))),
        Section("Residuals", (_rms(result),)),
    )
    used = sum(pair.used for pair in result.pairs)
    return ReportContent(
        title=f"Camera {camera.name} and LiDAR {lidar.name}",
        verdict=result.verdict,
        why=result.why,
        advice=result.advice,
        sections=tuple(s for s in sections if s.blocks),
        subtitle=f"{used} of {len(result.pairs)} pairs used; {settings.get('board', '')}",
    )


def write_camera_lidar_view(
    path: Path,
    result: CameraLidarCalibration,
    shown: Sequence[ShownPair],
    camera: CameraSensor,
    lidar: LidarSensor,
    *,
    plate_size_m: tuple[float, float],
) -> None:
    """Write `view.rrd`: a cloud, the image of the same pair, and all boards, in the LiDAR's frame.

    Args:
        path: The file.
        result: What was found.
        shown: The pairs.
        camera: The camera.
        lidar: The LiDAR.
        plate_size_m: Width and height of the plate.
    """
    first = next((k for k, pair in enumerate(result.pairs) if pair.used), 0)
    clouds = {lidar.name: shown[first].points} if shown else {}
    T = result.T_camera_lidar
    if T is None or not shown:
        write_calibration_view(path, clouds=clouds)
        return
    T_lidar_camera = Transform(camera.frame, lidar.frame, T).inverse()
    outline = plate_outline(plate_size_m)
    boards = {
        pair.name: T_lidar_camera.apply(moved(outline, pair.T_camera_plate))
        for pair in result.pairs
        if pair.used and pair.T_camera_plate is not None
    }
    write_calibration_view(
        path,
        clouds=clouds,
        images={camera.name: shown[first].read_image()},
        cameras={camera.name: (camera.camera(), T_lidar_camera)},
        boards=boards,
    )


def _space(
    result: CameraLidarCalibration, camera: CameraSensor, plate_size_m: tuple[float, float]
) -> Iterator[Block]:
    placed = [p for p in result.pairs if p.T_camera_plate is not None]
    if not placed or result.spread is None:
        return
    poses = [np.asarray(p.T_camera_plate) for p in placed]
    used = [p.used for p in placed]
    views: tuple[Literal["above", "side"], ...] = ("above", "side")
    for seen_from in views:
        word = "from above" if seen_from == "above" else "from the side"
        picture = boards_in_space(
            poses, used, plate_size_m, camera.camera(), seen_from, title=f"Boards {word}"
        )
        caption = f"Boards seen {word}; the yellow stroke shows where a board faces."
        yield Picture(png_data_uri(picture), f"Boards {word}", caption)
    s = result.spread
    yield Table(
        ("what", "of the boards used"),
        (
            ("turned left and right, rms (deg)", f"{s.turned_deg:.1f}"),
            ("tilted up and down, rms (deg)", f"{s.tilted_deg:.1f}"),
            ("condition of their normals (1 is best)", f"{s.normals_condition:.1f}"),
            ("nearest and farthest (m)", f"{s.nearest_m:.2f} to {s.farthest_m:.2f}"),
            ("spread left to right (deg)", f"{s.across_deg:.0f}"),
            ("spread up to down (deg)", f"{s.upright_deg:.0f}"),
        ),
    )


def _meaning(result: CameraLidarCalibration, camera: CameraSensor) -> Iterator[Block]:
    if result.covariance is None:
        return
    yield Paragraph(
        "A point of the LiDAR straight ahead of the camera is off by so much across the line of "
        "sight (one standard deviation, from leaving pairs out), and falls so many pixels from "
        "its place in the image. What the intrinsics add is not in it."
    )
    rows = []
    for range_m in _RANGES_M:
        sd_m = result.spread_at(range_m)
        rows.append((f"{range_m}", f"{100 * sd_m:.1f}", f"{camera.K[0] * sd_m / range_m:.2f}"))
    yield Table(("distance (m)", "sd (cm)", "sd (px)"), tuple(rows))


def _transform(
    result: CameraLidarCalibration, camera: CameraSensor, lidar: LidarSensor
) -> Iterator[Block]:
    T, sd_m, sd_deg = result.T_camera_lidar, result.sd_translation_m, result.sd_rotation_deg
    if T is None or sd_m is None or sd_deg is None:
        return
    rows = []
    for to, of, matrix, words in (
        (camera.frame, lidar.frame, T, "T_camera_lidar: from the LiDAR's frame to the camera's"),
        (lidar.frame, camera.frame, np.linalg.inv(T), "its inverse, T_lidar_camera"),
    ):
        cells = (" ".join(f"{value:.6f}" for value in row) for row in matrix[:3])
        rows.append((f"point_{to} = T point_{of}", words, *cells))
    yield Table(("use", "what it is", "row 1 of T", "row 2", "row 3"), tuple(rows))
    yield Table(
        (
            "axis of the camera",
            "place of the LiDAR (m)",
            "sd (mm)",
            "sd of the turn about it (deg)",
        ),
        tuple(
            (name, f"{T[k, 3]:.4f}", f"{1000 * sd_m[k]:.1f}", f"{sd_deg[k]:.3f}")
            for k, name in enumerate(("x, right", "y, down", "z, forward"))
        ),
        "The camera's optical frame has z forward, x right, y down.",
    )


def _tests(result: CameraLidarCalibration) -> Table:
    rows = [
        ("every second pair against the others", _split_words(result.odd_even)),
        ("first half of the pairs against the second", _split_words(result.first_second)),
        ("largest change when one pair is left out", _leave_one_out(result)),
        ("range offset of the LiDAR, to be added (mm)", _estimate(result.range_offset_m, 1000, 1)),
        ("size of the pattern over the given one", _estimate(result.board_scale, 1, 4)),
        ("focal length over the given one", _estimate(result.focal_scale, 1, 4)),
    ]
    if result.centre_off_deg is not None:
        right, down = (_estimate(e, 1, 3) for e in result.centre_off_deg)
        rows.append(("principal point is off (deg)", f"right {right}, down {down}"))
    if result.pattern_off_m is not None:
        along, across = (_estimate(e, 1000, 1) for e in result.pattern_off_m)
        words = f"along the columns {along}, along the rows {across}"
        rows.append(("pattern lies off the plate's middle (mm)", words))
    return Table(("test", "result"), tuple(rows))


def _split_words(split: Split | None) -> str:
    if split is None:
        return "too few pairs"
    return f"{1000 * split.translation_m:.1f} mm, {split.rotation_deg:.3f} deg"


def _leave_one_out(result: CameraLidarCalibration) -> str:
    largest = result.as_json()["leave_one_out_max"]
    if largest is None:
        return "too few pairs"
    return f"{1000 * largest['translation_m']:.1f} mm, {largest['rotation_deg']:.3f} deg"


def _estimate(estimate: Estimate | None, factor: float, digits: int) -> str:
    if estimate is None:
        return "not known"
    return f"{factor * estimate.value:.{digits}f} +- {factor * estimate.sd:.{digits}f}"


def _pairs(result: CameraLidarCalibration) -> Table:
    return Table(
        (
            "pair",
            "points on the board",
            "LiDAR's board in the image (px)",
            "shift of it along width, height, normal (mm)",
            "tilt of it (deg)",
            "left out because",
        ),
        tuple(_pair_row(pair) for pair in result.pairs),
        "How far the board as the LiDAR alone sees it lies from the one in the image.",
    )


def _pair_row(pair: PairResult) -> tuple[str, ...]:
    shift = "" if pair.shift_m is None else " ".join(f"{1000 * v:.0f}" for v in pair.shift_m)
    return (
        pair.name,
        str(pair.board_points),
        _text(pair.reprojection_px, 2),
        shift,
        _text(pair.tilt_deg, 2),
        "" if pair.used else str(pair.reason),
    )


def _text(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _inputs(inputs: Sequence[Mapping[str, object]]) -> Table:
    rows = tuple((str(entry["path"]), f"{entry['bytes']}") for entry in inputs)
    return Table(("file", "bytes"), rows)


def _named(values: Mapping[str, object]) -> Table:
    return Table(("name", "value"), tuple((key, str(value)) for key, value in values.items()))


def _rms(result: CameraLidarCalibration) -> Table:
    point_mm = None if result.point_rms_m is None else 1000 * result.point_rms_m
    return Table(
        ("rms over the pairs used", "value"),
        (
            ("board of the LiDAR alone against the image (px)", _text(result.reprojection_px, 2)),
            ("points about the boards' planes (mm)", _text(point_mm, 1)),
            ("corners about the joint solution (px)", _text(result.corner_rms_px, 3)),
        ),
        "A wrong result can have small ones: nothing above rests on them alone.",
    )
