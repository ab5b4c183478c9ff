"""What a calibration of a camera says, with the means to distrust it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.calib.intrinsics.coverage import Coverage
from percept.calib.intrinsics.validation import Validation
from percept.core.cameras import Camera
from percept.core.results import Verdict

__all__ = [
    "BoardShape",
    "CameraCalibration",
    "CameraFit",
    "CameraView",
    "ModelTrial",
    "parameter_names",
]

_F64 = NDArray[np.float64]

_NAMES = {
    "pinhole": ("k1", "k2", "p1", "p2", "k3"),
    "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}


@dataclass(frozen=True, slots=True, eq=False)
class CameraView:
    """One view and what became of it.

    Attributes:
        name: Name of the image.
        used: Whether the camera was fitted to it.
        reason: Why not, or None.
        corners_px: (N, 2) float64 corners that were found; (0, 2) without a board.
        residuals_px: (N, 2) float64 projected minus seen for the corners that were used; NaN for
            the others and for views that no pose was found for.
        rms_px: Root mean square length of the residuals, or None.
        tilt_deg: Between the board's normal and the line of sight, or None.
        distance_m: To the board's middle, or None.
        T_camera_board: (4, 4) pose of the board, or None.
    """

    name: str
    used: bool
    reason: str | None
    corners_px: _F64
    residuals_px: _F64
    rms_px: float | None = None
    tilt_deg: float | None = None
    distance_m: float | None = None
    T_camera_board: _F64 | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ModelTrial:
    """A lens model that was fitted to the views.

    Attributes:
        camera: The camera.
        rms_px: Over the views that were used.
        validation: What left-out views say.
        as_good: Whether it explains left-out views as well as the best model does.
        from_chosen_px: (rows, columns) how differently it projects from the model that was chosen,
            after a rotation; zero for the chosen one, infinite where it has no ray.
    """

    camera: Camera
    rms_px: float
    validation: Validation
    as_good: bool
    from_chosen_px: _F64


@dataclass(frozen=True, slots=True, eq=False)
class BoardShape:
    """What the board would be like if that was estimated, too.

    Attributes:
        values: (N,) what was estimated.
        sd: (N,) its standard deviation.
        moves_px: (rows, columns) how differently the camera projects then, after a rotation; zero
            where it is part of the fit.
    """

    values: _F64
    sd: _F64
    moves_px: _F64


@dataclass(frozen=True, slots=True, eq=False)
class CameraFit:
    """The camera that was chosen, and how well it is known.

    Attributes:
        camera: The camera.
        sd: Standard deviation of fx, fy, cx, cy and each coefficient that was estimated.
        noise_px: Standard deviation of a corner along one axis.
        rms_px: Root mean square length of the residuals.
        validation: What left-out views say, and the projection's uncertainty.
        coverage: What the views cover.
        models: All models that were tried.
        corners_left_out: Corners of used views that stood out and were not used.
        bend: By how much the board's middle stands out of its edges along columns and rows, metres.
        stretch: By which share the board's columns are longer than its rows, beyond what was given.
    """

    camera: Camera
    sd: dict[str, float]
    noise_px: float
    rms_px: float
    validation: Validation
    coverage: Coverage
    models: tuple[ModelTrial, ...]
    corners_left_out: int
    bend: BoardShape
    stretch: BoardShape


@dataclass(frozen=True, slots=True, eq=False)
class CameraCalibration:
    """A calibrated camera, or the reasons why there is none.

    Attributes:
        name: Name of the camera.
        image_size: (width, height) in pixels of the views that count; (0, 0) without a view.
        fit: The camera; None where there were too few views.
        verdict: How far it can be trusted.
        why: The reasons, the weightiest first.
        advice: What to capture next.
        views: Every view that was given, and what became of it.
    """

    name: str
    image_size: tuple[int, int]
    fit: CameraFit | None
    verdict: Verdict
    why: tuple[str, ...]
    advice: tuple[str, ...]
    views: tuple[CameraView, ...]

    @property
    def camera(self) -> Camera | None:
        """The camera, or None."""
        return None if self.fit is None else self.fit.camera

    def as_dict(self) -> dict[str, Any]:
        """Return the JSON document of `percept calib camera`; what is not known is None."""
        return {
            "camera": self.name,
            "image_size": list(self.image_size),
            **_fit_as_dict(self.fit),
            "verdict": str(self.verdict),
            "why": "; ".join(self.why),
            "advice": list(self.advice),
            "views": [
                {
                    "name": view.name,
                    "used": view.used,
                    "rms_px": _number(view.rms_px),
                    "reason": view.reason,
                    "tilt_deg": _number(view.tilt_deg),
                    "distance_m": _number(view.distance_m),
                }
                for view in self.views
            ],
        }


def parameter_names(model: str) -> tuple[str, ...]:
    """Return the names of fx, fy, cx, cy and the coefficients of a model, in order."""
    return ("fx", "fy", "cx", "cy", *_NAMES[model])


def _fit_as_dict(fit: CameraFit | None) -> dict[str, Any]:
    keys = ("model", "K", "distortion", "rms_px", "holdout_rms_px", "projection_diff_px", "sd")
    if fit is None:
        return {**dict.fromkeys(keys), "coverage": None}
    halves = {
        half.split: {
            "median": _number(half.percentile_px(50)),
            "p95": _number(half.percentile_px(95)),
            "max": _number(half.percentile_px(100)),
            "times_expected": _number(half.times_expected),
        }
        for half in fit.validation.halves
    }
    unknown = {"median": None, "p95": None, "max": None, "times_expected": None}
    sd_map = fit.validation.uncertainty_px
    return {
        "model": fit.camera.model,
        "K": fit.camera.K.tolist(),
        "distortion": fit.camera.distortion.tolist(),
        "rms_px": _number(fit.rms_px),
        "holdout_rms_px": _number(fit.validation.holdout_rms_px),
        "projection_diff_px": next(iter(halves.values()), unknown),
        "projection_diff_by_split_px": halves,
        "projection_sd_px": {
            "median": _percentile(sd_map, 50),
            "p95": _percentile(sd_map, 95),
            "max": _percentile(sd_map, 100),
        },
        "sd": {name: _number(value) for name, value in fit.sd.items()},
        "noise_px": _number(fit.noise_px),
        "coverage": _number(fit.coverage.share),
        "unseen": {side: _number(share) for side, share in fit.coverage.unseen.items()},
        "corners_left_out": fit.corners_left_out,
        "board_bend_mm": [_number(1000 * bend) for bend in fit.bend.values],
        "board_stretch": _number(float(fit.stretch.values[0])),
        "board_stretch_sd": _number(float(fit.stretch.sd[0])),
        "models": [_model_as_dict(trial) for trial in fit.models],
    }


def _model_as_dict(trial: ModelTrial) -> dict[str, Any]:
    return {
        "model": trial.camera.model,
        "K": trial.camera.K.tolist(),
        "distortion": trial.camera.distortion.tolist(),
        "rms_px": _number(trial.rms_px),
        "holdout_rms_px": _number(trial.validation.holdout_rms_px),
        "as_good": trial.as_good,
        "from_chosen_px": _percentile(trial.from_chosen_px, 50),
    }


def _percentile(values: _F64, percent: float) -> float | None:
    """Return a percentile of what is not NaN, infinities included, as a JSON number."""
    known = values[~np.isnan(values)]
    if not len(known):
        return None
    return _number(float(np.percentile(known, percent, method="inverted_cdf")))


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
