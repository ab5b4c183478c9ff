"""The boxes that labelling begins from."""

from __future__ import annotations
