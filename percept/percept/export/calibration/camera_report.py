"""The report of `percept calib camera`: can the intrinsics be trusted, and where in the image."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.calib.intrinsics.result import (
    CameraCalibration,
    CameraFit,
    CameraView,
    parameter_names,
)
from percept.core.transform import Transform
from percept.export.calibration.pictures import (
    board_overlay,
    contact_sheet,
    coverage_map,
    heat_map,
    residual_quiver,
)
from percept.export.calibration.view import write_calibration_view
from percept.export.charts import histogram
from percept.export.detection_report import installed_versions
from percept.export.pictures import png_data_uri
from percept.export.report import (
    Block,
    Paragraph,
    Picture,
    ReportContent,
    Section,
    Table,
    svg_picture,
)

__all__ = ["camera_calibration_report", "shown_views", "write_camera_view"]

_F64 = NDArray[np.float64]
_Pixels = NDArray[np.generic]

_RANGES_M = (10, 30, 50)
_MOST_PICTURES = 30
_TILT_EDGES_DEG = (0, 10, 20, 30, 40, 50, 60, 90)
_DISTANCE_BINS = 8
_R_VIEW_CAMERA = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # x forward, z up


def shown_views(result: CameraCalibration) -> list[str]:
    """Return the names of the images that the report shows: those left out first, 30 at most."""
    out = [view.name for view in result.views if not view.used][: _MOST_PICTURES // 2]
    used = [view.name for view in result.views if view.used]
    room = _MOST_PICTURES - len(out)
    if len(used) > room:
        used = [used[k] for k in np.linspace(0, len(used) - 1, room).astype(int)]
    return [*out, *used]


def camera_calibration_report(
    result: CameraCalibration,
    images: Mapping[str, _Pixels],
    *,
    inputs: Sequence[Mapping[str, object]],
    settings: Mapping[str, object],
) -> ReportContent:
    """Return the report of a calibration of a camera.

    Args:
        result: What was found.
        images: By view, the pixels of those in `shown_views` that can be read.
        inputs: The files of `run.json`: `path`, `bytes` and what else is known of them.
        settings: The resolved configuration.
    """
    used = sum(view.used for view in result.views)
    fit = result.fit
    sections = [
        *([] if fit is None else _evidence(result, fit)),
        Section("The board in the images", tuple(_boards(result, images))),
        Section("Views", (_views(result),)),
        *([] if fit is None else [Section("Parameters", tuple(_parameters(fit)))]),
        Section("Inputs", (_inputs(inputs),)),
        Section("Settings and versions", (_named(settings), _named(dict(installed_versions())))),
        *([] if fit is None else [Section("Residuals", tuple(_residuals(result, fit)))]),
    ]
    model = "no camera" if fit is None else f"{fit.camera.model} model"
    width, height = result.image_size
    return ReportContent(
        title=f"Intrinsics of {result.name}",
        verdict=result.verdict,
        why=result.why,
        advice=result.advice,
        sections=tuple(sections),
        subtitle=f"{used} of {len(result.views)} views used, {width}x{height} px, {model}",
    )


def write_camera_view(
    path: Path,
    result: CameraCalibration,
    corners_board: _F64,
    images: Mapping[str, _Pixels],
) -> None:
    """Write the camera and the boards before it as a view for rerun.

    Args:
        path: The file.
        result: What was found.
        corners_board: (N, 3) the board's corners in its own frame, metres.
        images: By view, pixels; the first of a view that was used stands before the camera.
    """
    if result.camera is None:
        write_calibration_view(path, clouds={})
        return
    low, high = corners_board.min(axis=0), corners_board.max(axis=0)
    outline = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    boards = {}
    for view in result.views:
        if view.T_camera_board is not None and view.used:
            T = view.T_camera_board
            placed = np.column_stack([outline, np.zeros(4)]) @ T[:3, :3].T + T[:3, 3]
            boards[view.name] = placed @ _R_VIEW_CAMERA.T
    T_view_camera = np.eye(4)
    T_view_camera[:3, :3] = _R_VIEW_CAMERA
    shown = next((v.name for v in result.views if v.used and v.name in images), None)
    write_calibration_view(
        path,
        clouds={},
        images={} if shown is None else {result.name: images[shown]},
        cameras={result.name: (result.camera, Transform("view", result.name, T_view_camera))},
        boards=boards,
    )


def _evidence(result: CameraCalibration, fit: CameraFit) -> list[Section]:
    return [
        Section("Where the boards were", tuple(_coverage(result, fit))),
        Section("How well pixels are known", tuple(_maps(result, fit))),
        Section("What the uncertainty means", tuple(_meaning(fit))),
        Section("Lens models", (_models(fit),)),
    ]


def _picture(image: NDArray[np.uint8], alt: str, caption: str) -> Picture:
    return Picture(png_data_uri(image), alt, caption)


def _coverage(result: CameraCalibration, fit: CameraFit) -> Iterator[Block]:
    used = [view.corners_px for view in result.views if view.used]
    yield _picture(
        coverage_map(result.image_size, used, title="boards in the image"),
        "How many boards cover each part of the image",
        "Hatched: no board was ever there. The lens is extrapolated.",
    )
    tilts = np.histogram(fit.coverage.tilts_deg, bins=_TILT_EDGES_DEG)[0]
    names = [f"{a} to {b}" for a, b in pairwise(_TILT_EDGES_DEG)]
    yield svg_picture(
        histogram("Tilt of the boards", "deg against the line of sight", names, _bars(tilts)),
        "Histogram of the tilts of the boards",
        "Tilted boards separate focal length from distance: 30 to 45 deg is best.",
    )
    distances = fit.coverage.distances_m
    edges = np.linspace(distances.min() * 0.999, distances.max() * 1.001, _DISTANCE_BINS + 1)
    counts = np.histogram(distances, bins=edges)[0]
    places = [f"{(a + b) / 2:.3g}" for a, b in pairwise(edges)]
    yield svg_picture(
        histogram("Distance of the boards", "m, middle of each bin", places, _bars(counts)),
        "Histogram of the distances of the boards",
        "Distances count in units of the board's square; a wrong square changes these alone.",
    )


def _bars(counts: NDArray[np.int64]) -> dict[str, list[int]]:
    return {"views": [int(count) for count in counts]}


def _maps(result: CameraCalibration, fit: CameraFit) -> Iterator[Block]:
    sd = fit.validation.uncertainty_px
    top = _limit(sd)
    size = result.image_size
    yield _picture(
        heat_map(sd, size, "px", (0.0, top), title="standard deviation of the projection"),
        "Map of the standard deviation of the projection",
        "By how much a pixel may be off (one standard deviation). A turn of the whole camera "
        "does not count.",
    )
    for half in fit.validation.halves:
        difference = np.where(np.isinf(half.difference_px), np.nan, half.difference_px)
        yield _picture(
            heat_map(difference, size, "px", (0.0, top), title=half.split),
            f"Map of the projection difference between {half.split}",
            f"Cameras from {half.split}, which share no view, see things this far apart. "
            f"It is {half.times_expected:.1f} times what the noise of the corners explains.",
        )


def _limit(values: _F64) -> float:
    """Return what nine tenths of a map stay below, rounded up to one digit."""
    known = values[np.isfinite(values)]
    rough = max(float(np.percentile(known, 90)), 0.05) if len(known) else 1.0
    digit = 10.0 ** np.floor(np.log10(rough))
    return float(np.ceil(rough / digit) * digit)


def _meaning(fit: CameraFit) -> Iterator[Block]:
    sd = fit.validation.uncertainty_px
    known = sd[np.isfinite(sd)]
    if not len(known):
        yield Paragraph("The camera has no rays in its image.")
        return
    focal = float(fit.camera.K[0, 0])
    places = {
        "middle of the image": float(sd[3:5, 5:7].mean()),
        "median over the image": float(np.median(known)),
        "95 % of the image is better than": float(np.percentile(known, 95)),
        "worst place": float(known.max()),
    }
    rows = tuple(
        (name, f"{px:.2f}", *(f"{100 * px / focal * at:.1f}" for at in _RANGES_M))
        for name, px in places.items()
    )
    yield Paragraph(
        "One standard deviation, in pixels and as a shift of a thing that stands at a range; "
        "pixels near the edges of wide images are worth a little less."
    )
    yield Table(("where", "px", *(f"at {at} m (cm)" for at in _RANGES_M)), rows)


def _models(fit: CameraFit) -> Table:
    rows = []
    for trial in fit.models:
        halves = [f"{half.percentile_px(50):.2f}" for half in trial.validation.halves] or ["", ""]
        apart = trial.from_chosen_px[np.isfinite(trial.from_chosen_px)]
        rows.append(
            (
                trial.camera.model + (" (chosen)" if trial.camera is fit.camera else ""),
                f"{trial.validation.holdout_rms_px:.3f}",
                "yes" if trial.as_good else "no",
                *halves,
                f"{np.median(apart):.2f}" if len(apart) else "no rays",
                f"{trial.rms_px:.3f}",
            )
        )
    return Table(
        (
            "model",
            "error on left-out views (px)",
            "as good as the best",
            "odd and even differ by (px)",
            "first and second half (px)",
            "differs from the chosen one by (px)",
            "rms (px)",
        ),
        tuple(rows),
        "Medians over the image. Models that explain left-out views alike must see things in "
        "the same places, or the views do not cover enough.",
    )


def _boards(result: CameraCalibration, images: Mapping[str, _Pixels]) -> Iterator[Block]:
    shown = [view for view in result.views if view.name in images]
    if not shown:
        yield Paragraph("No image can be shown.")
        return
    shown.sort(key=lambda view: view.used)
    pictures = [board_overlay(images[view.name], view.corners_px) for view in shown]
    titles = [f"{view.name}: {_fate(view)}" for view in shown]
    yield _picture(
        contact_sheet(pictures, titles, columns=4),
        "The images with the corners that were found",
        f"{len(shown)} of {len(result.views)} images, those that were left out first. The line "
        "follows the corners in their order from the large circle.",
    )


def _fate(view: CameraView) -> str:
    if view.used:
        return f"used, {view.rms_px:.2f} px"
    return "left out" if view.reason is None else view.reason


def _views(result: CameraCalibration) -> Table:
    rows = tuple(
        (
            view.name,
            "yes" if view.used else "no",
            f"{len(view.corners_px)}",
            "" if view.tilt_deg is None else f"{view.tilt_deg:.0f}",
            "" if view.distance_m is None else f"{view.distance_m:.2f}",
            "" if view.rms_px is None else f"{view.rms_px:.2f}",
            view.reason or "",
        )
        for view in sorted(result.views, key=lambda view: view.used)
    )
    header = ("image", "used", "corners", "tilt (deg)", "distance (m)", "rms (px)", "why not")
    return Table(header, rows)


def _parameters(fit: CameraFit) -> Iterator[Block]:
    K = fit.camera.K
    values = (K[0, 0], K[1, 1], K[0, 2], K[1, 2], *fit.camera.distortion)
    rows = tuple(
        (name, f"{value:.6g}", f"{fit.sd[name]:.2g}" if name in fit.sd else "fixed")
        for name, value in zip(parameter_names(fit.camera.model), values, strict=True)
    )
    yield Table(("parameter", "value", "standard deviation"), rows, "OpenCV's model and order.")
    along, across = 1000 * fit.bend.values
    sd_along, sd_across = 1000 * fit.bend.sd
    yield Paragraph(
        f"If the board's bend is estimated too, its middle stands {along:.2f} +- {sd_along:.2f} mm "
        f"out along the columns and {across:.2f} +- {sd_across:.2f} mm along the rows. "
        f"If its stretch is, its columns are {fit.stretch.values[0]:.2%} +- "
        f"{fit.stretch.sd[0]:.2%} longer than its rows."
    )


def _inputs(inputs: Sequence[Mapping[str, object]]) -> Table:
    rows = tuple((str(entry["path"]), f"{entry['bytes']}") for entry in inputs)
    return Table(("file", "bytes"), rows)


def _named(values: Mapping[str, object]) -> Table:
    return Table(("name", "value"), tuple((key, str(value)) for key, value in values.items()))


def _residuals(result: CameraCalibration, fit: CameraFit) -> Iterator[Block]:
    used = [view for view in result.views if view.used]
    corners = np.concatenate([view.corners_px for view in used])
    residuals = -np.concatenate([view.residuals_px for view in used])
    yield _picture(
        residual_quiver(result.image_size, corners, residuals, title="found minus projected"),
        "Residuals of all corners as arrows",
        "Arrows without an order are noise; arrows with one are a lens or a board that the "
        "model does not describe.",
    )
    yield Paragraph(
        f"rms {fit.rms_px:.3f} px, {fit.validation.holdout_rms_px:.3f} px on views that were left "
        f"out; {fit.corners_left_out} corners were left out. Small residuals do not make a "
        "calibration good: a camera that is wrong where no board was has them, too."
    )
