"""The report of `percept calib lidar`: can the places be trusted, and what do they look like."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from percept.calib.lidars.result import LidarCalibration, LidarExtrinsic
from percept.export.calibration.pictures import clouds_from_above, clouds_zoom
from percept.export.calibration.shared_view import busiest_places
from percept.export.detection_report import installed_versions
from percept.export.pictures import png_data_uri
from percept.export.report import Block, Paragraph, Picture, ReportContent, Section, Table

__all__ = ["clouds_in_reference", "lidar_calibration_report"]

_F64 = NDArray[np.float64]
_Clouds = Mapping[str, NDArray[np.floating]]

_RANGES_M = (10, 30, 50)
_ZOOM_M = 8.0
_ZOOMS = 2


def clouds_in_reference(
    result: LidarCalibration, scene: _Clouds
) -> tuple[dict[str, _F64], dict[str, _F64]]:
    """Return the clouds of a scene in the reference's frame, before and after the calibration.

    Before means at the place that was given, and as the sensors gave them where none was.
    A sensor without a place is missing after.

    Args:
        result: The calibration.
        scene: Points (N, 3) by sensor, each in its own frame.
    """
    start = {e.sensor: e.T_reference_start for e in result.extrinsics}
    places = result.transforms()
    names = [name for name in (result.reference, *start) if name in scene]
    before = {name: _moved(scene[name], start.get(name)) for name in names}
    after = {name: _moved(scene[name], places[name]) for name in names if name in places}
    return before, after


def lidar_calibration_report(
    result: LidarCalibration,
    scenes: Sequence[_Clouds],
    *,
    inputs: Sequence[Mapping[str, object]],
    settings: Mapping[str, object],
    notes: Sequence[str] = (),
) -> ReportContent:
    """Return the report of a calibration of LiDARs.

    Args:
        result: What was found.
        scenes: Points (N, 3) by sensor, scene by scene, as they were measured.
        inputs: The files of `run.json`: `path`, `bytes` and what else is known of them.
        settings: The resolved configuration.
        notes: What else should be known, such as how the reference was chosen.
    """
    shown = scenes[0] if scenes else {}
    sections = (
        Section("All LiDARs over each other", tuple(_overviews(result, shown))),
        Section("Where two LiDARs see the same", tuple(_zooms(result, shown))),
        *_rival_sections(result, shown),
        Section("What the uncertainty means", tuple(_meaning(result))),
        Section("Where the LiDARs sit", tuple(_extrinsics(result))),
        Section("Round trips through the rig", tuple(_loops(result))),
        Section("Scenes, and directions that they hold loosely", tuple(_scenes(result))),
        Section("Registrations", (_pairs(result),)),
        Section("What was left out", (_left_out(result),)),
        Section("Inputs", (_inputs(inputs), *(Paragraph(note) for note in notes))),
        Section("Settings and versions", (_named(settings), _named(dict(installed_versions())))),
        Section("Residuals", (_rms(result),)),
    )
    return ReportContent(
        title=f"LiDARs in the frame of {result.reference}",
        verdict=result.verdict,
        why=result.why,
        advice=result.advice,
        sections=sections,
        subtitle=f"{result.scenes} scenes of different places, {len(result.extrinsics)} LiDARs "
        f"placed against {result.reference}",
    )


def _moved(points: NDArray[np.floating], T: _F64 | None) -> _F64:
    values = np.asarray(points, dtype=np.float64)
    return values if T is None else values @ T[:3, :3].T + T[:3, 3]


def _picture(image: NDArray[np.uint8], alt: str, caption: str) -> Picture:
    return Picture(png_data_uri(image), alt, caption)


def _overviews(result: LidarCalibration, scene: _Clouds) -> Iterator[Block]:
    if not scene:
        return
    before, after = clouds_in_reference(result, scene)
    given = any(e.T_reference_start is not None for e in result.extrinsics)
    word = "at the given places" if given else "each in its own frame, as measured"
    yield _picture(
        clouds_from_above(before, f"before: {word}"),
        "The clouds of all LiDARs from above before the calibration",
        f"Before, {word}. Each LiDAR has a colour.",
    )
    yield _picture(
        clouds_from_above(after, "after"),
        "The clouds of all LiDARs from above after the calibration",
        "After: walls, poles and vehicles that two LiDARs see must be one line, not two.",
    )


def _zooms(result: LidarCalibration, scene: _Clouds) -> Iterator[Block]:
    _, after = clouds_in_reference(result, scene)
    for extrinsic in result.extrinsics:
        neighbour = extrinsic.path[-2] if len(extrinsic.path) > 1 else result.reference
        pair = {name: after[name] for name in (neighbour, extrinsic.sensor) if name in after}
        if len(pair) < 2:
            yield Paragraph(f"{extrinsic.sensor}: there is no place to look at.")
            continue
        places = busiest_places(pair[neighbour], pair[extrinsic.sensor], _ZOOM_M, _ZOOMS)
        if not places:
            yield Paragraph(
                f"{extrinsic.sensor} and {neighbour}: nothing that both see stands close together."
            )
        names = f"{neighbour} and {extrinsic.sensor}"
        for centre, across in places:
            at = f"at x {centre[0]:.0f} m, y {centre[1]:.0f} m"
            yield _picture(
                clouds_zoom(after, centre, _ZOOM_M, title=f"{names} from above {at}"),
                f"{names} from above, {_ZOOM_M:.0f} m wide",
                f"{names} from above {at}",
            )
            yield _picture(
                clouds_zoom(
                    after, centre, _ZOOM_M, axes=(across, "z"), title=f"{names} from the side"
                ),
                f"{names} from the side, {_ZOOM_M:.0f} m wide",
                f"The same place from the side, {across} to z",
            )


def _rival_sections(result: LidarCalibration, scene: _Clouds) -> list[Section]:
    """Show the places that explain the clouds as well, beside the one that was chosen."""
    blocks: list[Block] = []
    for extrinsic in (e for e in result.extrinsics if e.rivals):
        names = (result.reference, extrinsic.sensor)
        if any(name not in scene for name in names):
            continue
        places = [extrinsic.T_reference_sensor, *extrinsic.rivals[:3]]
        for number, place in enumerate(places):
            title = f"{extrinsic.sensor}: {'the answer' if number == 0 else f'rival {number}'}"
            clouds = {
                names[0]: _moved(scene[names[0]], None),
                names[1]: _moved(scene[names[1]], place),
            }
            blocks.append(
                _picture(clouds_from_above(clouds, title), title, f"{title}: {_place_words(place)}")
            )
    return [Section("Places that fit as well", tuple(blocks))] if blocks else []


def _place_words(T: _F64 | None) -> str:
    if T is None:
        return "none"
    yaw = np.degrees(np.arctan2(T[1, 0], T[0, 0]))
    return f"x {T[0, 3]:.2f} m, y {T[1, 3]:.2f} m, z {T[2, 3]:.2f} m, yaw {yaw:.1f} deg"


def _meaning(result: LidarCalibration) -> Iterator[Block]:
    rows = []
    for e in result.extrinsics:
        if e.T_reference_sensor is None:
            continue
        at = [f"{100 * point_sd_m(e, float(range_m)):.1f}" for range_m in _RANGES_M]
        rows.append((e.sensor, *at, *_leave_one_out(e)))
    yield Paragraph(
        "A point of the LiDAR, brought into the frame of the reference, is off by so many "
        "centimetres (one standard deviation): the origin's spread, and what the turn's spread "
        "moves at that range. A tenth of a degree is 1.7 cm at 10 m and 8.7 cm at 50 m."
    )
    yield Table(
        (
            "sensor",
            *(f"at {range_m} m (cm)" for range_m in _RANGES_M),
            "leaving one scene out moves it by (cm)",
            "and turns it by (deg)",
        ),
        tuple(rows),
    )


def point_sd_m(extrinsic: LidarExtrinsic, range_m: float) -> float:
    """Return the standard deviation (m) of where a point at a range comes to lie.

    The two loosest of the three rotations are taken, for the direction in which it is worst.
    """
    turns = np.sort(np.radians(extrinsic.sd_rotation_deg))[1:]
    squares = (extrinsic.sd_translation_m**2).sum() + range_m**2 * (turns**2).sum()
    return float(np.sqrt(squares))


def _leave_one_out(e: LidarExtrinsic) -> tuple[str, str]:
    moved, turned = e.leave_one_out_translation_m, e.leave_one_out_rotation_deg
    return (
        "not known" if moved is None else f"{100 * moved:.2f}",
        "not known" if turned is None else f"{turned:.3f}",
    )


def _extrinsics(result: LidarCalibration) -> Iterator[Block]:
    rows, numbers = [], []
    for e in result.extrinsics:
        if e.T_reference_sensor is None:
            rows.append((e.sensor, *("no place was found", "", "", ""), str(e.verdict)))
            continue
        spread = " ".join(f"{1000 * value:.1f}" for value in e.sd_translation_m)
        turns = " ".join(f"{value:.3f}" for value in e.sd_rotation_deg)
        place = " ".join(f"{value:.4f}" for value in e.T_reference_sensor[:3, 3])
        angles = " ".join(f"{value:.3f}" for value in e.rpy_deg())
        rows.append((e.sensor, place, angles, spread, turns, str(e.verdict)))
        for target, source, T in (
            (result.reference, e.sensor, e.T_reference_sensor),
            (e.sensor, result.reference, np.linalg.inv(e.T_reference_sensor)),
        ):
            cells = tuple(" ".join(f"{value:.6f}" for value in row) for row in T[:3])
            numbers.append((f"point_{target} = T_{target}_{source} point_{source}", *cells))
    yield Table(
        (
            "sensor",
            f"x y z in {result.reference} (m)",
            "roll pitch yaw (deg)",
            "sd of x y z (mm)",
            f"sd about x y z of {result.reference} (deg)",
            "verdict",
        ),
        tuple(rows),
    )
    yield Table(
        ("from a sensor's frame into another's", "row 1 of T", "row 2", "row 3"),
        tuple(numbers),
        "Both directions. T_a_b turns the coordinates of a point in frame b into those in frame a.",
    )


def _loops(result: LidarCalibration) -> Iterator[Block]:
    if not result.loops:
        yield Paragraph(
            "There is none: no three LiDARs were registered with each other, so that the places "
            "could not be checked that way."
        )
        return
    rows = tuple(
        (
            " - ".join(loop.path),
            f"{100 * loop.translation_m:.2f}",
            f"{loop.rotation_deg:.3f}",
            f"{100 * loop.sd_translation_m:.2f}",
            f"{loop.sd_rotation_deg:.3f}",
            "yes" if loop.agrees else "no",
        )
        for loop in result.loops
    )
    yield Table(
        ("round trip", "misses by (cm)", "and (deg)", "expected (cm)", "and (deg)", "closes"),
        rows,
        "Each registration is made by itself; one that is wrong does not close its round trips.",
    )


def _scenes(result: LidarCalibration) -> Iterator[Block]:
    rows = tuple(
        (
            e.sensor,
            e.scenes_agreeing,
            f"{e.overlap:.0%}",
            " - ".join(e.path) or "none",
            ", ".join(e.weak_directions) or "none",
            _from_start(e),
        )
        for e in result.extrinsics
    )
    yield Table(
        (
            "sensor",
            "scenes that found this place on their own",
            "overlap",
            "placed along",
            "weak directions",
            "moved from the given place",
        ),
        rows,
    )


def _from_start(e: LidarExtrinsic) -> str:
    if e.T_reference_start is None or e.T_reference_sensor is None:
        return "none was given"
    step = np.linalg.inv(e.T_reference_start) @ e.T_reference_sensor
    angle = np.degrees(np.arccos(np.clip((np.trace(step[:3, :3]) - 1) / 2, -1, 1)))
    return f"{100 * np.linalg.norm(step[:3, 3]):.1f} cm, {angle:.2f} deg"


def _pairs(result: LidarCalibration) -> Table:
    rows = tuple(
        (
            f"{pair['target']} - {pair['source']}",
            f"{pair['overlap']:.0%}",
            pair["scenes_agreeing"],
            pair["verdict"],
            " ".join(pair["why"]),
        )
        for pair in result.pairs
    )
    return Table(("LiDARs", "overlap", "scenes", "verdict", "why"), rows)


def _left_out(result: LidarCalibration) -> Block:
    if not result.dropped:
        return Paragraph("Nothing.")
    rows = tuple((reason, str(count)) for reason, count in result.dropped.items())
    return Table(("what", "how many"), rows)


def _inputs(inputs: Sequence[Mapping[str, object]]) -> Table:
    rows = tuple((str(entry["path"]), f"{entry['bytes']}") for entry in inputs)
    return Table(("file", "bytes"), rows)


def _named(values: Mapping[str, object]) -> Table:
    return Table(("name", "value"), tuple((key, str(value)) for key, value in values.items()))


def _rms(result: LidarCalibration) -> Table:
    rows = tuple(
        (e.sensor, f"{1000 * e.rms_m:.1f}" if np.isfinite(e.rms_m) else "not known")
        for e in result.extrinsics
    )
    return Table(
        ("sensor", "rms of points about surfaces (mm)"),
        rows,
        "A wrong place can have a small one: nothing above rests on it.",
    )
