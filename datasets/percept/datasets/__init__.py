"""Reading and writing logs and folders of sensor data."""

from __future__ import annotations

from percept.datasets.open import open_recording
from percept.datasets.recording import Recording

__all__ = ["Recording", "open_recording"]
