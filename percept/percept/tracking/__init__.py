"""Objects over time: identities, velocities and stable classes from single detections."""

from percept.tracking.config import TrackerConfig
from percept.tracking.tracker import Tracker

__all__ = ["Tracker", "TrackerConfig"]
