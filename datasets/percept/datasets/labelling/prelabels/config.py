"""Settings of pre-labels."""

from __future__ import annotations

from pydantic import Field

from percept.core.settings import Settings
from percept.datasets.labelling.prelabels.categories import CategoryConfig
from percept.datasets.labelling.prelabels.solid_matches import LinkConfig

__all__ = ["PreLabelConfig", "SolidThresholds", "Thresholds"]


class Thresholds(Settings):
    """From which confidence on a box is a pre-label.

    Attributes:
        least: Of classes that are not named below.
        classes: By category.
    """

    least: float = Field(default=0.3, ge=0, le=1)
    classes: dict[str, float] = Field(default_factory=dict)

    def of(self, category: str) -> float:
        """Return the threshold of a category."""
        return self.classes.get(category, self.least)


class SolidThresholds(Thresholds):
    """The same of 3D boxes: a file that names classes alone leaves the rest at its default.

    Attributes:
        least: Of classes that are not named below.
        classes: By category.
    """

    least: float = Field(default=0.5, ge=0, le=1)


class PreLabelConfig(Settings):
    """How pre-labels are made.

    Attributes:
        categories: What classes are called.
        images: Thresholds of the boxes of networks.
        solids: Thresholds of 3D boxes.
        linking: When boxes are one object.
    """

    categories: CategoryConfig = CategoryConfig()
    images: Thresholds = Thresholds()
    solids: SolidThresholds = SolidThresholds()
    linking: LinkConfig = LinkConfig()
