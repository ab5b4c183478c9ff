"""The files of images: as recorded, without distortion, with persons unreadable."""

from __future__ import annotations
