"""The report of `percept calib check`: does the rig hold, and if not, what does it look like."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from percept.calib.check.axes import size
from percept.calib.check.check import CameraBoards
from percept.calib.check.result import AXES, AxisCheck, AxisVerdict, CalibrationCheck, PairCheck
from percept.export.calibration.pictures import cloud_in_image, clouds_from_above, clouds_zoom
from percept.export.calibration.shared_view import busiest_places
from percept.export.detection_report import installed_versions
from percept.export.pictures import png_data_uri
from percept.export.report import Block, Paragraph, Picture, ReportContent, Section, Table

__all__ = ["CheckEvidence", "CheckShot", "calibration_check_report", "found_places", "in_base"]

_F64 = NDArray[np.float64]
_Clouds = Mapping[str, NDArray[np.floating]]

_ZOOM_M = 8.0
_ZOOMS = 1
_MOST_PAIRS = 6
_IMAGES = 2


class CheckShot(Protocol):
    """An image and a cloud (N, 3) of one moment."""

    @property
    def read_image(self) -> Callable[[], NDArray[Any]]:
        """Return what reads the image."""

    @property
    def points(self) -> NDArray[np.float32]:
        """Return the cloud in the LiDAR's frame."""


@dataclass(frozen=True, slots=True, eq=False)
class CheckEvidence:
    """What a check looked at.

    Attributes:
        T_base_sensor: (4, 4) by the rig.
        scenes: Points (N, 3) by LiDAR, each in its own frame.
        boards: The pairs that show a board, or None.
        shots: Images and clouds of these pairs.
    """

    T_base_sensor: Mapping[str, _F64]
    scenes: Sequence[_Clouds]
    boards: CameraBoards | None
    shots: Sequence[CheckShot]


def found_places(result: CalibrationCheck, T_base_sensor: Mapping[str, _F64]) -> dict[str, _F64]:
    """Return `T_base_sensor` (4, 4) by the new data; of sensors without a measurement, the rig's.

    What a sensor was compared with first stays where the rig has it.
    """
    places = dict(T_base_sensor)
    moved = {one.sensor: one.T_base_sensor for one in result.moved}
    placed = set(moved)
    for pair in result.pairs:
        found = pair.measured.T_against_sensor
        if pair.sensor not in placed and pair.against not in moved and found is not None:
            places[pair.sensor] = T_base_sensor[pair.against] @ found
            placed |= {pair.sensor, pair.against}
    return places | moved


def in_base(scene: _Clouds, T_base_sensor: Mapping[str, _F64]) -> dict[str, _F64]:
    """Return the clouds of a scene in the base frame."""
    return {name: _moved(points, T_base_sensor[name]) for name, points in scene.items()}


def calibration_check_report(
    result: CalibrationCheck,
    evidence: CheckEvidence,
    *,
    inputs: Sequence[Mapping[str, object]],
    settings: Mapping[str, object],
    notes: Sequence[str] = (),
) -> ReportContent:
    """Return the report of a check.

    Args:
        result: What was found.
        evidence: What it was found with.
        inputs: The files of `run.json`: `path`, `bytes` and what else is known of them.
        settings: The resolved configuration.
        notes: What else should be known.
    """
    sections = (
        Section("Axis by axis", tuple(_axes(result))),
        Section("All LiDARs over each other", tuple(_overviews(result, evidence))),
        Section("Where two LiDARs see the same", tuple(_zooms(result, evidence))),
        Section("The cloud in the image", tuple(_images(result, evidence))),
        Section("What a move does", tuple(_moves(result))),
        Section("Would a wrong rig have been noticed?", (_controls(result),)),
        Section("Pairs of sensors", (_pairs(result),)),
        Section("Intrinsics", tuple(_intrinsics(result))),
        Section("What was not checked or left out", (_left_out(result),)),
        Section("Inputs", (_inputs(inputs), *(Paragraph(note) for note in notes))),
        Section("Settings and versions", (_named(settings), _named(dict(installed_versions())))),
    )
    names = dict.fromkeys(n for pair in result.pairs for n in (pair.against, pair.sensor))
    return ReportContent(
        title="Does the calibration still hold?",
        verdict=result.verdict,
        why=result.why,
        advice=result.advice,
        sections=tuple(section for section in sections if section.blocks),
        subtitle=f"{', '.join(names)}: {len(result.pairs)} pairs of sensors against the rig",
    )


