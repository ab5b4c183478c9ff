"""The calibration board in raw LiDAR clouds, found by its size alone, without a region given.

1. Where five clouds or more are given, points of places that most of them hit start no search:
   they are the room, while the board moves. Where no board moves, everything is searched.
2. Planes of about the plate's size grow from seeds (`board_in_cloud_planes`).
3. On each plane the plate is placed where it explains most rays: those that end on it, and those
   that cross the plane beside it (`board_in_cloud_judge`).
4. The rectangle of known size is located by its posterior (`rectangle`), and its free sides, its
   filling and what lies around it decide whether it is the board at all.

No `ring` column, scan order or spin axis is used, so any LiDAR and any axes will do; the sensor
must be at the cloud's origin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.calib.board_in_cloud.judge import Plate, locate_plate, place_plate
from percept.calib.board_in_cloud.planes import PlaneCandidate, grow_plane_candidates
from percept.calib.board_in_cloud.pose import plate_points, pose_covariance, rim_of, transform_of
from percept.calib.board_in_cloud.size import Rectangle, best_rectangle, common_size
from percept.calib.board_in_cloud.static import moving_points
from percept.core.errors import ConfigError, GeometryError
from percept.core.settings import Settings

__all__ = ["BoardInCloud", "BoardInCloudConfig", "NoBoardInCloud", "find_boards"]

_SPREADS = (0.7, 1.35)  # of a plane's points, against a plate that is hit evenly
_LOCATED = 3  # plates of the highest coarse score that are located precisely
_COARSE_SCORE = 0.2
_WORTH_LOCATING = 0.6  # of the best coarse score


class BoardInCloudConfig(Settings):
    """What counts as the board.

    Attributes:
        min_range_m: Nearer points are the vehicle or the sensor's own housing.
        max_range_m: Farther points cannot show a plate well enough.
        plane_tolerance_m: Largest distance of a point from its plane: three sigma of
            a coarse LiDAR.
        min_points: Fewer points on the plate do not tell it from clutter.
        max_rms_m: A plate is flat: the sensor's own noise is all that is left.
        max_side_error: Largest error of a side, beyond what the gaps between rays leave open.
        max_side_doubt: Largest error of a side that the gaps may leave open.
        min_explained: Smallest share of the rays around that the plate explains.
        min_fill: Smallest share of the plate's nine parts that hold a point.
        max_side_hits: Largest density of points on the plane beside the plate: a part of a
            wall is no plate.
        min_score: Smallest score. A full plate of 40 points whose sides are open by 15 % each
            has about 0.65; what is sparser or emptier than that is not told from clutter.
        static_from_clouds: So many clouds show which places do not move.
        alternatives: How many other candidates are kept.
    """

    min_range_m: float = Field(default=0.5, ge=0.0, le=10.0)
    max_range_m: float = Field(default=20.0, gt=0.0, le=100.0)
    plane_tolerance_m: float = Field(default=0.04, gt=0.0, le=0.2)
    min_points: int = Field(default=30, ge=10)
    max_rms_m: float = Field(default=0.03, gt=0.0, le=0.1)
    max_side_error: float = Field(default=0.10, gt=0.0, lt=0.5)
    max_side_doubt: float = Field(default=0.35, gt=0.0, lt=1.0)
    min_explained: float = Field(default=0.85, gt=0.0, le=1.0)
    min_fill: float = Field(default=0.75, gt=0.0, le=1.0)
    max_side_hits: float = Field(default=0.5, gt=0.0, le=1.0)
    min_score: float = Field(default=0.65, gt=0.0, le=1.0)
    static_from_clouds: int = Field(default=5, ge=3)
    alternatives: int = Field(default=3, ge=0, le=10)


@dataclass(frozen=True, slots=True, eq=False)
class BoardInCloud:
    """A board that was found in a cloud.

    Attributes:
        name: Of the cloud.
        points: (M, 3) float64 returns on the plate, metres, in the LiDAR's frame.
        T_lidar_plate: (4, 4) plate to LiDAR; x along the width, z towards the sensor. A
            rectangle looks the same turned by 180 deg about z, a square by 90 deg.
        size_found_m: Width and height, measured freely.
        rms_m: Of the points about their plane.
        score: 0..1, by which candidates are ranked: lower bound of the share of rays explained,
            times filling and agreement of the sides.
        explained: Share of the rays on and around the plate that it explains.
        covariance: (6, 6) of a small motion of the plate in its own frame: rotation about x, y,
            z in rad, then translation in metres. From the noise and the gaps between rays;
            a bias of the sensor's range is not in it.
        edge_points: (K, 3) where the rim passes, in the LiDAR's frame: half-way between a ray
            that met the plate and its neighbour that passed it, `bloom_m` moved in.
        edge_sides: (K,) int64 side that each belongs to: 0 -x, 1 +x, 2 -y, 3 +y of the plate.
        edge_sd_m: (K,) how far the rim may be off there, across the side.
        bloom_m: How far outside the rim beams still met the plate.
        hidden_sides: Sides that something before the plate covers or touches, such as the floor
            that it stands on; they did not place the rectangle.
        searched: `what moves` or `everything`: the points that the search began from.
        alternatives: Other candidates of this cloud, by score.
    """

    name: str
    points: NDArray[np.float64]
    T_lidar_plate: NDArray[np.float64]
    size_found_m: tuple[float, float]
    rms_m: float
    score: float
    explained: float
    covariance: NDArray[np.float64]
    edge_points: NDArray[np.float64]
    edge_sides: NDArray[np.int64]
    edge_sd_m: NDArray[np.float64]
    bloom_m: float
    hidden_sides: tuple[int, ...]
    searched: str
    alternatives: tuple[BoardInCloud, ...] = ()


@dataclass(frozen=True, slots=True)
class NoBoardInCloud:
    """A cloud without a board, and why, in words.

    Attributes:
        name: Of the cloud.
        reason: A clause, such as `no plane of 0.85 x 0.61 m; the best is 1.20 x 0.40 m with 44
            points`.
    """

    name: str
    reason: str


@dataclass(frozen=True, slots=True)
class _Miss:
    name: str
    reason: str
    rectangle: Rectangle | None = None


def find_boards(
    clouds: Sequence[NDArray[np.floating]],
    names: Sequence[str],
    plate_size_m: tuple[float, float],
    config: BoardInCloudConfig | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[BoardInCloud | NoBoardInCloud]:
    """Find a plate of known size in each cloud.

    Args:
        clouds: (N, 3 or more) x, y, z in metres in the LiDAR's frame, the sensor at the origin,
            in any order; rows that are not finite are left out.
        names: One for each cloud.
        plate_size_m: Width and height of the plate's outer edges.
        config: Settings; None takes the defaults.
        progress: Called with the number of clouds done.

    Returns:
        For each cloud the board, or why there is none.

    Raises:
        ConfigError: If the size is no size.
        GeometryError: If names and clouds do not go together, or a cloud is not (N, 3+).
    """
    config = config or BoardInCloudConfig()
    _check(clouds, names, plate_size_m)
    usable = [_usable(cloud, config) for cloud in clouds]
    everything = [np.ones(len(cloud), np.bool_) for cloud in usable]
    by_motion = len(usable) >= config.static_from_clouds
    searched = "what moves" if by_motion else "everything"
    starts = moving_points(usable) if by_motion else everything
    found: list[BoardInCloud | _Miss] = []
    for k, (name, cloud) in enumerate(zip(names, usable, strict=True)):
        given = len(clouds[k])
        found.append(_find_in(name, given, cloud, starts[k], searched, plate_size_m, config))
        if progress is not None:
            progress(k + 1)
    if by_motion and _nothing_moves(found):
        found = [
            _find_in(
                one.name, len(clouds[k]), usable[k], everything[k], "everything",
                plate_size_m, config,
            )
            if isinstance(one, _Miss)
            else one
            for k, one in enumerate(found)
        ]  # fmt: skip
    return _with_common_size(found)


def _nothing_moves(found: Sequence[BoardInCloud | _Miss]) -> bool:
    """Return whether no board moves through the clouds, neither of this size nor of another.

    Only then may a board stand where most clouds see it; otherwise a cupboard would be taken
    for the board of a cloud that does not show it.
    """
    boards = sum(isinstance(one, BoardInCloud) for one in found)
    others = [one.rectangle for one in found if isinstance(one, _Miss) and one.rectangle]
    return boards < len(found) / 2 and common_size(others) is None


def _check(
    clouds: Sequence[NDArray[np.floating]], names: Sequence[str], size_m: tuple[float, float]
) -> None:
    if not all(np.isfinite(side) and 0.05 <= side <= 10 for side in size_m):
        raise ConfigError(
            f"a plate of {size_m[0]} x {size_m[1]} m cannot be looked for",
            remedy="Give width and height of its outer edges in metres",
        )
    if len(clouds) != len(names):
        raise GeometryError(f"{len(clouds)} clouds have {len(names)} names")
    for cloud, name in zip(clouds, names, strict=True):
        if np.ndim(cloud) != 2 or np.shape(cloud)[1] < 3:
            raise GeometryError(f"points must be (N, 3), got {np.shape(cloud)}", where=name)


def _usable(cloud: NDArray[np.floating], config: BoardInCloudConfig) -> NDArray[np.float64]:
    points = np.ascontiguousarray(np.asarray(cloud)[:, :3], dtype=np.float64)
    distance = np.linalg.norm(points, axis=1)
    kept: NDArray[np.float64] = points[
        (distance >= config.min_range_m) & (distance <= config.max_range_m)
    ]
    return kept


def _find_in(
    name: str,
    given: int,
    points: NDArray[np.float64],
    starts: NDArray[np.bool_],
    searched: str,
    size_m: tuple[float, float],
    config: BoardInCloudConfig,
) -> BoardInCloud | _Miss:
    if not given:
        return _Miss(name, "empty cloud")
    if len(points) < config.min_points:
        limits = f"{config.min_range_m:g} and {config.max_range_m:g} m"
        return _Miss(name, f"{len(points)} of {given} points lie between {limits}")
    planes = grow_plane_candidates(points, starts, size_m, config.plane_tolerance_m)
    plates = _plates_on(points, planes, size_m, config)
    good = [plate for plate in plates if _refusal(plate, size_m, config) is None]
    if good:
        return _as_board(name, searched, points, good[: config.alternatives + 1], size_m)
    return _miss(name, points, planes, size_m, config)


def _plates_on(
    points: NDArray[np.float64],
    planes: Sequence[PlaneCandidate],
    size_m: tuple[float, float],
    config: BoardInCloudConfig,
) -> list[Plate]:
    """Return the plates that were located on the planes, best first."""
    tolerance = config.plane_tolerance_m
    placed = [
        plate
        for plane in planes
        if _SPREADS[0] < plane.spread < _SPREADS[1]
        and plane.points >= config.min_points / 2
        and (plate := place_plate(points, plane, size_m, tolerance)) is not None
        and plate.score > _COARSE_SCORE
        and plate.points >= config.min_points / 2
    ]
    placed.sort(key=lambda plate: -plate.score)
    worth = [plate for plate in placed if plate.score > _WORTH_LOCATING * placed[0].score]
    located = [locate_plate(points, plate, size_m, tolerance) for plate in worth[:_LOCATED]]
    return sorted((p for p in located if p is not None), key=lambda plate: -plate.score)


def _refusal(plate: Plate, size_m: tuple[float, float], config: BoardInCloudConfig) -> str | None:
    """Return why a plate is not the board, or None."""
    error = np.abs(plate.size_m - size_m)
    beyond = np.maximum(error - plate.slack_m, 0.0) / size_m
    doubt = (error + plate.slack_m) / size_m
    found = f"{plate.size_m[0]:.2f} x {plate.size_m[1]:.2f} m"
    reasons = {
        f"has only {plate.points} points": plate.points < config.min_points,
        f"measures {found}": beyond.max() > config.max_side_error,
        f"measures {found}, too coarsely": doubt.max() > config.max_side_doubt,
        f"is not flat (rms {plate.rms_m * 100:.1f} cm)": plate.rms_m > config.max_rms_m,
        f"has holes ({plate.fill:.0%} filled)": plate.fill < config.min_fill,
        "has both ends of a side covered": bool(
            plate.hidden[:2].all() or plate.hidden[2:].all()
        ),  # its length there is seen nowhere
        "goes on beyond a side": plate.side_hits.max() > config.max_side_hits,
        f"scores {plate.score:.2f}": plate.score < config.min_score,
        f"explains {plate.explained:.0%} of the rays": plate.explained < config.min_explained,
    }
    return next((reason for reason, holds in reasons.items() if holds), None)


def _as_board(
    name: str,
    searched: str,
    points: NDArray[np.float64],
    plates: Sequence[Plate],
    size_m: tuple[float, float],
) -> BoardInCloud:
    """Return the first plate as the board, the others as its alternatives."""
    boards = []
    for plate in plates:
        T = transform_of(plate)
        rim, sides, sd = rim_of(plate, T, size_m)
        boards.append(
            BoardInCloud(
                name=name,
                points=points[plate.rays.rows[plate_points(plate, T, size_m)]],
                T_lidar_plate=T,
                size_found_m=(float(plate.size_m[0]), float(plate.size_m[1])),
                rms_m=plate.rms_m,
                score=plate.score,
                explained=plate.explained,
                covariance=pose_covariance(plate, T, size_m),
                edge_points=rim,
                edge_sides=sides,
                edge_sd_m=sd,
                bloom_m=plate.fit.bloom_m,
                hidden_sides=tuple(int(side) for side in np.flatnonzero(plate.hidden)),
                searched=searched,
            )
        )
    return replace(boards[0], alternatives=tuple(boards[1:]))


def _miss(
    name: str,
    points: NDArray[np.float64],
    planes: Sequence[PlaneCandidate],
    size_m: tuple[float, float],
    config: BoardInCloudConfig,
) -> _Miss:
    """Say that there is no board, and what there is instead."""
    other = best_rectangle(points, planes, size_m, config.plane_tolerance_m, config.min_points)
    reason = f"no plane of {size_m[0]:g} x {size_m[1]:g} m"
    if other is not None:
        reason += f"; the best is {other} with {other.points} points"
    return _Miss(name, reason, other)


def _with_common_size(
    found: Sequence[BoardInCloud | _Miss],
) -> list[BoardInCloud | NoBoardInCloud]:
    """Name the size that the clouds agree on where the one that was given is not found."""
    misses = [f.rectangle for f in found if isinstance(f, _Miss) and f.rectangle is not None]
    common = common_size(misses)
    hint = ""
    if common is not None:
        hint = f"; a rectangle of {common[0]} is in {common[1]} clouds: is the plate's size right?"
    return [NoBoardInCloud(f.name, f.reason + hint) if isinstance(f, _Miss) else f for f in found]
