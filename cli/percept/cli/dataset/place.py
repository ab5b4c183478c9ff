"""Which part of the set each keyframe is in, before anything is decoded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from percept.cli.dataset.drives import DrivePlan
from percept.cli.dataset.request import PrepareConfig
from percept.datasets.labelling.choice.moments import Moment
from percept.datasets.labelling.places.split import Assignment, assign_splits

__all__ = ["PlacedMoment", "place_moments"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlacedMoment:
    """A keyframe with its place and its part.

    Attributes:
        plan: Its log.
        moment: What belongs to it.
        assignment: Its part; none where it is left out.
        latitude: Degrees north; NaN where not known.
        longitude: Degrees east; NaN where not known.
    """

    plan: DrivePlan
    moment: Moment
    assignment: Assignment
    latitude: float
    longitude: float

    @property
    def key_ns(self) -> int:
        """The moment."""
        return self.moment.instant.stamp_ns

    def topic_of(self, camera: str) -> str:
        """Return the topic of a camera by its name."""
        streams = self.plan.streams.items()
        return next(topic for topic, stream in streams if stream.name == camera)


def place_moments(
    plans: Sequence[DrivePlan], config: PrepareConfig
) -> tuple[list[DrivePlan], list[PlacedMoment]]:
    """Give each keyframe its part, before anything is decoded.

    Returns:
        The logs without the keyframes that no part takes, and all keyframes.
    """
    placed = []
    left = []
    for plan in plans:
        latitudes, longitudes = plan.fixes.at([m.instant.stamp_ns for m in plan.moments])
        parts = assign_splits(
            latitudes, longitudes, [plan.fingerprint] * len(plan.moments), config.split
        )
        of_plan = [
            PlacedMoment(
                plan=plan,
                moment=moment,
                assignment=part,
                latitude=float(latitude),
                longitude=float(longitude),
            )
            for moment, part, latitude, longitude in zip(
                plan.moments, parts, latitudes, longitudes, strict=True
            )
        ]
        kept = tuple(one.moment for one in of_plan if one.assignment.split is not None)
        left.append(replace(plan, moments=kept))
        placed += of_plan
    return left, placed
