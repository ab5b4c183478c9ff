"""Reading and writing logs and folders of sensor data.

`LogWriter` and `recover` stay in `percept.datasets.write` and `percept.datasets.recover`: with
them come OpenCV and the writers of ROS logs, which reading must not wait for.
"""

from __future__ import annotations

from percept.datasets.files.cloud_files import read_point_cloud
from percept.datasets.open import open_recording
from percept.datasets.recording import Recording

__all__ = ["Recording", "open_recording", "read_point_cloud"]
