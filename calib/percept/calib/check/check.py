"""Does the calibration of a rig still hold for a new log, and if not, which sensor moved?

Every pair of sensors that sees enough is calibrated anew from the log, without trusting the rig;
the difference to the rig is judged axis by axis, against its own spread and with a known-bad
control (`check_axes`); and the pairs together say which sensor it was (`check_movers`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.calib.camera_lidar.calibrate import CameraLidarCalibrationConfig
from percept.calib.check.axes import check_pair
from percept.calib.check.camera import CameraBoards, measure_camera
from percept.calib.check.lidar import measure_lidars
from percept.calib.check.movers import find_movers, seen_from_the_others
from percept.calib.check.result import (
    CalibrationCheck,
    IntrinsicsCheck,
    Measurement,
    MovedSensor,
    PairCheck,
)
from percept.calib.check.verdict import conclude
from percept.calib.lidars.pair import LidarCalibrationConfig
from percept.calib.lidars.scenes import prepare_scenes
from percept.calib.limits import CheckLimits, LidarLimits
from percept.core.errors import InsufficientDataError, UsageError
from percept.core.results import Verdict
from percept.core.settings import Settings

__all__ = ["CameraBoards", "CheckConfig", "check_calibration"]

_F64 = NDArray[np.float64]
_FAR_M = 20.0

# The rig was made with the same intrinsics, and mostly the same board: what is wrong with them
# shifts the old place and the new one alike, so only what may differ counts as unknown.
_SAME_LENS_AND_BOARD = CameraLidarCalibrationConfig(
    focal_scale_sd=0.001, centre_sd_deg=0.02, board_scale_sd=0.0002, pattern_sd_m=0.0005
)


class CheckConfig(Settings):
    """Settings of a check: those of the solvers that measure anew.

    Attributes:
        lidar: Between LiDARs.
        camera_lidar: Between a camera and a LiDAR. Errors of the lens and the board are taken to be
            those that the rig was made with.
    """

    lidar: LidarCalibrationConfig = Field(default_factory=LidarCalibrationConfig)
    camera_lidar: CameraLidarCalibrationConfig = _SAME_LENS_AND_BOARD


def check_calibration(
    T_base_sensor: Mapping[str, NDArray[np.floating]],
    *,
    scenes: Sequence[Mapping[str, NDArray[np.floating]]] = (),
    boards: Sequence[CameraBoards] = (),
    reference: str | None = None,
    focal_px: float | None = None,
    config: CheckConfig | None = None,
    progress: Callable[[float], None] | None = None,
) -> CalibrationCheck:
    """Check where the sensors of a rig sit.

    Args:
        T_base_sensor: (4, 4) by the rig, of every sensor that has a place.
        scenes: For each scene the points (N, 3) of the LiDARs in their own frames, metres.
        boards: Pairs of images and clouds that show a board.
        reference: The LiDAR that the others are looked at from; None for the one with the most
            points. It is not taken to be in its place.
        focal_px: Focal length of the rig's camera, to say in pixels what a move does.
        config: Settings; None for the defaults.
        progress: Called with the share that is done, 0 to 1.

    Raises:
        UsageError: If a sensor has no place in the rig, or the reference is none of the LiDARs.
        InsufficientDataError: If there are no two sensors to compare.
        InputError: If two sensors have the same cloud.
        GeometryError: If an array is no (N, 3).
    """
    config, limits = config or CheckConfig(), CheckLimits()
    places = {name: np.asarray(T, dtype=np.float64) for name, T in T_base_sensor.items()}
    lidars = list(dict.fromkeys(name for scene in scenes for name in scene))
    wanted = [*lidars, *(name for b in boards for name in (b.camera, b.lidar))]
    _check_names(wanted, places, lidars, reference)
    if len(lidars) < 2 and not boards:
        raise InsufficientDataError(
            "there are no two sensors to compare",
            remedy="Give clouds of two LiDARs or more, or a board that a camera and a LiDAR see",
        )
    measured: list[Measurement] = []
    intrinsics: list[IntrinsicsCheck] = []
    dropped: dict[str, int] = {}
    doubts: tuple[str, ...] = ()
    if len(lidars) > 1:
        reference = reference or _most_points(scenes, lidars)
        prepared = prepare_scenes(scenes, reference, LidarLimits())
        own = {name: places[name] for name in lidars}
        report = progress or (lambda _share: None)
        measured += measure_lidars(prepared, own, reference, config.lidar, limits, report)
        dropped, doubts = prepared.dropped, prepared.doubts
    for one in boards:
        found, lens, _ = measure_camera(one, places[one.lidar], config.camera_lidar, limits)
        measured.append(found)
        intrinsics += [] if lens is None else [lens]
    result = _judged(measured, places, limits, focal_px)
    return conclude(replace(result, intrinsics=tuple(intrinsics), dropped=dropped), doubts)


def _check_names(
    wanted: Sequence[str],
    places: Mapping[str, _F64],
    lidars: Sequence[str],
    reference: str | None,
) -> None:
    without = [name for name in wanted if name not in places]
    if without:
        raise UsageError(
            f"the rig does not say where '{without[0]}' sits",
            remedy=f"Name the sensors as the rig does: {', '.join(places) or 'it places none'}",
        )
    if reference is not None and reference not in lidars:
        raise UsageError(
            f"the reference '{reference}' is none of the LiDARs",
            remedy=f"Choose from {', '.join(lidars)}" if lidars else "Leave it out",
        )


def _most_points(
    scenes: Sequence[Mapping[str, NDArray[np.floating]]], lidars: Sequence[str]
) -> str:
    return max(lidars, key=lambda name: sum(len(scene.get(name, ())) for scene in scenes))


def _judged(
    measured: Sequence[Measurement],
    places: Mapping[str, _F64],
    limits: CheckLimits,
    focal_px: float | None,
) -> CalibrationCheck:
    """Judge the pairs, find who moved, and turn the pairs so that movers are looked at."""
    pairs = [check_pair(one, places, limits) for one in measured]
    groups = find_movers(pairs, places, limits)
    movers = groups[0] if len(groups) == 1 else ()
    suspects = groups if len(groups) > 1 else ()
    shown = tuple(_turned(pair, movers, places, limits) for pair in pairs)

    def moves(names: Sequence[str]) -> tuple[MovedSensor, ...]:
        found = (_moved(name, pairs, movers, places, limits, focal_px) for name in names)
        return tuple(one for one in found if one is not None)

    every = dict.fromkeys(name for group in suspects for name in group)
    return CalibrationCheck(
        verdict=Verdict.DOUBTFUL,
        why=(),
        advice=(),
        pairs=shown,
        moved=moves(movers),
        suspects=suspects,
        if_moved=moves(list(every)),
    )


def _turned(
    pair: PairCheck, movers: Sequence[str], places: Mapping[str, _F64], limits: CheckLimits
) -> PairCheck:
    if pair.against in movers and pair.sensor not in movers:
        return seen_from_the_others(pair.against, [pair], places, limits)[0]
    return pair


def _moved(
    name: str,
    pairs: Sequence[PairCheck],
    movers: Sequence[str],
    places: Mapping[str, _F64],
    limits: CheckLimits,
    focal_px: float | None,
) -> MovedSensor | None:
    """Return where a sensor went, by the pair that says it best."""
    views = seen_from_the_others(name, [pair for pair in pairs if pair.judged], places, limits)
    settled = [view for view in views if view.against not in movers] or views
    if not settled:
        return None
    best = min(settled, key=lambda v: (-len(v.judged), float(np.trace(v.measured.covariance))))
    delta, found = best.deltas(), best.measured.T_against_sensor
    if found is None:
        return None
    turn = float(np.radians(np.linalg.norm(delta[3:])))
    off_m = float(np.linalg.norm(delta[:3]) + _FAR_M * turn)
    return MovedSensor(
        sensor=name,
        delta_translation_m=delta[:3],
        delta_rotation_deg=delta[3:],
        off_at_20_m=off_m,
        px_at_20_m=None if focal_px is None else focal_px * off_m / _FAR_M,
        T_base_sensor=places[best.against] @ found,
    )
