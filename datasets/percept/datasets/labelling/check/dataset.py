"""Checks a data set in a folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from percept.core.errors import InputError
from percept.core.results import Verdict
from percept.datasets.labelling.check.coco import check_coco, holds_coco
from percept.datasets.labelling.check.cvat import check_cvat, holds_cvat
from percept.datasets.labelling.check.folder import Folder
from percept.datasets.labelling.check.inspection import Inspection, Part
from percept.datasets.labelling.check.kitti import (
    check_kitti,
    check_kitti_tracking,
    holds_kitti,
    holds_kitti_tracking,
)
from percept.datasets.labelling.check.label_studio import check_label_studio, holds_label_studio
from percept.datasets.labelling.check.leaks import (
    check_alike,
    check_empty_splits,
    check_places,
    check_same_bytes,
    check_split_names,
)
from percept.datasets.labelling.check.nuscenes import check_nuscenes, holds_nuscenes
from percept.datasets.labelling.check.openlabel import check_openlabel, holds_openlabel
from percept.datasets.labelling.check.problems import CODES, SEVERITIES, Problem, Problems, plain
from percept.datasets.labelling.check.sustech import check_sustech, holds_sustech
from percept.datasets.labelling.check.tables import check_tables, holds_tables
from percept.datasets.labelling.check.yolo import check_yolo, holds_yolo
from percept.datasets.labelling.formats.xml_text import xml_text

__all__ = ["CheckResult", "check_dataset"]

_Holds = Callable[[Inspection, str], bool]
_Check = Callable[[Inspection, str], None]
_FORMATS: dict[str, tuple[_Holds, _Check]] = {
    "coco": (holds_coco, check_coco),
    "yolo": (holds_yolo, check_yolo),
    "kitti": (holds_kitti, check_kitti),
    "kitti-tracking": (holds_kitti_tracking, check_kitti_tracking),
    "nuscenes": (holds_nuscenes, check_nuscenes),
    "cvat": (holds_cvat, check_cvat),
    "label-studio": (holds_label_studio, check_label_studio),
    "openlabel": (holds_openlabel, check_openlabel),
    "sustech": (holds_sustech, check_sustech),
}
"""What tells that a folder holds a format, and what checks it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckResult:
    """What is wrong with a data set, and what is in it.

    Attributes:
        problems: The weightiest kinds first, of each kind a thousand at most.
        found: Number of problems of each kind, by code.
        histogram: Boxes in images by class and split, of the tables where there are any.
        images: Images by split, of the tables where there are any.
        formats: Images and boxes in images of each part of the folder.
        counts: Number of files, images, boxes in images and 3D boxes.
    """

    problems: tuple[Problem, ...]
    found: Mapping[str, int]
    histogram: Mapping[str, Mapping[str, int]]
    images: Mapping[str, int]
    formats: Mapping[str, Mapping[str, int]]
    counts: Mapping[str, int]

    @property
    def verdict(self) -> Verdict:
        """Bad with an error, doubtful with a warning."""
        worst = {CODES[code].severity for code in self.found}
        if "error" in worst:
            return Verdict.BAD
        return Verdict.DOUBTFUL if "warning" in worst else Verdict.GOOD

    @property
    def why(self) -> tuple[str, ...]:
        """The reasons for the verdict: what was found, the weightiest first."""
        kinds = [
            f"{number:,} x {code}: {CODES[code].means}"
            for severity in SEVERITIES[:2]
            for code, number in self.found.items()
            if CODES[code].severity == severity
        ]
        return tuple(kinds) or ("nothing is wrong with it",)


def check_dataset(folder: Path) -> CheckResult:
    """Check a prepared data set with all its formats, or a folder in a format of others.

    Nothing outside the folder is opened, whatever names and links in it say.

    Args:
        folder: The folder.

    Raises:
        InputError: If there is no such folder, or it holds nothing that is known.
    """
    problems = Problems()
    inspection = Inspection(Folder(folder, problems), problems)
    prepared = holds_tables(inspection, "")
    if prepared:
        _check_prepared(inspection)
    else:
        _check_format(inspection, "", tuple(_FORMATS))
    if not inspection.parts:
        raise InputError(
            "holds no data set that is known",
            where=folder,
            remedy=f"Give a folder of `percept dataset prepare`, or one of {', '.join(_FORMATS)}",
        )
    inspection.read_images()
    _check_across(inspection, prepared=prepared)
    inspection.report_strays()
    return _result(inspection)


def _check_prepared(inspection: Inspection) -> None:
    if "run.json" not in inspection.folder.files:
        inspection.add("no-record", "run.json", "is not there")
    check_places(inspection, check_tables(inspection, ""))
    if holds_tables(inspection, "parquet/"):
        check_tables(inspection, "parquet/")
    for name in _FORMATS:
        if f"{name}/" in inspection.folder.folders:
            before = len(inspection.parts)
            _check_format(inspection, f"{name}/", (name,))
            if len(inspection.parts) == before:
                inspection.add("missing-file", f"{name}/", f"nothing in it is {name}")


def _check_format(inspection: Inspection, root: str, names: tuple[str, ...]) -> None:
    for name in names:
        holds, check = _FORMATS[name]
        if holds(inspection, root):
            check(inspection, root)


def _check_across(inspection: Inspection, *, prepared: bool) -> None:
    first = inspection.parts[0]
    for part in inspection.parts:
        check_same_bytes(inspection, part)
        if part is first or not prepared:
            check_alike(inspection, part)
            check_empty_splits(inspection, part)
        elif part.splits:
            check_split_names(inspection, first, part)
    _check_class_order(inspection)


def _check_class_order(inspection: Inspection) -> None:
    lists = [(name, row) for part in inspection.parts for name, row in part.classes.items()]
    for name, classes in lists[1:]:
        first, expected = lists[0]
        # XML has no control characters, and tools strip white space.
        if [xml_text(one).strip() for one in classes] != [xml_text(x).strip() for x in expected]:
            told = f"{_listed(classes)}; in {first}: {_listed(expected)}"
            inspection.add("class-order", name, told)


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names[:12]) + (" ..." if len(names) > 12 else "")


def _result(inspection: Inspection) -> CheckResult:
    first = inspection.parts[0]
    histogram = first.boxes
    images = Counter(image.split for image in first.images.values())
    return CheckResult(
        problems=inspection.problems.all(),
        found=inspection.problems.counts,
        histogram={plain(label): _plain_keys(row) for label, row in sorted(histogram.items())},
        images=_plain_keys(images),
        formats=_formats(inspection.parts),
        counts={
            "files": len(inspection.folder.files),
            "images": len(first.images),
            "boxes": sum(row.total() for row in histogram.values()),
            "boxes_3d": first.solids,
        },
    )


def _plain_keys(counts: Mapping[str, int]) -> dict[str, int]:
    return {plain(name): number for name, number in counts.items()}


def _formats(parts: list[Part]) -> dict[str, dict[str, int]]:
    return {
        plain(part.name): {
            "images": len(part.images),
            "boxes": sum(row.total() for row in part.boxes.values()),
        }
        for part in parts
    }
