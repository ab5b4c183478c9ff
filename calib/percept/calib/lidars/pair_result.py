"""What the registration of a LiDAR pair found, and the means to distrust it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Verdict

__all__ = ["PairRegistration", "Rival"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """Another place of the source that was judged.

    Attributes:
        T_target_source: (4, 4).
        share: Share of the structure, that both must have seen, within 0.1 m.
        violation: Share of it that the other sensor saw through.
        scenes: Scenes whose own best answer it was.
        close: Whether it explains the scenes nearly as well as the answer.
    """

    T_target_source: _F64
    share: float
    violation: float
    scenes: int
    close: bool


@dataclass(frozen=True, slots=True, eq=False)
class PairRegistration:
    """The transform between two LiDARs, with its uncertainty and verdict.

    Attributes:
        T_target_source: (4, 4), or None where nothing could be registered.
        scene_T_target_source: For each scene given, the (4, 4) of that scene alone, started from
            the joint one; None for scenes that were left out.
        sd_translation_m: (3,) standard deviations of the source's origin along the target's axes.
        sd_rotation_deg: (3,) of a small rotation about the target's axes.
        leave_one_out: Largest (move in metres, turn in degrees) when a scene is left out, None
            with one scene.
        rms_m: Robust root mean square distance to the planes; 0 to twice the voxel noise tells
            little about the transform.
        overlap: Share of all points that both must have seen that lies within 0.1 m.
        overlap_05: The same within 0.5 m.
        scenes_agreeing: (scenes whose own best answer is this one, scenes used).
        weak_directions: Directions that the surroundings say little about, in words in the
            target's axes, weakest first.
        information: (6, 6) inverse covariance of rotation (rad), then translation (m), for
            ``R <- exp(w) R``, ``t <- t + s`` along the target's axes.
        structure_share: Share of what stands out of the ground within 0.1 m.
        free_space_violation: Share of it that the other sensor saw through.
        range_offset_m: By how much the source measures farther than the target; the transform
            is that without it.
        range_offset_sd_m: What the clouds let know of it; infinite where they say nothing.
        rivals: Other places, best first.
        verdict: How far to trust it.
        why: Sentences that say why, most important first.
        advice: What to do about it, likewise.
        dropped_points: Points that were not used, by reason.
        scenes_left_out: Reason for each scene (by index) that was not used.
    """

    T_target_source: _F64 | None
    scene_T_target_source: tuple[_F64 | None, ...]  # noqa: N815 - transforms keep their names
    sd_translation_m: _F64
    sd_rotation_deg: _F64
    leave_one_out: tuple[float, float] | None
    rms_m: float
    overlap: float
    overlap_05: float
    scenes_agreeing: tuple[int, int]
    weak_directions: tuple[str, ...]
    information: _F64
    structure_share: float
    free_space_violation: float
    range_offset_m: float
    range_offset_sd_m: float
    rivals: tuple[Rival, ...]
    verdict: Verdict
    why: tuple[str, ...]
    advice: tuple[str, ...]
    dropped_points: Mapping[str, int]
    scenes_left_out: Mapping[int, str]