def _moved(points: NDArray[np.floating], T: _F64) -> _F64:
    return np.asarray(points, dtype=np.float64) @ T[:3, :3].T + T[:3, 3]


def _picture(image: NDArray[np.uint8], alt: str, caption: str) -> Picture:
    return Picture(png_data_uri(image), alt, caption)


def _axes(result: CalibrationCheck) -> Iterator[Block]:
    yield Paragraph(
        "What the new data measure less what the rig says, along and about forward x, left y and "
        "up z of the rig's base frame, and the tolerance: 3 standard deviations of the difference, "
        "and never less than what sensors differ by without a move."
    )
    rows = tuple(
        (
            f"{pair.sensor} against {pair.against}",
            *(_cell(name, pair.axes[name]) for name in AXES),
            str(pair.verdict),
        )
        for pair in _worst_first(result)
    )
    yield Table(("sensors", *AXES, "verdict"), rows)
    reasons = tuple(
        (f"{pair.sensor} against {pair.against}", name, str(axis.verdict), axis.reason or "")
        for pair in _worst_first(result)
        for name, axis in pair.axes.items()
        if axis.verdict is not AxisVerdict.HOLDS
    )
    if reasons:
        yield Table(("sensors", "axis", "verdict", "why"), reasons)


def _worst_first(result: CalibrationCheck) -> list[PairCheck]:
    return sorted(result.pairs, key=lambda pair: not pair.moved)


def _cell(name: str, axis: AxisCheck) -> str:
    if not np.isfinite(axis.delta):
        return str(axis.verdict)
    off = f"{size(name, axis.delta)} of {size(name, axis.tolerance)}"
    return off if axis.verdict is AxisVerdict.HOLDS else f"{axis.verdict}: {off}"


def _overviews(result: CalibrationCheck, evidence: CheckEvidence) -> Iterator[Block]:
    if not evidence.scenes or len(evidence.scenes[0]) < 2:
        return
    before = in_base(evidence.scenes[0], evidence.T_base_sensor)
    after = in_base(evidence.scenes[0], found_places(result, evidence.T_base_sensor))
    yield _picture(
        clouds_from_above(before, "by the rig"),
        "The clouds of all LiDARs from above, placed by the rig",
        "By the rig that is checked. Each LiDAR has a colour; what two see must be one line.",
    )
    yield _picture(
        clouds_from_above(after, "by the new data"),
        "The clouds of all LiDARs from above, placed by the new data",
        "By the new data alone.",
    )


def _zooms(result: CalibrationCheck, evidence: CheckEvidence) -> Iterator[Block]:
    if not evidence.scenes:
        return
    scene = evidence.scenes[0]
    for pair in _worst_first(result)[:_MOST_PAIRS]:
        found = pair.measured.T_against_sensor
        if found is None or pair.sensor not in scene or pair.against not in scene:
            continue
        places = {
            "by the rig": evidence.T_base_sensor,
            "by the new data": {
                **evidence.T_base_sensor,
                pair.sensor: evidence.T_base_sensor[pair.against] @ found,
            },
        }
        both = {name: scene[name] for name in (pair.against, pair.sensor)}
        yield from _zooms_of(pair, both, places)


def _zooms_of(
    pair: PairCheck, both: _Clouds, places: Mapping[str, Mapping[str, _F64]]
) -> Iterator[Block]:
    """Show the places where two LiDARs see most, by the rig and by the new data."""
    clouds = {word: in_base(both, T_base_sensor) for word, T_base_sensor in places.items()}
    aligned = clouds["by the new data"]
    names = f"{pair.against} and {pair.sensor}"
    spots = busiest_places(aligned[pair.against], aligned[pair.sensor], _ZOOM_M, _ZOOMS)
    if not spots:
        yield Paragraph(f"{names}: nothing that both see stands close together.")
    for centre, _ in spots:
        for word, shown in clouds.items():
            title = f"{names} {word}"
            yield _picture(
                clouds_zoom(shown, centre, _ZOOM_M, title=title),
                f"{title}, {_ZOOM_M:.0f} m wide, from above",
                f"{title}, from above at x {centre[0]:.0f} m, y {centre[1]:.0f} m",
            )


