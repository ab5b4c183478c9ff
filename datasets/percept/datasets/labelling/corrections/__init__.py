"""Labels that people corrected: read back, and compared."""

from __future__ import annotations
