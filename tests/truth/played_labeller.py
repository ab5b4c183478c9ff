"""Scripts that play a labeller: they change an export in the format's own files, as tools do."""

from __future__ import annotations

import copy
import json
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import yaml
from lxml import etree

from percept.datasets.labelling.labelled_set import LabelledFrame, LabelledSet

__all__ = ["LABELLERS", "KittiLabeller", "Labeller", "VideoLabeller"]

Sides = tuple[float, float, float, float]


class Labeller(ABC):
    """Changes boxes of an export; a box is known by its image and its row there.

    Args:
        folder: The export.
        labelled: The set that it is of.
    """

    def __init__(self, folder: Path, labelled: LabelledSet) -> None:
        self.folder = folder
        self.labelled = labelled
        self.open()

    @abstractmethod
    def open(self) -> None:
        """Read the files."""

    @abstractmethod
    def move(self, frame: LabelledFrame, row: int, dx: float, dy: float) -> None:
        """Drag a box."""

    @abstractmethod
    def relabel(self, frame: LabelledFrame, row: int, label: str) -> None:
        """Give a box another class."""

    @abstractmethod
    def delete(self, frame: LabelledFrame, row: int) -> None:
        """Take a box away."""

    @abstractmethod
    def add(self, frame: LabelledFrame, box_px: Sides, label: str) -> None:
        """Draw a box."""

    @abstractmethod
    def save(self) -> Path:
        """Write the files and return what a user would name to the import."""


class _Coco(Labeller):
    def open(self) -> None:
        self.files = {
            path: json.loads(path.read_text())
            for path in (self.folder / "annotations").glob("*.json")
        }

    def move(self, frame: LabelledFrame, row: int, dx: float, dy: float) -> None:
        _, annotation = self._find(frame, row)
        annotation["bbox"][0] += dx
        annotation["bbox"][1] += dy

    def relabel(self, frame: LabelledFrame, row: int, label: str) -> None:
        document, annotation = self._find(frame, row)
        annotation["category_id"] = self._category(document, label)

    def delete(self, frame: LabelledFrame, row: int) -> None:
        document, annotation = self._find(frame, row)
        document["annotations"].remove(annotation)

    def add(self, frame: LabelledFrame, box_px: Sides, label: str) -> None:
        x1, y1, x2, y2 = box_px
        for document in self.files.values():
            for image in document["images"]:
                if Path(image["file_name"]).stem == frame.stem:
                    largest = max(one["id"] for one in document["annotations"])
                    document["annotations"].append(
                        {
                            "id": largest + 10_000,
                            "image_id": image["id"],
                            "category_id": self._category(document, label),
                            "bbox": [x1, y1, x2 - x1, y2 - y1],
                        }
                    )

    def save(self) -> Path:
        for path, document in self.files.items():
            path.unlink()
            path.write_text(json.dumps(document))
        return self.folder

    def _find(self, frame: LabelledFrame, row: int) -> tuple[dict[str, Any], dict[str, Any]]:
        number = int(frame.boxes.ids[row])
        return next(
            (document, one)
            for document in self.files.values()
            for one in document["annotations"]
            if one["id"] == number
        )

    def _category(self, document: dict[str, Any], label: str) -> int:
        return {str(one["name"]): int(one["id"]) for one in document["categories"]}[label]


class _Lines(Labeller):
    """A text file an image, a line a box, in the order of the boxes."""

    def open(self) -> None:
        self.lines: dict[int, list[list[str] | None]] = {}

    def delete(self, frame: LabelledFrame, row: int) -> None:
        self._of(frame)[row] = None

    def save(self) -> Path:
        for _, frame in self.labelled.frames():
            if frame.frame in self.lines:
                kept = [" ".join(words) for words in self.lines[frame.frame] if words is not None]
                self.path(frame).write_text("".join(f"{line}\n" for line in kept))
        return self.folder

    @abstractmethod
    def path(self, frame: LabelledFrame) -> Path:
        """Return the file of an image."""

    def _of(self, frame: LabelledFrame) -> list[list[str] | None]:
        if frame.frame not in self.lines:
            lines = self.path(frame).read_text().splitlines()
            self.lines[frame.frame] = [line.split() for line in lines]
        return self.lines[frame.frame]

    def _words(self, frame: LabelledFrame, row: int) -> list[str]:
        words = self._of(frame)[row]
        assert words is not None
        return words


