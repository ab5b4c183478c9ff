"""What `percept dataset prepare` was asked for, and its settings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from percept.core.settings import Settings
from percept.datasets.labelling.choice.keyframes import KeyframeConfig
from percept.datasets.labelling.choice.moments import SyncConfig
from percept.datasets.labelling.choice.selection import SelectionConfig
from percept.datasets.labelling.formats import ExportFormat
from percept.datasets.labelling.images.image_files import ImageConfig
from percept.datasets.labelling.places.split import SplitConfig
from percept.datasets.labelling.prelabels.label_keyframe import PreLabelConfig

__all__ = ["PrepareConfig", "PrepareRequest"]


class PrepareConfig(Settings):
    """All settings of `percept dataset prepare`.

    Attributes:
        keyframes: When a keyframe is due.
        sync: How far apart what belongs together may be.
        selection: Which images are poor, and which show the same.
        prelabels: Which boxes the labelling begins from.
        split: Which part a place belongs to.
        images: How images are written.
    """

    keyframes: KeyframeConfig = Field(default_factory=KeyframeConfig)
    sync: SyncConfig = Field(default_factory=SyncConfig)
    selection: SelectionConfig = Field(default_factory=SelectionConfig)
    prelabels: PreLabelConfig = Field(default_factory=PreLabelConfig)
    split: SplitConfig = Field(default_factory=SplitConfig)
    images: ImageConfig = Field(default_factory=ImageConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class PrepareRequest:
    """What the command line asked for; see the options of `percept dataset prepare`."""

    bags: tuple[Path, ...]
    runs: tuple[Path, ...]
    rig: Path | None
    formats: tuple[ExportFormat, ...]
    cameras: dict[str, str]
    flags: dict[str, Any]
    budget: int | None
    anonymise: tuple[str, ...]
    anonymise_models: dict[str, str]
    licence: str
    config: Path | None
    start_s: float | None
    end_s: float | None
    out: Path
    force: bool
    resume: bool
