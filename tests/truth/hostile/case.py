"""What a hostile case is, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import PerceptError
from percept.core.results import Verdict
from percept.core.transform import rotation_from_rpy

__all__ = [
    "ERROR",
    "NEVER_GOOD",
    "RIGHT_OR_NOT_GOOD",
    "UNUSABLE",
    "Case",
    "Miss",
    "Outcome",
    "pose",
]

_F64 = NDArray[np.float64]

ERROR = "error"
RIGHT_OR_NOT_GOOD = frozenset({*map(str, Verdict), ERROR})
NEVER_GOOD = RIGHT_OR_NOT_GOOD - {str(Verdict.GOOD)}
UNUSABLE = NEVER_GOOD - {str(Verdict.DOUBTFUL)}


@dataclass(frozen=True, slots=True)
class Miss:
    """How far one quantity of an answer lies from the truth.

    Attributes:
        name: What it is, with its unit.
        error: Distance from the truth.
        sd: What the answer says its standard deviation is.
        tolerance: Errors below it do no harm in a good answer,
        tolerance_doubtful: and below this none in one that is called doubtful.
    """

    name: str
    error: float
    sd: float
    tolerance: float
    tolerance_doubtful: float

    def is_wrong(self, verdict: str) -> bool:
        """Return whether the error is more than the verdict and the spread admit."""
        tolerance = self.tolerance if verdict == Verdict.GOOD else self.tolerance_doubtful
        return not (self.error <= tolerance or self.error <= 3 * self.sd)

    def __str__(self) -> str:
        return f"{self.name} off by {self.error:.3g}, sd {self.sd:.2g}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What percept says.

    Attributes:
        said: A verdict, or `error`.
        why: The weightiest reason.
        misses: How far the answer is from the truth; empty where the data have no truth or there
            is no answer.
    """

    said: str
    why: str
    misses: tuple[Miss, ...] = ()

    def wrong(self) -> list[str]:
        """Return what is wrong in an answer that a user would take."""
        if self.said not in (Verdict.GOOD, Verdict.DOUBTFUL):
            return []
        return [str(miss) for miss in self.misses if miss.is_wrong(self.said)]


@dataclass(frozen=True, slots=True)
class Case:
    """Data with something wrong.

    Attributes:
        kind: `lidar`, `camera` or `camera-lidar`.
        name: In a few words.
        wrong: What is wrong with the data.
        run: Makes the data, calibrates with them and compares with the truth.
        allowed: What percept may say.
    """

    kind: str
    name: str
    wrong: str
    run: Callable[[], Outcome]
    allowed: frozenset[str]

    def outcome(self) -> Outcome:
        """Run the case; an error that names its reason is an outcome too."""
        try:
            return self.run()
        except PerceptError as error:
            return Outcome(ERROR, str(error))


def pose(
    x: float, y: float, z: float, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0
) -> _F64:
    """Return a (4, 4) pose from metres and fixed-axis angles in degrees."""
    T = np.eye(4)
    T[:3, :3] = rotation_from_rpy(*np.radians([roll, pitch, yaw]))
    T[:3, 3] = x, y, z
    return T