class _Yolo(_Lines):
    def path(self, frame: LabelledFrame) -> Path:
        return next((self.folder / "labels").glob(f"*/{frame.stem}.txt"))

    def move(self, frame: LabelledFrame, row: int, dx: float, dy: float) -> None:
        words = self._words(frame, row)
        for at, step, side in ((1, dx, 0), (2, dy, 1)):
            words[at] = f"{float(words[at]) + step / frame.image_size[side]:.8f}"

    def relabel(self, frame: LabelledFrame, row: int, label: str) -> None:
        self._words(frame, row)[0] = self._number(label)

    def add(self, frame: LabelledFrame, box_px: Sides, label: str) -> None:
        (x1, y1, x2, y2), (w, h) = box_px, frame.image_size
        shares = ((x1 + x2) / 2 / w, (y1 + y2) / 2 / h, (x2 - x1) / w, (y2 - y1) / h)
        self._of(frame).append([self._number(label), *(f"{share:.8f}" for share in shares)])

    def _number(self, label: str) -> str:
        names = yaml.safe_load((self.folder / "data.yaml").read_text())["names"]
        return str(next(number for number, name in names.items() if name == label))


class KittiLabeller(_Lines):
    """Works on the label files of KITTI."""

    def path(self, frame: LabelledFrame) -> Path:
        return self.folder / "training" / "label_2" / f"{frame.frame:06d}.txt"

    def move(self, frame: LabelledFrame, row: int, dx: float, dy: float) -> None:
        words = self._words(frame, row)
        for at, step in ((4, dx), (5, dy), (6, dx), (7, dy)):
            words[at] = f"{float(words[at]) + step:.2f}"

    def move_solid(self, frame: LabelledFrame, row: int, dx: float, dz: float) -> None:
        """Drag a 3D box in the camera's frame, metres."""
        words = self._words(frame, row)
        words[11], words[13] = f"{float(words[11]) + dx:.2f}", f"{float(words[13]) + dz:.2f}"

    def relabel(self, frame: LabelledFrame, row: int, label: str) -> None:
        self._words(frame, row)[0] = label

    def add(self, frame: LabelledFrame, box_px: Sides, label: str) -> None:
        place = "-1 -1 -1 -1000 -1000 -1000 -10"
        self._of(frame).append(f"{label} 0 0 -10 {' '.join(map(str, box_px))} {place}".split())

    def add_solid(self, frame: LabelledFrame, box_px: Sides, label: str, solid: str) -> None:
        """Draw a rectangle with a 3D box: h w l x y z ry."""
        self._of(frame).append(f"{label} 0 0 0 {' '.join(map(str, box_px))} {solid}".split())


class _Cvat(Labeller):
    def open(self) -> None:
        self.path = self.folder / "images" / "annotations.xml"
        self.tree = etree.parse(str(self.path))

    def move(self, frame: LabelledFrame, row: int, dx: float, dy: float) -> None:
        _shift(self._boxes(frame)[row], dx, dy)

    def relabel(self, frame: LabelledFrame, row: int, label: str) -> None:
        self._boxes(frame)[row].set("label", label)

    def delete(self, frame: LabelledFrame, row: int) -> None:
        self._image(frame).remove(self._boxes(frame)[row])

    def add(self, frame: LabelledFrame, box_px: Sides, label: str) -> None:
        said = {"label": label, "source": "manual", "occluded": "0", "z_order": "0"}
        box = etree.SubElement(self._image(frame), "box", said)
        _place(box, box_px)
        for name in ("box_id", "object_id", "score", "model"):  # as CVAT writes what is empty
            etree.SubElement(box, "attribute", {"name": name}).text = ""

    def save(self) -> Path:
        self.tree.write(str(self.path), encoding="utf-8", xml_declaration=True)
        return self.path

    def _image(self, frame: LabelledFrame) -> etree._Element:
        images = self.tree.iterfind("image")
        return next(one for one in images if Path(str(one.get("name"))).stem == frame.stem)

    def _boxes(self, frame: LabelledFrame) -> list[etree._Element]:
        return self._image(frame).findall("box")


