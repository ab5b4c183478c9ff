"""Objects over time: identities, velocities and stable classes from single detections."""

from percept.tracking.config import TrackerConfig
from percept.tracking.join import JoinConfig
from percept.tracking.offline import TrackedDrive, track_drive
from percept.tracking.tracker import Tracker

__all__ = ["JoinConfig", "TrackedDrive", "Tracker", "TrackerConfig", "track_drive"]
