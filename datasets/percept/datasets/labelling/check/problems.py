"""What can be wrong with a data set: the codes, and the list of what was found."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

__all__ = ["CODES", "SEVERITIES", "Code", "Problem", "Problems", "Severity", "plain"]

Severity = Literal["error", "warning", "info"]
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
"""How bad a problem is, the worst first."""

_KEPT_OF_A_CODE = 1_000
_LONGEST = 240


class Code(NamedTuple):
    """A kind of problem.

    Attributes:
        severity: How bad it is.
        means: What it means, as a clause.
        remedy: What to do about it, as a sentence without a final full stop.
    """

    severity: Severity
    means: str
    remedy: str


_AGAIN = "Prepare or export the data set again"
CODES: dict[str, Code] = {
    "leak-distance": Code(
        "error",
        "places of two splits are nearer to each other than the margin",
        "Leave the images of one split out, or split again with `percept dataset prepare`",
    ),
    "leak-same-file": Code(
        "error", "two splits hold the same image, byte for byte", "Keep it in one split"
    ),
    "leak-near-duplicate": Code(
        "error", "images of two splits show the same", "Keep them in one split, or keep one"
    ),
    "split-differs": Code(
        "error", "an image is put into two splits", "Keep it in one, or export the format again"
    ),
    "outside-folder": Code(
        "error",
        "a name leads out of the folder; it was not opened",
        "Put the file into the folder, and name it relative to it",
    ),
    "unreadable-file": Code("error", "a file cannot be read as what it is", _AGAIN),
    "malformed": Code("error", "an entry is not what the format says", "Correct the entry"),
    "missing-file": Code(
        "error", "a file that is named is not there", "Bring it back, or remove its entry"
    ),
    "unreadable-image": Code(
        "error", "an image is damaged or no image", "Bring the image back, or remove its entry"
    ),
    "image-size": Code(
        "error",
        "an image has another size than its entry says",
        "Boxes of a scaled image are wrong: bring the image back",
    ),
    "stray-label": Code(
        "error", "labels are there without their image", "Bring the image back, or remove them"
    ),
    "table-mismatch": Code("error", "tables do not fit together", _AGAIN),
    "duplicate-id": Code("error", "an id or a name comes twice", "Give each its own"),
    "bad-id": Code(
        "error", "an id is not of the kind that readers take", "Number from 1, in whole numbers"
    ),
    "unknown-id": Code(
        "error", "an entry refers to one that is not there", "Correct the entry or remove it"
    ),
    "unknown-class": Code(
        "error", "a box has a class that the list of classes has not", "Add the class or correct it"
    ),
    "unknown-split": Code(
        "error", "a split is none of train, val and test", "Name one of these"
    ),
    "class-order": Code(
        "error",
        "classes have other numbers in one file than in another",
        "Export the format again: a network trained on one is scored wrongly on the other",
    ),
    "wrong-columns": Code("error", "a line has too few or too many columns", "Correct the line"),
    "not-a-number": Code("error", "a value is no finite number", "Correct the value"),
    "share-range": Code(
        "error",
        "a value that is a share lies outside of its range",
        "Divide pixels by the width and the height of the image",
    ),
    "box-empty": Code(
        "error", "a box has no size, or its sides are swapped", "Remove it or correct it"
    ),
    "box-outside": Code(
        "error", "a box leaves its image by more than half a pixel", "Cut it at the border"
    ),
    "empty-split": Code(
        "warning",
        "a split has no images",
        "Add logs of other places; a network without validation is not validated",
    ),
    "same-file": Code("warning", "two images of a split are one, byte for byte", "Keep one"),
    "near-duplicate": Code("warning", "two images of a split show the same", "Keep one"),
    "duplicate-row": Code("warning", "a box is there twice", "Remove one"),
    "missing-label": Code(
        "warning",
        "an image has no labels",
        "Write an empty file if it shows nothing; remove the image if nobody looked at it",
    ),
    "stray-file": Code("warning", "a file is there that nothing names", "Remove it"),
    "id-zero": Code(
        "warning", "an id is 0, which some tools take for none", "Number from 1"
    ),
    "other-class": Code(
        "warning", "a class is none of KITTI's", "Readers with a fixed list of classes refuse it"
    ),
    "no-record": Code(
        "warning", "nothing says whether the preparation came to its end", _AGAIN
    ),
    "track-in-splits": Code(
        "info",
        "an object is seen in two splits",
        "Parked cars can be: the places are a margin apart all the same",
    ),
    "images-elsewhere": Code(
        "info",
        "the folder holds labels without images",
        "Check the data set that was prepared for its images",
    ),
    "margin-unknown": Code(
        "info",
        "the distance between splits could not be judged for all images",
        "Prepare from logs with GNSS fixes if the places of these images matter",
    ),
}  # fmt: skip
"""All kinds of problems by their codes, the weightiest first."""


class Problem(NamedTuple):
    """One thing that is wrong.

    Attributes:
        code: Its kind, a key of `CODES`.
        severity: How bad it is.
        where: The file, below the folder, and the entry or line in it.
        message: What is wrong, in one line.
    """

    code: str
    severity: Severity
    where: str
    message: str


@dataclass(frozen=True, slots=True)
class _Found:
    examples: dict[str, list[Problem]]
    counts: Counter[str]


class Problems:
    """Collects what is wrong; of each kind a thousand are kept, and all are counted."""

    def __init__(self) -> None:
        self._found = _Found({}, Counter())

    def add(self, code: str, where: str, message: str) -> None:
        """Add a problem; what is not printable in its texts is spelled out."""
        self._found.counts[code] += 1
        kept = self._found.examples.setdefault(code, [])
        if len(kept) < _KEPT_OF_A_CODE:
            kept.append(Problem(code, CODES[code].severity, plain(where), plain(message)))

    @property
    def counts(self) -> dict[str, int]:
        """How many there are of each kind, in the order of `CODES`."""
        return {code: self._found.counts[code] for code in CODES if self._found.counts[code]}

    @property
    def errors(self) -> int:
        """How many errors there are."""
        return sum(n for code, n in self.counts.items() if CODES[code].severity == "error")

    def all(self) -> tuple[Problem, ...]:
        """Return those that were kept, in the order of `CODES`."""
        return tuple(one for code in CODES for one in self._found.examples.get(code, ()))


def plain(text: object) -> str:
    """Return a text in one printable line of at most 240 characters: it comes from strangers."""
    words = str(text)
    if len(words) > _LONGEST:
        words = f"{words[: _LONGEST // 2]} ... {words[-_LONGEST // 2 + 5 :]}"
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode("ascii")
        for letter in words
    )