def _images(result: CalibrationCheck, evidence: CheckEvidence) -> Iterator[Block]:
    boards = evidence.boards
    pair = next((p for p in result.pairs if p.measured.kind == "camera"), None)
    if boards is None or pair is None:
        return
    T_base = evidence.T_base_sensor
    places = {"by the rig": np.linalg.inv(T_base[boards.camera]) @ T_base[boards.lidar]}
    found = pair.measured.T_against_sensor
    if found is not None:
        seen_from_lidar = pair.sensor == boards.camera
        T_camera_lidar = np.linalg.inv(found) if seen_from_lidar else found
        places["by the new data"] = np.asarray(T_camera_lidar, dtype=np.float64)
    both = [
        shot
        for shot, one in zip(evidence.shots, boards.pairs, strict=True)
        if one.view is not None and one.board is not None
    ]
    for shot in both[:: max(1, len(both) // _IMAGES)][:_IMAGES]:
        for word, T_camera_lidar in places.items():
            points = _moved(shot.points, T_camera_lidar)
            yield _picture(
                cloud_in_image(shot.read_image(), points, boards.model, title=word),
                f"The cloud of {boards.lidar} in the image of {boards.camera}, {word}",
                f"{word.capitalize()}: points of the board must end where the board ends.",
            )


def _moves(result: CalibrationCheck) -> Iterator[Block]:
    shown = [("moved", one) for one in result.moved]
    shown += [("if it was this one", one) for one in result.if_moved]
    if not shown:
        return
    rows = tuple(
        (
            one.sensor,
            word,
            " ".join(f"{100 * value:+.1f}" for value in one.delta_translation_m),
            " ".join(f"{value:+.2f}" for value in one.delta_rotation_deg),
            f"{100 * one.off_at_20_m:.0f}",
            "no camera" if one.px_at_20_m is None else f"{one.px_at_20_m:.0f}",
        )
        for word, one in shown
    )
    yield Table(
        (
            "sensor",
            "",
            "shift along x y z (cm)",
            "turn about x y z (deg)",
            "off at 20 m, at most (cm)",
            "in the image (px)",
        ),
        rows,
    )


def _controls(result: CalibrationCheck) -> Block:
    rows = tuple(
        (
            f"{pair.sensor} against {pair.against}",
            name,
            size(name, control.planted),
            size(name, control.found),
            "yes" if control.held_out else "no",
            "yes" if control.detected else "no: the axis is not judged",
        )
        for pair in result.pairs
        for name, control in pair.measured.controls.items()
    )
    if not rows:
        return Paragraph("No pair of sensors could be measured.")
    return Table(
        ("sensors", "axis", "planted", "found of it", "in other data", "noticed"),
        rows,
        "A rig that is known to be wrong has to be found wrong by the same test. Where it was not, "
        "or the shapes of what both see do not fix an axis, the axis is not judged.",
    )


def _pairs(result: CalibrationCheck) -> Table:
    rows = tuple(
        (
            f"{pair.sensor} against {pair.against}",
            str(pair.measured.scenes),
            str(pair.measured.verdict),
            str(pair.verdict),
            pair.why,
        )
        for pair in result.pairs
    )
    header = ("sensors", "scenes or poses", "measurement", "verdict", "why")
    return Table(header, rows)


def _intrinsics(result: CalibrationCheck) -> Iterator[Block]:
    if not result.intrinsics:
        return
    rows = tuple(
        (lens.camera, f"{lens.reprojection_px:.2f}", f"{lens.focal_scale:.3f}", lens.why)
        for lens in result.intrinsics
    )
    yield Table(("camera", "corners about their board (px)", "focal length by LiDAR", "why"), rows)


def _left_out(result: CalibrationCheck) -> Block:
    rows = [(name, why) for name, why in result.not_checked.items()]
    rows += [(reason, str(count)) for reason, count in result.dropped.items()]
    if not rows:
        return Paragraph("Nothing.")
    return Table(("what", "why, or how many"), tuple(rows))


def _inputs(inputs: Sequence[Mapping[str, object]]) -> Table:
    rows = tuple((str(entry["path"]), f"{entry['bytes']}") for entry in inputs)
    return Table(("file", "bytes"), rows)


def _named(values: Mapping[str, object]) -> Table:
    return Table(("name", "value"), tuple((key, str(value)) for key, value in values.items()))
