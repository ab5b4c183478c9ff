"""What an exporter is, and the table of them that `--format` chooses from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Literal

from percept.datasets.labelling.labelled_set import LabelledSet

__all__ = ["EXPORTERS", "ExportFormat", "Exporter", "export"]

ExportFormat = Literal[
    "coco", "yolo", "kitti", "kitti-tracking", "nuscenes", "cvat", "label-studio", "openlabel",
    "sustech", "parquet",
]  # fmt: skip
"""The formats, by the names that the command line knows."""

_Export = Callable[[LabelledSet, Path], tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Exporter:
    """What writes one format.

    Attributes:
        module: Module that holds `function`; loaded when it is needed.
        function: Takes the set and the folder to fill, new and empty; returns what the format
            cannot hold, as sentences.
        rectified: Whether its images are those without distortion: it then needs the lens of
            each camera.
        solid: Whether it needs 3D: a scan, and the places of LiDARs and cameras.
        points: Whether it holds points where there are any.
    """

    module: str
    function: str
    rectified: bool = False
    solid: bool = False
    points: bool = False


def _of(module: str, *, solid: bool = False, points: bool = False) -> Exporter:
    return Exporter(
        module=f"percept.datasets.labelling.formats.{module}",
        function=f"export_{module}",
        rectified=solid,
        solid=solid,
        points=points or solid,
    )


EXPORTERS: dict[ExportFormat, Exporter] = {
    "coco": _of("coco"),
    "yolo": _of("yolo"),
    "kitti": _of("kitti", solid=True),
    "kitti-tracking": _of("kitti_tracking", solid=True),
    "nuscenes": _of("nuscenes", solid=True),
    "cvat": _of("cvat"),
    "label-studio": _of("label_studio"),
    "openlabel": _of("openlabel", points=True),
    "sustech": _of("sustech", solid=True),
    "parquet": _of("parquet", points=True),
}
"""All formats. A set is exported to a folder of the format's name below that of the set."""


def export(labelled: LabelledSet, name: ExportFormat, folder: Path) -> tuple[str, ...]:
    """Write a set in a format.

    Args:
        labelled: The set.
        name: The format.
        folder: Folder to fill; made here.

    Returns:
        What the format cannot hold, as sentences.

    Raises:
        InputError: If the set lacks what the format needs.
    """
    exporter = EXPORTERS[name]
    write: _Export = getattr(import_module(exporter.module), exporter.function)
    folder.mkdir(parents=True)
    return write(labelled, folder)
