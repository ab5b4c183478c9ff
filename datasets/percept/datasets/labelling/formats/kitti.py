"""KITTI's object benchmark: every image is a sample with its own calibration, scan and labels.

Each sample has its camera as `image_2`, also those of other cameras of the same moment: their
samples share the scan and differ in `calib`. The scan's frame is the vehicle's base frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from percept.datasets.labelling.formats.camera_views import CameraView, camera_views
from percept.datasets.labelling.formats.format_readme import write_readme
from percept.datasets.labelling.formats.kitti_boxes import kitti_rows, kitti_types, row_text
from percept.datasets.labelling.formats.kitti_files import (
    KittiLosses,
    calibration_text,
    write_classes,
    write_csv,
)
from percept.datasets.labelling.formats.solid_needs import check_solid_needs, rectified_file
from percept.datasets.labelling.labelled_set import (
    SPLITS,
    Keyframe,
    KeyScan,
    LabelledSet,
    SolidBoxes,
)
from percept.datasets.labelling.placing import place_file

__all__ = ["export_kitti"]

_NAME = "kitti"
_MATRICES = ("R0_rect:", "Tr_velo_to_cam:", "Tr_imu_to_velo:")
_FRAME_COLUMNS = ("sample", "frame", "keyframe", "drive", "camera", "stamp_ns", "split", "file")
_OPENING = (
    "KITTI's object benchmark: `training/` has `image_2`, `label_2`, `calib` and `velodyne`,",
    "`ImageSets/` the samples of each split. Open `training/` with whatever reads KITTI, such as",
    "OpenPCDet, MMDetection3D, CVAT (KITTI) or Datumaro (`kitti` here, `kitti3d` in `training/`).",
    "",
    "- The number of a sample is that of its image in `../frames.parquet`; `frames.csv` says which",
    "  drive, camera, time and split it has. Every camera's images are samples: those of one",
    "  moment share their scan and have each their own `calib`.",
    "- `velodyne` is in the vehicle's base frame: all LiDARs in one cloud. `Tr_velo_to_cam` has",
    "  what the vehicle drove between scan and image.",
    "- `classes.csv` has KITTI's word for each class: its name without white space.",
    "- Images are without distortion, P2 counts pixels from the centre of the first, boxes from",
    "  its outer edge. P0, P1 and P3 repeat P2.",
    "- A rectangle without 3D box has size -1, place -1000 and turn -10. Occluded is 0 up to 10 %",
    "  hidden, 1 up to half, 2 above, 3 unknown; truncated -1 is unknown.",
)


def export_kitti(labelled: LabelledSet, folder: Path) -> tuple[str, ...]:
    """Write a set as KITTI's object benchmark.

    Args:
        labelled: The set; its rectified images are PNG.
        folder: The folder to fill.

    Returns:
        What the format cannot hold, as sentences.

    Raises:
        InputError: If there is no scan, or a camera has no lens, place or rectified PNG.
    """
    check_solid_needs(labelled, _NAME, suffix=".png")
    types, losses = kitti_types(labelled.categories), KittiLosses()
    for name in ("image_2", "label_2", "calib", "velodyne"):
        (folder / "training" / name).mkdir(parents=True)
    rows: list[tuple[object, ...]] = []
    for keyframe in labelled.keyframes:
        if keyframe.scan is None:
            losses.skip(keyframe)
            continue
        views = tuple(camera_views(labelled, keyframe))
        losses.add(views, keyframe.solids)
        for view in views:
            _write_sample(labelled, (keyframe.scan, keyframe.solids, view), types, folder)
            rows.append(_frame_row(keyframe, view))
    _write_lists(folder, rows)
    write_classes(folder, types)
    told = losses.sentences(
        (
            "Track ids, box ids, confidences and sources of boxes: a label has no place for them.",
            "Velocities, poses and positions on the earth.",
        )
    )
    write_readme(folder, "KITTI object detection", _OPENING, told)
    return told


def _write_sample(
    labelled: LabelledSet,
    sample: tuple[KeyScan, SolidBoxes, CameraView],
    types: dict[str, str],
    folder: Path,
) -> None:
    scan, solids, view = sample
    name, training = f"{view.frame.frame:06d}", folder / "training"
    image = labelled.folder / rectified_file(view.frame, _NAME, ".png")
    place_file(image, training / "image_2" / f"{name}.png")
    place_file(labelled.folder / scan.file, training / "velodyne" / f"{name}.bin")
    calibration = calibration_text(view.sensor, view.T_camera_base, _MATRICES)
    (training / "calib" / f"{name}.txt").write_text(calibration, encoding="utf-8")
    lines = [
        row_text(types[label], row) + "\n"
        for label, row in zip(view.boxes.labels, kitti_rows(view, solids), strict=True)
    ]
    (training / "label_2" / f"{name}.txt").write_text("".join(lines), encoding="utf-8")


def _frame_row(keyframe: Keyframe, view: CameraView) -> tuple[object, ...]:
    frame = view.frame
    return (
        f"{frame.frame:06d}", frame.frame, keyframe.keyframe, keyframe.drive, frame.camera,
        frame.stamp_ns, keyframe.split, frame.file,
    )  # fmt: skip


def _write_lists(folder: Path, rows: Sequence[tuple[object, ...]]) -> None:
    write_csv(folder / "frames.csv", _FRAME_COLUMNS, rows)
    (folder / "ImageSets").mkdir()
    for split in SPLITS:
        names = "".join(f"{row[0]}\n" for row in rows if row[6] == split)
        (folder / "ImageSets" / f"{split}.txt").write_text(names, encoding="utf-8")
