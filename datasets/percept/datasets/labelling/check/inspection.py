"""What the checks of all formats share: where they tell, and what they list for later."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from percept.datasets.labelling.check.folder import Folder
from percept.datasets.labelling.check.pictures import (
    IMAGE_SUFFIXES,
    Picture,
    read_pictures,
)
from percept.datasets.labelling.check.problems import Problems
from percept.datasets.labels.image_size import image_file_size

__all__ = ["UNSPLIT", "Inspection", "ListedImage", "Part", "as_finite"]

UNSPLIT = "all"
"""Split of an image of which nothing says one."""

_SLACK_PX = 0.5
_SLACK_SHARE = 0.0005
_RUN = "run.json"
_FILE_SUFFIXES = (*IMAGE_SUFFIXES, ".bin", ".pcd")


@dataclass(frozen=True, slots=True)
class ListedImage:
    """An image that a part lists.

    Attributes:
        name: Its file, below the folder.
        split: Its split.
        group: Images of one group may look alike, such as those of one moment.
    """

    name: str
    split: str
    group: object


@dataclass(slots=True, eq=False)
class Part:
    """One format of a data set, or its tables.

    Attributes:
        root: Its folder: empty, or ends with `/`.
        kind: Name of the format.
        images: The images that it lists.
        boxes: Number of boxes in images by class and split.
        classes: The classes in their order, by the file that has them.
        splits: Split of each image by the last part of its name without suffix.
        solids: Number of its 3D boxes.
        stated: Splits that it says it has.
    """

    root: str
    kind: str
    images: dict[str, ListedImage] = field(default_factory=dict)
    boxes: dict[str, Counter[str]] = field(default_factory=dict)
    classes: dict[str, tuple[str, ...]] = field(default_factory=dict)
    splits: dict[str, str] = field(default_factory=dict)
    solids: int = 0
    stated: set[str] = field(default_factory=set)

    @property
    def name(self) -> str:
        """The part as people call it."""
        return self.root.rstrip("/") or self.kind

    def count_box(self, label: str, split: str) -> None:
        """Count a box for the histogram."""
        self.boxes.setdefault(label, Counter())[split] += 1


class Inspection:
    """A folder while it is checked.

    Attributes:
        folder: Its files.
        problems: What was found.
        parts: The formats in it, tables first.
        pictures: Images by name, once they are read.
        settings: With what the data set was prepared: `config` of its `run.json`, if it has one.
    """

    def __init__(self, folder: Folder, problems: Problems) -> None:
        self.folder = folder
        self.problems = problems
        self.parts: list[Part] = []
        self.pictures: Mapping[str, Picture] = {}
        self.settings: Mapping[str, object] = self._read_settings()
        self._stated: list[tuple[str, tuple[int, int], str]] = []

    def _read_settings(self) -> Mapping[str, object]:
        if _RUN not in self.folder.files:
            return {}
        record = self.folder.json(_RUN)
        config = record.get("config") if isinstance(record, dict) else None
        return config if isinstance(config, dict) else {}

    def setting(self, *keys: str) -> object:
        """Return what the settings say, level by level; None where they do not."""
        value: object = self.settings
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else None
        return value

    def add(self, code: str, where: str, message: str) -> None:
        """Report a problem."""
        self.problems.add(code, where, message)

    def part(self, root: str, kind: str) -> Part:
        """Begin a part."""
        self.parts.append(Part(root, kind))
        return self.parts[-1]

    def list_image(
        self,
        part: Part,
        name: str,
        split: str,
        where: str,
        *,
        size: tuple[int, int] | None = None,
        group: object = None,
    ) -> None:
        """Note that a part has an image: it has to be there, whole, and of its size.

        Args:
            part: The part.
            name: The file, below the folder.
            split: Its split.
            where: What names it.
            size: (width, height) that it should have; None where nothing says.
            group: Images of one group may look alike.
        """
        if not self.folder.need(name, where):
            return
        if size is not None:
            self._stated.append((name, size, where))
        known = part.images.setdefault(name, ListedImage(name, split, group)).split
        if known != split:
            self.add("split-differs", where, f"{name} is of {split}, and of {known} too")
        if split != UNSPLIT:
            part.splits[name.rpartition("/")[2].rpartition(".")[0]] = split

    def size_of(self, name: str) -> tuple[int, int] | None:
        """Return (width, height) of an image that is listed, from its first bytes."""
        return image_file_size(self.folder.path(name)) if name in self.folder.files else None

    def check_box(self, where: str, sides: Sequence[float], size: tuple[int, int] | None) -> None:
        """Hold a box to its image.

        Args:
            where: The entry.
            sides: x1, y1, x2, y2 in pixels.
            size: (width, height) of the image; None where it is not known.
        """
        x1, y1, x2, y2 = sides
        if not all(abs(side) < float("inf") for side in sides):
            self.add("not-a-number", where, f"box {_told(sides)}")
        elif x2 <= x1 or y2 <= y1:
            self.add("box-empty", where, f"box {_told(sides)}")
        elif size is not None and (
            min(x1, y1) < -_SLACK_PX or x2 > size[0] + _SLACK_PX or y2 > size[1] + _SLACK_PX
        ):
            self.add("box-outside", where, f"box {_told(sides)} in {size[0]} x {size[1]} px")

    def check_shares(self, where: str, sides: Sequence[float]) -> None:
        """Hold a box in shares of the image's width and height, 0..1, to the image."""
        x1, y1, x2, y2 = sides
        if x2 <= x1 or y2 <= y1:
            self.add("box-empty", where, f"box {_told(sides)} in shares of the image")
        elif min(x1, y1) < -_SLACK_SHARE or max(x2, y2) > 1 + _SLACK_SHARE:
            self.add("box-outside", where, f"box {_told(sides)} in shares of the image")

    def check_solid(self, where: str, values: Sequence[float]) -> None:
        """Check a 3D box by itself.

        Args:
            where: The entry.
            values: Its centre (3), its sizes (3), and what else has to be finite.
        """
        if not all(abs(value) < float("inf") for value in values):
            self.add("not-a-number", where, f"3D box {_told(values)}")
        elif min(values[3:6]) <= 0:
            self.add("box-empty", where, f"3D box of {_told(values[3:6])} m")

    def read_images(self) -> None:
        """Read all images that are listed, and report those that are damaged or of other size."""
        names = {name: None for part in self.parts for name in part.images}
        self.pictures = read_pictures(self.folder, names)
        for name, picture in self.pictures.items():
            if picture.damage:
                self.add("unreadable-image", name, picture.damage)
        for name, size, where in self._stated:
            found = self.pictures[name].size
            if found is not None and found != size:
                self.add(
                    "image-size",
                    where,
                    f"{name} has {found[0]} x {found[1]} px, not {size[0]} x {size[1]}",
                )

    def report_strays(self) -> None:
        """Report images and scans that nothing named."""
        for name in self.folder.below("", *_FILE_SUFFIXES):
            if name not in self.folder.named:
                self.add("stray-file", name, "nothing names it")

    def check_unique(self, where: str, values: Iterable[object], what: str) -> None:
        """Report values that come more than once."""
        for value, count in Counter(values).items():
            if count > 1:
                self.add("duplicate-id", where, f"{what} {value} comes {count} times")


def _told(sides: Sequence[float]) -> str:
    return " ".join(f"{side:.6g}" for side in sides)


def as_finite(word: str) -> float:
    """Return a word as number; NaN for what is none, or is infinite."""
    try:
        value = float(word)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
