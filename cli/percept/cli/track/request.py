"""What `percept track` is asked for, and the settings that it shares with `percept detect`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import Field

from percept.core.settings import Settings
from percept.lights import LightConfig
from percept.tracking import JoinConfig, TrackerConfig

__all__ = ["TrackConfig", "TrackRequest"]


class TrackConfig(Settings):
    """All settings of what happens over time.

    Attributes:
        tracking: The tracker of objects.
        joining: When two of its tracks are pieces of one object.
        lights: The tracker of traffic lights.
    """

    tracking: TrackerConfig = Field(default_factory=TrackerConfig)
    joining: JoinConfig = Field(default_factory=JoinConfig)
    lights: LightConfig = Field(default_factory=LightConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackRequest:
    """What the command line asked for; see the options of `percept track`."""

    run: Path
    out: Path
    map_file: Path | None = None
    origin: str | None = None
    poses: Path | None = None
    config: Path | None = None
    overlay: bool = False
    force: bool = False
