"""Settings of traffic lights over time, each with the reason for its default."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from percept.core.settings import Settings
from percept.lights.association import AssociationConfig
from percept.lights.projection import ProjectionConfig

__all__ = ["DecisionConfig", "DetectorConfig", "LightConfig", "SignalConfig"]

_Share = Annotated[float, Field(ge=0, le=1)]
_Chance = Annotated[float, Field(gt=0, lt=1)]
_Seconds = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_Row = tuple[_Chance, _Chance, _Chance, _Chance]


class SignalConfig(Settings):
    """How signals work in the country of the drive.

    Times are means; the chain draws them from exponential and, for flashes, Erlang laws. Those
    of flashes follow the MUTCD (11th edition, 4G.01): 50 to 60 flashes a minute, lit for half
    to two thirds of the time, so lit for 0.50 to 0.80 s and dark for 0.33 to 0.60 s.

    Attributes:
        red_s: Mean time of red.
        green_s: Mean time of green.
        yellow_s: Mean time of yellow, which is 3 to 6 s long.
        red_yellow: Whether red and yellow shine together before green, as in much of Europe.
        red_yellow_s: How long they do.
        steady_s: Mean time until a signal in normal use begins to flash.
        flashing_s: Mean time that a signal flashes.
        outage_s: Mean time until a signal goes dark. Short against real outages, since a lamp that
            the sun washes out looks dark as well; with it 1.4 s of dark housing are an outage.
        repair_s: Mean time until a dark one shows something. Short against real repairs, since
            a lamp far away also looks dark until it is near enough.
        illegal_per_s: Rate of each change that no signal makes, such as red to yellow; not 0, as
            boxes can be matched to the wrong light.
        flash_lit_s: Mean time of the lit part of a flash.
        flash_dark_s: Mean time of its dark part.
        flashing_red_share: Share of lights that flash red when they come into view.
        flashing_yellow_share: Of those that flash yellow. Small, as hardly any light is steady
            yellow at that moment either.
        dark_share: Share of lights that are dark when they come into view.
    """

    red_s: _Seconds = 30.0
    green_s: _Seconds = 25.0
    yellow_s: _Seconds = 4.0
    red_yellow: bool = False
    red_yellow_s: _Seconds = 1.5
    steady_s: _Seconds = 3600.0
    flashing_s: _Seconds = 120.0
    outage_s: _Seconds = 900.0
    repair_s: _Seconds = 20.0
    illegal_per_s: float = Field(default=1e-5, gt=0, le=1)
    flash_lit_s: _Seconds = 0.62
    flash_dark_s: _Seconds = 0.46
    flashing_red_share: _Chance = 0.035
    flashing_yellow_share: _Chance = 0.015
    dark_share: _Chance = 0.03


class DetectorConfig(Settings):
    """How the detector errs.

    Attributes:
        confusion: Row by row for a lamp that is truly red, yellow, green, and for a dark housing:
            the shares that the detector calls red, yellow, green, dark. Each row sums to 1.
        lasting_share: Share of its errors that last over several images, such as of a lamp
            whose pulses beat with the shutter.
        lasting_s: Mean time that such an error lasts.
        glare_every_s: Mean time between spells in which readings are random, as in glare.
        glare_s: Mean time of such a spell.
        full_confidence: A box of this confidence or more is as good as `confusion` says; one of
            less is in part a guess among the four.
    """

    confusion: tuple[_Row, _Row, _Row, _Row] = (
        (0.950, 0.017, 0.002, 0.031),
        (0.022, 0.950, 0.007, 0.021),
        (0.002, 0.010, 0.950, 0.038),
        (0.020, 0.010, 0.020, 0.950),
    )
    lasting_share: _Share = 0.5
    lasting_s: _Seconds = 0.2
    glare_every_s: _Seconds = 30.0
    glare_s: _Seconds = 0.4
    full_confidence: float = Field(default=0.5, gt=0, le=1)

    @model_validator(mode="after")
    def _rows_sum_to_one(self) -> Self:
        for row in self.confusion:
            if abs(sum(row) - 1) > 1e-6:
                raise ValueError(f"each row of the confusion sums to 1, not to {sum(row):.6g}")
        return self


class DecisionConfig(Settings):
    """How probable an answer must be before it is given; below, the state is `unknown`.

    Red that is read as green is the error that kills, so that green is said only while red is
    all but impossible; a green that comes half a second late costs little.

    Attributes:
        red: Least probability of red.
        yellow: Of yellow.
        green: Of green.
        red_beside_green: And the most that red, steady or flashing, may have beside it.
        dark: Of a light that is out.
        flashing: Of flashing in whatever colour.
        flashing_hold_s: For how long that has to hold, so that no single reading decides.
        flashing_ends: Below this a light that flashed does so no longer.
        flash_in_view_s: A light is not called flashing before it was seen for so long: one full
            cycle of the slowest flash (1.2 s), since a single dark phase may be an error.
        slowest_hz: With fewer readings a second than this, flashing cannot be told from flicker
            and is never reported: the dark phase lasts 0.33 s at the least.
    """

    red: _Chance = 0.7
    yellow: _Chance = 0.7
    green: _Chance = 0.9
    red_beside_green: _Chance = 0.0003
    dark: _Chance = 0.9
    flashing: _Chance = 0.97
    flashing_hold_s: float = Field(default=0.1, ge=0)
    flashing_ends: _Chance = 0.5
    flash_in_view_s: _Seconds = 1.2
    slowest_hz: _Seconds = 4.0


class LightConfig(Settings):
    """Settings of `LightTracker`.

    Attributes:
        birth_detections: N_birth: a light is reported from this many boxes on.
        death_s: N_death as a time, so that it holds at any rate of images: a light that was not
            seen for so long is forgotten. Until then its state is predicted.
        box_death_s: The same for a box that is followed without a map, since nothing but its
            last motion says where it will come out behind a lorry.
        reorder_s: Images that arrive this late are put in their place; later ones are dropped.
        recent_s: A camera is named beside a light if it saw it within this time.
        fuse_groups: Lights of one regulatory element of the map show the same, so that their
            evidence is summed.
        smoothed: Whether `LightTracker.history` uses hindsight.
        signals: How signals work.
        detector: How the detector errs.
        decision: How sure an answer has to be.
        projection: Which lights of the map are looked for in an image.
        association: Which box is which light of the map.
    """

    birth_detections: int = Field(default=3, ge=1)
    death_s: _Seconds = 10.0
    box_death_s: _Seconds = 1.5
    reorder_s: float = Field(default=1.0, ge=0)
    recent_s: _Seconds = 0.5
    fuse_groups: bool = True
    smoothed: bool = True
    signals: SignalConfig = SignalConfig()
    detector: DetectorConfig = DetectorConfig()
    decision: DecisionConfig = DecisionConfig()
    projection: ProjectionConfig = ProjectionConfig()
    association: AssociationConfig = AssociationConfig()
