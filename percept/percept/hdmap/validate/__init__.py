"""Markings that were seen against those of the map.

The way of the paint, file by file:

1. `stations`: the map's lines are cut into stations of half a metre, each judged by itself.
2. `validator`: looks come in one by one. `look` drops strokes that cannot be used and places the
   others on the map; `localise` finds the shift of the poses that most lines agree on.
3. `match`: strokes find the stations that they cover, and vote for offset, pair and colour.
4. `tally` sums votes and looks up by station, `stop_lines` bars, `unmatched` paint beside all
   lines. No stroke is kept: memory grows with the map, not with the drive.
5. `summary`: when all looks are in, `evidence` says of each line where it shows paint and where
   that lies, and `pieces` whether it is solid, dashed or none.
6. `line_findings`, `lane_width`, `extra_lines`, `stop_findings` and `offset` (what all of the way
   has in common) hold that against the map; `findings` is how each of them tells a difference.
7. `decided` leaves out what a person rejected; `coverage` says what was not seen and why, and
   `verdict` how far all of it can be trusted.
"""

from __future__ import annotations

from percept.hdmap.validate.config import ValidationConfig
from percept.hdmap.validate.result import ElementCoverage, StretchOffset, Validation
from percept.hdmap.validate.validator import LaneValidator, MarkedMap, validate_lanes

__all__ = [
    "ElementCoverage",
    "LaneValidator",
    "MarkedMap",
    "StretchOffset",
    "Validation",
    "ValidationConfig",
    "validate_lanes",
]