class VideoLabeller(Labeller):
    """Works on the tracks of CVAT's videos."""

    def open(self) -> None:
        self.trees = {
            path: etree.parse(str(path))
            for path in (self.folder / "video").glob("*/annotations.xml")
        }

    def move(self, frame: LabelledFrame, row: int, dx: float, dy: float) -> None:
        _shift(self._box(frame, row)[1], dx, dy)

    def relabel(self, frame: LabelledFrame, row: int, label: str) -> None:
        self._box(frame, row)[0].set("label", label)

    def delete(self, frame: LabelledFrame, row: int) -> None:
        self._box(frame, row)[1].set("outside", "1")

    def add(self, frame: LabelledFrame, box_px: Sides, label: str) -> None:
        tree, number = self._place_of(frame)
        said = {"id": "7", "label": label, "source": "manual"}
        track = etree.SubElement(tree.getroot(), "track", said)
        for at, outside in ((number, "0"), (number + 1, "1")):
            said = {"frame": str(at), "outside": outside, "keyframe": "1", "occluded": "0"}
            _place(etree.SubElement(track, "box", said), box_px)

    def save(self) -> Path:
        for path, tree in self.trees.items():
            tree.write(str(path), encoding="utf-8", xml_declaration=True)
        return self.folder / "video"

    def _box(self, frame: LabelledFrame, row: int) -> tuple[etree._Element, etree._Element]:
        number = str(int(frame.boxes.ids[row]))
        return next(
            (track, box)
            for tree in self.trees.values()
            for track in tree.iterfind("track")
            for box in track.iterfind("box")
            if any(a.get("name") == "box_id" and a.text == number for a in box)
        )

    def _place_of(self, frame: LabelledFrame) -> tuple[Any, int]:
        for path, tree in self.trees.items():
            names = sorted(one.name for one in (path.parent / "images").iterdir())
            for number, name in enumerate(names):
                if frame.stem in name:
                    return tree, number
        raise AssertionError(frame.stem)


class _LabelStudio(Labeller):
    def open(self) -> None:
        self.tasks = json.loads((self.folder / "tasks.json").read_text())
        for number, task in enumerate(self.tasks):
            result = [copy.deepcopy(one) for p in task["predictions"] for one in p["result"]]
            task["annotations"] = [
                {"id": number, "was_cancelled": False, "updated_at": "2026-03-01T10:00:00.1Z",
                 "result": result}
            ]  # fmt: skip

    def move(self, frame: LabelledFrame, row: int, dx: float, dy: float) -> None:
        value = self._result(frame)[row]["value"]
        value["x"] += 100 * dx / frame.image_size[0]
        value["y"] += 100 * dy / frame.image_size[1]

    def relabel(self, frame: LabelledFrame, row: int, label: str) -> None:
        self._result(frame)[row]["value"]["rectanglelabels"] = [label]

    def delete(self, frame: LabelledFrame, row: int) -> None:
        del self._result(frame)[row]

    def add(self, frame: LabelledFrame, box_px: Sides, label: str) -> None:
        (x1, y1, x2, y2), (w, h) = box_px, frame.image_size
        self._result(frame).append(
            {
                "id": "gKq3_X1-hT",
                "type": "rectanglelabels",
                "original_width": w,
                "original_height": h,
                "image_rotation": 0,
                "value": {
                    "x": 100 * x1 / w,
                    "y": 100 * y1 / h,
                    "width": 100 * (x2 - x1) / w,
                    "height": 100 * (y2 - y1) / h,
                    "rotation": 0,
                    "rectanglelabels": [label],
                },
            }
        )

    def save(self) -> Path:
        path = self.folder / "project-1-at-2026-03-01.json"
        path.write_text(json.dumps(self.tasks))
        return path

    def _result(self, frame: LabelledFrame) -> list[dict[str, Any]]:
        task = next(one for one in self.tasks if frame.stem in one["data"]["image"])
        result: list[dict[str, Any]] = task["annotations"][0]["result"]
        return result


def _shift(box: etree._Element, dx: float, dy: float) -> None:
    for name, step in (("xtl", dx), ("xbr", dx), ("ytl", dy), ("ybr", dy)):
        box.set(name, f"{float(box.attrib[name]) + step:.2f}")


def _place(box: etree._Element, box_px: Sides) -> None:
    for name, side in zip(("xtl", "ytl", "xbr", "ybr"), box_px, strict=True):
        box.set(name, f"{side:.2f}")


LABELLERS: dict[str, type[Labeller]] = {
    "coco": _Coco,
    "yolo": _Yolo,
    "kitti": KittiLabeller,
    "cvat": _Cvat,
    "label-studio": _LabelStudio,
}
"""By the names of the formats."""
