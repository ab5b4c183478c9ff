"""Checks the tables of a prepared data set: `dataset.json` and what belongs to it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import pyarrow as pa
import pyarrow.parquet as pq

from percept.core.errors import PerceptError
from percept.datasets.labelling.check.inspection import Inspection, Part
from percept.datasets.labelling.check.pictures import IMAGE_SUFFIXES
from percept.datasets.labelling.labelled_set import SPLITS
from percept.datasets.labelling.set_reading import read_set
from percept.datasets.labelling.set_schemas import ABOUT, TABLES

__all__ = ["check_tables", "holds_tables"]

_Row: TypeAlias = dict[str, Any]
_MOST_ROWS = 50_000_000
_SIDES = ("x1_px", "y1_px", "x2_px", "y2_px")
_SOLID = ("x", "y", "z", "length", "width", "height", "yaw_rad")
_MAY_BE_NULL = {
    "rectified_file", "latitude", "longitude", "frame_id", "confidence", "track_id", "box_3d",
    "truncated", "occluded", "vx", "vy", "points", "score", "reason",
}  # fmt: skip


def holds_tables(inspection: Inspection, root: str) -> bool:
    """Return whether a folder holds a prepared data set."""
    files = inspection.folder.files
    return f"{root}{ABOUT}" in files or f"{root}frames.parquet" in files


def check_tables(inspection: Inspection, root: str) -> list[_Row]:
    """Check tables, the files that they name and their boxes.

    Args:
        inspection: Where to tell.
        root: Folder of the tables.

    Returns:
        The rows of frames, for checks of splits.
    """
    check = _Tables(inspection, root)
    before = inspection.problems.errors
    check.run()
    if inspection.problems.errors == before:
        # What no check above has words for, such as the cameras of a drive.
        try:
            read_set(inspection.folder.path(f"{root}{ABOUT}").parent)
        except PerceptError as error:
            inspection.add("table-mismatch", root + ABOUT, error.what)
    return check.frames


class _Tables:
    def __init__(self, inspection: Inspection, root: str) -> None:
        self._inspection = inspection
        self._root = root
        self._part: Part = inspection.part(root, "tables")
        # An import has the labels only; the images stay where they were prepared.
        self._elsewhere = inspection.setting("of") is not None and not inspection.folder.below(
            root, *IMAGE_SUFFIXES
        )
        if not self._elsewhere:
            # A split that was to have no share has no images.
            self._part.stated.update(s for s in SPLITS if inspection.setting("split", s) != 0)
        self._rectified: Part = inspection.part(root, "rectified images")
        self._categories: tuple[str, ...] | None = None
        self._drives: set[str] | None = None
        self.frames: list[_Row] = []

    def run(self) -> None:
        self._read_record()
        self.frames = self._rows("frames")
        keyframes, boxes = self._rows("keyframes"), self._rows("boxes_2d")
        solids = self._rows("boxes_3d")
        for rows, name, key in (
            (self.frames, "frames", "frame"),
            (keyframes, "keyframes", "keyframe"),
            (boxes, "boxes_2d", "box"),
            (solids, "boxes_3d", "box"),
        ):
            self._inspection.check_unique(self._where(name), (r[key] for r in rows), key)
        moments = {row["keyframe"]: row for row in keyframes}
        self._check_keyframes(keyframes)
        self._check_frames(moments)
        self._check_boxes(boxes, {row["box"] for row in solids})
        self._check_solids(solids, moments)
        self._check_tracks(boxes, solids, moments)

    def _where(self, table: str, number: object = None) -> str:
        name = f"{self._root}{table}.parquet"
        return name if number is None else f"{name} {number}"

    def _read_record(self) -> None:
        name = self._root + ABOUT
        record = self._inspection.folder.json(name)
        if record is None:
            return
        found = record.get("categories") if isinstance(record, dict) else None
        drives = record.get("drives") if isinstance(record, dict) else None
        if not isinstance(found, list) or not all(isinstance(one, str) for one in found):
            self._inspection.add("malformed", name, "'categories' is no list of names")
        else:
            self._categories = self._part.classes[name] = tuple(found)
            self._inspection.check_unique(name, found, "class")
        if not isinstance(drives, dict):
            self._inspection.add("malformed", name, "'drives' is no mapping")
        else:
            self._drives = set(drives)

    def _rows(self, table: str) -> list[_Row]:
        """Return the rows of a table without those that lack what they need."""
        name, schema = self._where(table), TABLES[table]
        if not self._inspection.folder.need(name, "the data set"):
            return []
        try:
            path = self._inspection.folder.path(name)
            if pq.ParquetFile(path).metadata.num_rows > _MOST_ROWS:
                raise pa.ArrowInvalid(f"more than {_MOST_ROWS:,} rows")
            read = pq.read_table(path, columns=schema.names).select(schema.names)
            rows: list[_Row] = read.cast(schema).to_pylist()
        except (pa.ArrowException, OSError, KeyError, ValueError) as error:
            first = str(error).splitlines()[0] if str(error) else type(error).__name__
            self._inspection.add("unreadable-file", name, f"no table of a data set ({first})")
            return []
        needed = [n for n in schema.names if n not in _MAY_BE_NULL and n[:5] not in _OPTIONAL]
        whole = [row for row in rows if all(row[column] is not None for column in needed)]
        if len(whole) < len(rows):
            lacking = len(rows) - len(whole)
            self._inspection.add("table-mismatch", name, f"{lacking} rows lack what they need")
        return whole

    def _check_keyframes(self, keyframes: Sequence[_Row]) -> None:
        for row in keyframes:
            where = self._where("keyframes", row["keyframe"])
            self._check_owner(where, row)
            if row["scan_file"] is not None and not self._elsewhere:
                self._named(row["scan_file"], where, self._need_scan)

    def _need_scan(self, name: str, where: str) -> None:
        if not self._inspection.folder.need(name, where):
            return
        if self._inspection.folder.files[name].size % 16:
            self._inspection.add("malformed", where, f"{name} is no rows of four float32")

    def _named(self, name: object, where: str, take: Callable[[str, str], None]) -> None:
        inside = self._inspection.folder.resolve(self._root, name, where)
        if inside is not None:
            take(inside, where)

    def _check_owner(self, where: str, row: _Row) -> None:
        if self._drives is not None and row["drive"] not in self._drives:
            self._inspection.add("unknown-id", where, f"drive '{row['drive']}'")
        if row["split"] not in SPLITS:
            self._inspection.add("unknown-split", where, f"'{row['split']}'")

    def _check_frames(self, moments: dict[int, _Row]) -> None:
        self._inspection.check_unique(
            self._where("frames"), (row["file"] for row in self.frames), "file"
        )
        if self._elsewhere:
            told = f"an import of {self._inspection.setting('of')}"
            self._inspection.add("images-elsewhere", self._where("frames"), told)
        for row in self.frames:
            where, moment = self._where("frames", row["frame"]), moments.get(row["keyframe"])
            self._check_owner(where, row)
            if moment is None:
                self._inspection.add("unknown-id", where, f"keyframe {row['keyframe']}")
            elif moment["split"] != row["split"] or moment["drive"] != row["drive"]:
                self._inspection.add(
                    "split-differs", where, f"{row['split']}, its keyframe {moment['split']}"
                )
            if moment is not None and _place(moment) != _place(row):
                self._inspection.add("table-mismatch", where, "its keyframe is at another place")
            if self._elsewhere:
                continue
            size = (row["width_px"], row["height_px"])
            for column in ("file", "rectified_file"):
                if row[column] is not None:
                    self._list(row, column, size, where)

    def _list(self, row: _Row, column: str, size: tuple[int, int], where: str) -> None:
        name = self._inspection.folder.resolve(self._root, row[column], where)
        if name is None:
            return
        if column == "rectified_file" and row[column] != row["file"]:
            self._inspection.list_image(self._rectified, name, row["split"], where, size=size)
            return
        group = row["keyframe"]
        self._inspection.list_image(self._part, name, row["split"], where, size=size, group=group)
        self._part.splits[f"{row['frame']:06d}"] = row["split"]  # as KITTI numbers them

    def _check_boxes(self, boxes: Sequence[_Row], solids: set[int]) -> None:
        frames = {row["frame"]: row for row in self.frames}
        for row in boxes:
            where, frame = self._where("boxes_2d", row["box"]), frames.get(row["frame"])
            if frame is None:
                self._inspection.add("unknown-id", where, f"frame {row['frame']}")
                continue
            size = (frame["width_px"], frame["height_px"])
            self._inspection.check_box(where, [row[side] for side in _SIDES], size)
            self._check_values(where, row)
            if row["box_3d"] is not None and row["box_3d"] not in solids:
                self._inspection.add("unknown-id", where, f"3D box {row['box_3d']}")
            self._part.count_box(row["label"], frame["split"])

    def _check_values(self, where: str, row: _Row) -> None:
        """Check what boxes in images and in space have in common."""
        if self._categories is not None and row["label"] not in self._categories:
            self._inspection.add("unknown-class", where, f"'{row['label']}'")
        if row["box"] < 1:
            self._inspection.add("bad-id", where, f"box {row['box']}")
        for name in ("confidence", "truncated", "occluded"):
            share = row.get(name)
            if share is not None and not 0 <= share <= 1:
                self._inspection.add("share-range", where, f"{name} {share:g}")

    def _check_solids(self, solids: Sequence[_Row], moments: dict[int, _Row]) -> None:
        for row in solids:
            where = self._where("boxes_3d", row["box"])
            if row["keyframe"] not in moments:
                self._inspection.add("unknown-id", where, f"keyframe {row['keyframe']}")
            self._inspection.check_solid(where, [row[name] for name in _SOLID])
            self._check_values(where, row)
        self._part.solids = len(solids)

    def _check_tracks(
        self, boxes: Sequence[_Row], solids: Sequence[_Row], moments: dict[int, _Row]
    ) -> None:
        """Tell of the objects that have boxes in more than one split."""
        frames = {row["frame"]: row for row in self.frames}
        seen: defaultdict[tuple[str, int], set[str]] = defaultdict(set)
        for rows, owners, key in ((boxes, frames, "frame"), (solids, moments, "keyframe")):
            for row in rows:
                owner = owners.get(row[key])
                if owner is not None and row["track_id"] is not None:
                    seen[owner["drive"], row["track_id"]].add(owner["split"])
        for (drive, track), splits in sorted(seen.items()):
            if len(splits) > 1:
                where = f"{drive}, track {track}"
                self._inspection.add("track-in-splits", where, " and ".join(sorted(splits)))


def _place(row: _Row) -> tuple[float | None, float | None]:
    return row["latitude"], row["longitude"]


_OPTIONAL = ("base_", "scan_")
