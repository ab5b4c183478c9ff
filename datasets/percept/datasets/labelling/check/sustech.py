"""Checks SUSTechPOINTS: scenes with scans, images, calibrations and labels of one stem."""

from __future__ import annotations

from typing import Any

from percept.datasets.labelling.check.inspection import UNSPLIT, Inspection, Part
from percept.datasets.labelling.check.pictures import IMAGE_SUFFIXES
from percept.datasets.labels.boxes import as_number

__all__ = ["check_sustech", "holds_sustech"]

_SCANS = (".bin", ".pcd")
_CALIBRATION = {"extrinsic": 16, "intrinsic": 9}
_PARTS = ("position", "scale", "rotation")


def holds_sustech(inspection: Inspection, root: str) -> bool:
    """Return whether a folder holds scenes of SUSTechPOINTS."""
    return bool(_scenes(inspection, root))


def check_sustech(inspection: Inspection, root: str) -> None:
    """Check the scenes of a folder."""
    part = inspection.part(root, "sustech")
    splits: Any = None
    if f"{root}scenes.json" in inspection.folder.files:
        splits = inspection.folder.json(f"{root}scenes.json")
    for scene in _scenes(inspection, root):
        name = scene.rstrip("/").rpartition("/")[2]
        split = splits.get(name) if isinstance(splits, dict) else None
        _Scene(inspection, part, scene, split if isinstance(split, str) else UNSPLIT).check()


def _scenes(inspection: Inspection, root: str) -> list[str]:
    """Return the folders of `data/` that have both `lidar/` and `label/`."""
    folders = inspection.folder.folders
    below = [f for f in folders if f.startswith(f"{root}data/") and f.endswith("/lidar/")]
    scenes = [f.removesuffix("lidar/") for f in below]
    return sorted(scene for scene in scenes if f"{scene}label/" in folders)


class _Scene:
    def __init__(self, inspection: Inspection, part: Part, scene: str, split: str) -> None:
        self._inspection = inspection
        self._folder = inspection.folder
        self._part = part
        self._scene = scene
        self._split = split

    def check(self) -> None:
        """Check everything."""
        scans = self._stems("lidar/", *_SCANS)
        for stem, name in scans.items():
            self._folder.named.add(name)
            if name.endswith(".bin") and self._folder.files[name].size % 16:
                self._inspection.add("malformed", name, "is no rows of four float32")
            if f"{self._scene}label/{stem}.json" not in self._folder.files:
                self._inspection.add("missing-label", name, "label has no such file")
        for stem, name in self._stems("label/", ".json").items():
            if stem not in scans:
                self._inspection.add("stray-label", name, "lidar has no such file")
            self._check_solids(name)
        self._check_cameras(scans)
        for name in self._folder.below(f"{self._scene}label_fusion/", ".json"):
            self._check_rectangles(name)

    def _stems(self, below: str, *suffixes: str) -> dict[str, str]:
        start = f"{self._scene}{below}"
        names = self._folder.below(start, *suffixes)
        return {name[len(start) :].rpartition(".")[0]: name for name in names}

    def _check_cameras(self, scans: dict[str, str]) -> None:
        cameras = set()
        for stem, name in self._stems("camera/", *IMAGE_SUFFIXES).items():
            camera, _, moment = stem.partition("/")
            cameras.add(camera)
            if moment not in scans:
                self._inspection.add("missing-file", name, f"lidar has no {moment}")
            self._inspection.list_image(self._part, name, self._split, name)
        for camera in sorted(cameras):
            self._check_calibration(f"{self._scene}calib/camera/{camera}.json")

    def _check_calibration(self, name: str) -> None:
        if not self._folder.need(name, f"{self._scene}camera/"):
            return
        content = self._folder.json(name)
        for key, length in _CALIBRATION.items():
            value = content.get(key) if isinstance(content, dict) else None
            if not isinstance(value, list) or len(value) != length:
                self._inspection.add("malformed", name, f"{key} is no list of {length} numbers")

    def _check_solids(self, name: str) -> None:
        content = self._folder.json(name)
        if isinstance(content, dict):
            content = content.get("objs")
        if not isinstance(content, list):
            self._inspection.add("malformed", name, "is no list of boxes")
            return
        for index, entry in enumerate(content):
            where = f"{name} [{index}]"
            values = _solid(entry)
            if values is None:
                self._inspection.add("malformed", where, "has no obj_type, or no psr of x, y, z")
            else:
                self._part.solids += 1
                self._inspection.check_solid(where, values)

    def _check_rectangles(self, name: str) -> None:
        content = self._folder.json(name)
        entries = content.get("objs") if isinstance(content, dict) else None
        camera, _, stem = name.rpartition(".")[0].rpartition("/")
        camera = camera.rpartition("/")[2]
        places = (f"{self._scene}camera/{camera}/{stem}{end}" for end in IMAGE_SUFFIXES)
        size = next((self._inspection.size_of(n) for n in places if n in self._folder.files), None)
        for index, entry in enumerate(entries if isinstance(entries, list) else ()):
            where = f"{name} [{index}]"
            rect = entry.get("rect") if isinstance(entry, dict) else None
            if not isinstance(rect, dict):
                self._inspection.add("malformed", where, "has no rect")
                continue
            sides = [as_number(rect.get(key)) for key in ("x1", "y1", "x2", "y2")]
            self._part.count_box(str(entry.get("obj_type")), self._split)
            self._inspection.check_box(where, sides, size)


def _solid(entry: object) -> list[float] | None:
    """Return centre, sizes and rotation of a box; None where it has none."""
    psr = entry.get("psr") if isinstance(entry, dict) else None
    if not isinstance(psr, dict) or not isinstance(entry, dict):
        return None
    parts = [psr.get(name) for name in _PARTS]
    if not isinstance(entry.get("obj_type"), str) or not all(isinstance(p, dict) for p in parts):
        return None
    return [as_number(p.get(axis)) for p in parts if isinstance(p, dict) for axis in "xyz"]
