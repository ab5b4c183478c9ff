"""Which usual mistake explains pairs that do not fit together: each is tried and named."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.calib.camera_lidar.pairs import Sighting
from percept.calib.camera_lidar.seed import CloudPose, Seed, ViewPose, misfit, seed_rig

__all__ = ["likely_mistake", "partner_of"]

_F64 = NDArray[np.float64]

_Views = list[tuple[ViewPose, ...]]
_Clouds = list[tuple[CloudPose, ...]]

_SCALES = tuple(np.round(np.arange(0.6, 1.65, 0.05), 2))
_CONVINCING_SHARE = 0.7
_CONVINCING_GAIN = 1.5
_FEWEST = 4
_STRAYS = 0.15


def likely_mistake(
    sightings: Sequence[Sighting], seed: Seed, *, square_plate: bool
) -> tuple[str, str] | None:
    """Return what explains that the pairs disagree, and what to do; None where nothing does.

    A mistake is named when undoing it brings at least seven of ten pairs together, and half as
    many again as before.

    Args:
        sightings: Pairs in which both sensors found the board.
        seed: The vote over them.
        square_plate: Whether the plate looks the same after a quarter turn.
    """
    views = [s.views for s in sightings]
    clouds = [s.clouds for s in sightings]
    needed = max(
        _FEWEST, _CONVINCING_SHARE * len(views), _CONVINCING_GAIN * float(seed.agreeing.sum())
    )
    best: tuple[float, tuple[str, str]] | None = None
    for trial_views, trial_clouds, words in _trials(views, clouds):
        if len(trial_views) < _FEWEST:
            continue
        trial = seed_rig(trial_views, trial_clouds, square_plate=square_plate)
        if trial.agreeing.sum() >= needed and (best is None or trial.score > best[0]):
            best = (trial.score, words)
    if best is not None:
        return best[1]
    return _two_sets(sightings, seed, square_plate=square_plate)


def _two_sets(
    sightings: Sequence[Sighting], seed: Seed, *, square_plate: bool
) -> tuple[str, str] | None:
    """Return that the pairs that disagree agree with each other, if they do."""
    rest = [s for s, agrees in zip(sightings, seed.agreeing, strict=True) if not agrees]
    if len(rest) < _FEWEST:
        return None
    other = seed_rig([s.views for s in rest], [s.clouds for s in rest], square_plate=square_plate)
    if other.agreeing.sum() < _CONVINCING_SHARE * len(rest):
        return None
    place, strays = _best_split(seed.agreeing)
    if strays <= _STRAYS * len(sightings):
        name = sightings[place].pair.name
        return (
            f"from '{name}' on the pairs agree on another transform than before: a sensor moved",
            "Fix the mounting and record again in one go",
        )
    return (
        "the pairs fall into two sets that each agree on a transform of their own",
        "Calibrate one mounting at a time",
    )


def _best_split(agreeing: NDArray[np.bool_]) -> tuple[int, int]:
    """Return where a row of yes and no changes over, and how many do not fit that."""
    strays = [
        min(
            int((~agreeing[:k]).sum() + agreeing[k:].sum()),
            int(agreeing[:k].sum() + (~agreeing[k:]).sum()),
        )
        for k in range(1, len(agreeing))
    ]
    best = int(np.argmin(strays))
    return best + 1, strays[best]


def partner_of(
    row: int, sightings: Sequence[Sighting], T_camera_lidar: _F64, *, square_plate: bool
) -> str | None:
    """Return the name of the other pair whose cloud fits a pair's image, or None.

    Args:
        row: Row of the pair among the sightings.
        sightings: Pairs in which both sensors found the board.
        T_camera_lidar: (4, 4) transform that most pairs share.
        square_plate: Whether the plate looks the same after a quarter turn.
    """
    misfits = [
        np.inf
        if k == row
        else misfit(T_camera_lidar, sightings[row].views, s.clouds, square_plate=square_plate)
        for k, s in enumerate(sightings)
    ]
    best = int(np.argmin(misfits))
    return sightings[best].pair.name if misfits[best] < 1 else None


def _trials(views: _Views, clouds: _Clouds) -> Iterator[tuple[_Views, _Clouds, tuple[str, str]]]:
    """Yield the pairs with one mistake undone, and its name and remedy."""
    yield (
        [tuple(map(_mirrored, v)) for v in views],
        clouds,
        ("the images look mirrored", "Give the images as the camera took them, not flipped"),
    )
    yield (
        [tuple(map(_quarter_turned, v)) for v in views],
        clouds,
        (
            "rows and columns of the board look swapped against the plate",
            "Give the plate's size as along the columns x along the rows",
        ),
    )
    for shift, word in ((1, "later"), (-1, "earlier")):
        yield (
            views[max(0, -shift) : len(views) - max(0, shift)],
            clouds[max(0, shift) : len(clouds) - max(0, -shift)],
            (
                f"each image fits the cloud one place {word}",
                "Check the order of the files: one is missing or too many",
            ),
        )
    for scale in _SCALES:
        if scale == 1.0:
            continue
        yield (
            [tuple(_scaled(v, float(scale)) for v in of_pair) for of_pair in views],
            clouds,
            (
                f"the board seems about {scale:.2f} times as large as given, or the focal length "
                "is off by as much",
                "Measure a square of the board, and check the intrinsics",
            ),
        )


def _mirrored(view: ViewPose) -> ViewPose:
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    return replace(view, T_camera_plate=flip @ view.T_camera_plate @ flip)


def _quarter_turned(view: ViewPose) -> ViewPose:
    turn = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return replace(view, T_camera_plate=view.T_camera_plate @ turn)


def _scaled(view: ViewPose, scale: float) -> ViewPose:
    T = view.T_camera_plate.copy()
    T[:3, 3] *= scale
    return replace(view, T_camera_plate=T)
