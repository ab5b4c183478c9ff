"""Which moments and images are worth a label."""

from __future__ import annotations
