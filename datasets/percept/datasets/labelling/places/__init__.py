"""Where images were taken, and which part of the set a place belongs to."""

from __future__ import annotations
