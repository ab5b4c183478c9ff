"""Inspection of a log: what is in it, what is wrong with it, and what it is good for."""

from __future__ import annotations

from percept.datasets.inspection.config import InspectConfig
from percept.datasets.inspection.report import Inspection, inspect_recording

__all__ = ["InspectConfig", "Inspection", "inspect_recording"]
