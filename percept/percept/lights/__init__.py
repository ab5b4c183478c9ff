"""Traffic lights over time: which light a box is, what it shows, whether it flashes."""

from percept.core.light_words import Reading, light_label
from percept.lights.colours import classify_light_crops, light_crops
from percept.lights.config import LightConfig
from percept.lights.tracker import LightTracker

__all__ = [
    "LightConfig",
    "LightTracker",
    "Reading",
    "classify_light_crops",
    "light_crops",
    "light_label",
]
