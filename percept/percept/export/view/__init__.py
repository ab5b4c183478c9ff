"""The run as rerun shows it: `view.rrd`. With `calibration.view`, all that imports rerun.

The file is written in parts, one a session, beside its final name. A session that ends well
joins the parts and gives the file its name; one that is killed leaves a part whose whole
messages are read by the session that resumes the run. Nothing here starts a server.
"""

from __future__ import annotations

from percept.export.view.cameras import ViewCamera
from percept.export.view.recording import merge_views, rrd_recording
from percept.export.view.summary import ViewSummary
from percept.export.view.writer import ViewWriter

__all__ = ["ViewCamera", "ViewSummary", "ViewWriter", "merge_views", "rrd_recording"]
