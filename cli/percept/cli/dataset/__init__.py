"""`percept dataset`: from logs to a data set that labelling tools open, and back."""

from __future__ import annotations
