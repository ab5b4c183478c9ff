"""How far intrinsics can be trusted, why, and what to capture next.

Every limit is in `percept.calib.limits.CameraLimits`. The residuals come last: they are small for
wrong cameras too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.intrinsics.result import CameraFit, CameraView, ModelTrial
from percept.calib.limits import CameraLimits
from percept.core.results import Verdict

__all__ = ["Finding", "judge", "judge_nothing"]

_F64 = NDArray[np.float64]

_LIMITS = CameraLimits()
_GRAVITY = (Verdict.BAD, Verdict.AMBIGUOUS, Verdict.DOUBTFUL, Verdict.GOOD)
_SIDES = {
    "left": "on the left of",
    "right": "on the right of",
    "top": "high in",
    "bottom": "low in",
}
_ORDINARY_VIEWS = 20
_BOARD_ADVICE = (
    "count the inner corners: a board of 10x7 squares has 9x6 of them, columns first",
    "show the whole board with its white border, sharp and evenly lit",
)
_MOST_ADVICE = 5


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that speaks against a result: how gravely, why, and what to do about it."""

    verdict: Verdict
    why: str
    advice: str | None = None


def judge(
    fit: CameraFit, views: Sequence[CameraView]
) -> tuple[Verdict, tuple[str, ...], tuple[str, ...]]:
    """Return the verdict on a camera, the reasons, and the advice, the gravest first."""
    findings = [
        *_unseen(fit),
        *_poses(fit),
        *_counts(views),
        *_outliers(views),
        *_models(fit),
        *_halves(fit),
        *_bend(fit),
        *_stretch(fit),
        *_uncertainty(fit),
        *_focal(fit),
        *_fold(fit),
        *_residuals(fit),
    ]
    findings.sort(key=lambda finding: _GRAVITY.index(finding.verdict))
    if not findings:
        return Verdict.GOOD, (_praise(fit),), ()
    advice = dict.fromkeys(f.advice for f in findings if f.advice)
    return findings[0].verdict, tuple(f.why for f in findings), tuple(advice)[:_MOST_ADVICE]


def judge_nothing(
    views: Sequence[CameraView], describe_board: str
) -> tuple[Verdict, tuple[str, ...], tuple[str, ...]]:
    """Return verdict, reasons and advice where there are too few views for a camera."""
    boards = [view for view in views if len(view.corners_px)]
    if not boards:
        return Verdict.BAD, (_why_no_board(views, describe_board),), _BOARD_ADVICE
    usable = [view for view in boards if (view.reason or "").startswith("not tried")]
    if len(usable) >= _LIMITS.fewest_views:
        why = f"no camera fits the {len(usable)} views: the corners are not those of a flat board"
        return Verdict.BAD, (why,), ("look at the corners that were found", *_BOARD_ADVICE)
    why = (
        f"{len(usable)} of {len(views)} images can be used: {_LIMITS.fewest_views} views of the "
        f"board are the least, {_ORDINARY_VIEWS} are usual"
    )
    return Verdict.BAD, (why,), (_add_views("all over the image, near and far"),)


def _why_no_board(views: Sequence[CameraView], describe_board: str) -> str:
    """Return why there is no board, with the reason of the images where all share one."""
    reasons = {(view.reason or "").split(":")[0].split("(")[0].strip() for view in views}
    why = f"no {describe_board} found in any of {len(views)} images"
    return f"{why}: {reasons.pop()}" if len(reasons) == 1 else why


def _add_views(where: str, count: int = 4) -> str:
    return f"add {count} views {where}, tilted 30 to 45 deg"


def _unseen(fit: CameraFit) -> Iterator[Finding]:
    for side, share in sorted(fit.coverage.unseen.items(), key=lambda item: -item[1]):
        if share > _LIMITS.unseen_doubtful:
            yield Finding(
                Verdict.BAD if share > _LIMITS.unseen_bad else Verdict.DOUBTFUL,
                f"no board in the {side} {share:.0%} of the image: the lens is guessed there",
                _add_views(f"{_SIDES[side]} the image"),
            )
    if fit.coverage.share < _LIMITS.coverage_good:
        where = _emptiest(fit.coverage.corners)
        yield Finding(
            Verdict.DOUBTFUL,
            f"boards cover {fit.coverage.share:.0%} of the image",
            _add_views(f"{where} the image, close enough to reach its edge"),
        )


def _emptiest(corners: NDArray[np.int64]) -> str:
    """Return the part of the image with the largest share of empty cells, in words."""
    rows, columns = corners.shape
    empty = corners == 0
    parts = {
        "in the upper left of": empty[: rows // 2, : columns // 2],
        "in the upper right of": empty[: rows // 2, columns // 2 :],
        "in the lower left of": empty[rows // 2 :, : columns // 2],
        "in the lower right of": empty[rows // 2 :, columns // 2 :],
    }
    return max(parts, key=lambda part: float(parts[part].mean()))


def _poses(fit: CameraFit) -> Iterator[Finding]:
    facing, tilts = fit.coverage.facing_deg, fit.coverage.tilts_deg
    tilted = int((tilts > _LIMITS.tilted_deg).sum())
    advice = _add_views("to the left and right and up and down in turn", 6)
    if facing < _LIMITS.facing_doubtful_deg:
        bad = facing < _LIMITS.facing_bad_deg
        effect = (
            "focal length and distance cannot be told apart"
            if bad
            else "focal length and distance are hard to tell apart"
        )
        yield Finding(
            Verdict.BAD if bad else Verdict.DOUBTFUL,
            f"all boards face the same way within {facing:.0f} deg: {effect}",
            advice,
        )
    elif tilted < min(_LIMITS.fewest_tilted, len(tilts)):
        yield Finding(
            Verdict.DOUBTFUL,
            f"{tilted} of {len(tilts)} boards are tilted by more than "
            f"{_LIMITS.tilted_deg:.0f} deg: the focal length rests on them alone",
            advice,
        )


def _counts(views: Sequence[CameraView]) -> Iterator[Finding]:
    used = sum(view.used for view in views)
    if used < _LIMITS.few_views:
        yield Finding(
            Verdict.DOUBTFUL,
            f"only {used} views: what is left out says too little, {_ORDINARY_VIEWS} are usual",
            _add_views("all over the image, near and far", _ORDINARY_VIEWS - used),
        )


def _outliers(views: Sequence[CameraView]) -> Iterator[Finding]:
    fitted = [view for view in views if view.rms_px is not None]
    out = [view.name for view in fitted if not view.used]
    share = len(out) / max(len(fitted), 1)
    if share > _LIMITS.outliers_doubtful:
        named = ", ".join(out[:5]) + (" and more" if len(out) > 5 else "")
        yield Finding(
            Verdict.BAD if share > _LIMITS.outliers_bad else Verdict.DOUBTFUL,
            f"{len(out)} of {len(fitted)} views do not fit the others ({named})",
            "look at the views that do not fit: another camera or zoom, a moving or bent board, "
            "or corners found in the wrong order",
        )


def _models(fit: CameraFit) -> Iterator[Finding]:
    chosen = next(trial for trial in fit.models if trial.camera is fit.camera)
    best = min(fit.models, key=lambda trial: trial.validation.holdout_rms_px)
    if not chosen.as_good:
        yield Finding(
            Verdict.BAD
            if chosen.validation.holdout_rms_px > 2 * best.validation.holdout_rms_px
            else Verdict.DOUBTFUL,
            f"the {best.camera.model} model explains left-out views better than "
            f"{chosen.camera.model} ({best.validation.holdout_rms_px:.2f} against "
            f"{chosen.validation.holdout_rms_px:.2f} px)",
            f"use --model {best.camera.model}, or --model auto",
        )
    for other in fit.models:
        if other is chosen or not other.as_good:
            continue
        median, edge = _over_image(_contradiction(chosen, other))
        verdict = _graded(
            fit, median, edge, _LIMITS.model_difference_good, _LIMITS.model_difference_bad,
            _LIMITS.model_edge_good,
        )  # fmt: skip
        if verdict is not None:
            yield Finding(
                verdict,
                f"the {other.camera.model} model explains the views as well as the "
                f"{chosen.camera.model} one and sees things elsewhere: "
                f"by {_px(median)} in the median, {_px(edge)} near the corners of the image",
                _add_views("that reach into the corners of the image"),
            )


def _contradiction(chosen: ModelTrial, other: ModelTrial) -> _F64:
    """Return the difference of two models in pixels, 0 where their uncertainties explain it.

    Where the other model itself knows little, as far from all views, it contradicts nothing.
    """
    sd = np.hypot(chosen.validation.uncertainty_px, other.validation.uncertainty_px)
    with np.errstate(invalid="ignore"):
        contradicts = other.from_chosen_px > _LIMITS.surprise * sd
    return np.where(contradicts, other.from_chosen_px, 0.0)


def _halves(fit: CameraFit) -> Iterator[Finding]:
    halves = fit.validation.halves
    for half in halves[:1]:
        median, edge = half.percentile_px(50), half.percentile_px(95)
        verdict = _graded(
            fit, median, edge, _LIMITS.difference_good, _LIMITS.difference_bad,
            _LIMITS.difference_edge_good,
        )  # fmt: skip
        if verdict is not None:
            yield Finding(
                verdict,
                f"{half.split} give cameras that differ by {_px(median)} in the median and "
                f"{_px(edge)} at the 95th percentile of the image",
                _add_views("that reach into the corners of the image"),
            )
    for half in halves:
        if half.times_expected > _LIMITS.surprise:
            yield Finding(
                Verdict.DOUBTFUL,
                f"{half.split} differ {half.times_expected:.1f} times more than the noise of the "
                "corners explains: the lens model, the board or the images do not agree",
                "check that the board is flat and stiff (or try --board-warp) and that focus and "
                "zoom did not change",
            )


def _bend(fit: CameraFit) -> Iterator[Finding]:
    """Find a bent board: the camera becomes another one when the bend is estimated."""
    deviations = np.abs(fit.bend.values) / np.maximum(fit.bend.sd, 1e-12)
    median, edge = _over_image(fit.bend.moves_px)
    verdict = _graded(
        fit, median, edge, _LIMITS.difference_good, _LIMITS.sd_bad,
        _LIMITS.difference_edge_good,
    )  # fmt: skip
    if deviations.max() > _LIMITS.bend_surprise and verdict is not None:
        yield Finding(
            verdict,
            f"the board seems bent by {1000 * np.abs(fit.bend.values).max():.1f} mm, which moves "
            f"what the camera sees by {_px(median)} in the median",
            "use --board-warp, or a board that is flat and stiff",
        )


def _stretch(fit: CameraFit) -> Iterator[Finding]:
    """Find a print of oblong squares, or views that cannot tell it from oblong pixels.

    A board that is never turned about the line of sight makes the two look alike. Then only square
    pixels, which nearly all cameras have, speak for a square board.
    """
    stretch, sd = float(fit.stretch.values[0]), float(fit.stretch.sd[0])
    median, edge = _over_image(fit.stretch.moves_px)
    verdict = _graded(
        fit, median, edge, _LIMITS.difference_good, _LIMITS.difference_bad,
        _LIMITS.difference_edge_good,
    )  # fmt: skip
    oblong = float(fit.camera.K[0, 0] / fit.camera.K[1, 1]) - 1
    if abs(stretch) > _LIMITS.stretch_surprise * sd and verdict is not None:
        longer, shorter = ("columns", "rows") if stretch > 0 else ("rows", "columns")
        yield Finding(
            verdict,
            f"the board's {longer} seem {abs(stretch):.1%} longer than its {shorter}, which moves "
            f"what the camera sees by {_px(median)} in the median",
            "measure the print along its columns and its rows: many printers stretch one of them",
        )
    elif _LIMITS.oblong_doubtful < abs(oblong) < _LIMITS.stretch_surprise * sd:
        yield Finding(
            Verdict.DOUBTFUL,
            f"fx and fy differ by {abs(oblong):.1%}; the boards were hardly turned about the line "
            "of sight, so that this could as well be a print that is stretched",
            "turn the board by 90 deg in half of the views, and measure the print both ways",
        )


def _uncertainty(fit: CameraFit) -> Iterator[Finding]:
    median, edge = _over_image(fit.validation.uncertainty_px)
    verdict = _graded(fit, median, edge, _LIMITS.sd_good, _LIMITS.sd_bad, _LIMITS.sd_edge_good)
    if verdict is not None:
        yield Finding(
            verdict,
            f"pixels are uncertain by {_px(median)} in the median and {_px(edge)} near the "
            "corners of the image (one standard deviation)",
            _add_views("that reach into the corners of the image"),
        )


def _focal(fit: CameraFit) -> Iterator[Finding]:
    relative = max(fit.sd[f] / fit.camera.K[i, i] for i, f in enumerate(("fx", "fy")))
    if not relative <= _LIMITS.focal_good:
        yield Finding(
            Verdict.DOUBTFUL if relative <= _LIMITS.focal_bad else Verdict.BAD,
            f"the focal length is uncertain by {relative:.2%}",
            _add_views("at different distances"),
        )


def _fold(fit: CameraFit) -> Iterator[Finding]:
    without_ray = float(np.isnan(fit.validation.uncertainty_px).mean())
    folds = fit.camera.widest_rad < np.radians(89.0)
    if folds and without_ray > _LIMITS.fold_share:
        yield Finding(
            Verdict.DOUBTFUL,
            f"the distortion folds back in {without_ray:.0%} of the image, where it has no rays",
            _add_views("that reach into the corners of the image"),
        )


def _residuals(fit: CameraFit) -> Iterator[Finding]:
    if fit.rms_px > _LIMITS.rms_doubtful_px:
        yield Finding(
            Verdict.BAD if fit.rms_px > _LIMITS.rms_bad_px else Verdict.DOUBTFUL,
            f"corners miss by {fit.rms_px:.2f} px (rms)",
            "use a flat, stiff board, hold it still, and check that its size and layout are those "
            "that were given",
        )


def _graded(
    fit: CameraFit, median: float, edge: float, good: float, bad: float, edge_good: float
) -> Verdict | None:
    """Compare pixels with limits that are shares of the image's width."""
    width = fit.camera.image_size[0]
    if not median <= bad * width:
        return Verdict.BAD
    return None if median <= good * width and edge <= edge_good * width else Verdict.DOUBTFUL


def _over_image(values: _F64) -> tuple[float, float]:
    """Return the median and the 95th percentile of what is not NaN."""
    known = values[~np.isnan(values)]
    if not len(known):
        return np.inf, np.inf
    median, edge = np.percentile(known, [50, 95], method="inverted_cdf")
    return float(median), float(edge)


def _px(value: float) -> str:
    return f"{value:.2f} px" if value < 1000 else "more than 1000 px"


def _praise(fit: CameraFit) -> str:
    median, edge = _over_image(fit.validation.uncertainty_px)
    return (
        f"pixels are known to {median:.2f} px in the median and {edge:.2f} px near the corners of "
        f"the image, and boards cover {fit.coverage.share:.0%} of it"
    )
