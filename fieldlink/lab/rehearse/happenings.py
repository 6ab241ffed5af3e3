"""What may happen in a rehearsal, as models: loads, faults, what people do, and wrong estimates."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

__all__ = [
    "Disable",
    "Load",
    "Maintenance",
    "Manual",
    "Misestimate",
    "Moment",
    "NetworkFault",
    "Points",
    "Repair",
    "ScenarioModel",
    "Seconds",
    "SensorFault",
    "Sinusoid",
    "Sizes",
]


class ScenarioModel(BaseModel):
    """A table of the scenario file; a key that it does not have is an error."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )


def _ordered(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    times = [time for time, _ in points]
    for earlier, later in pairwise(times):
        if later < earlier:
            raise ValueError(
                f"the time {later:g} comes after {earlier:g}; sort the points (two of one time "
                "make a step)"
            )
    return points


def _none_below_zero(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    for time, value in points:
        if value < 0.0:
            raise ValueError(f"{value:g} at {time:g} s is below 0; give 0 or more")
    return points


Seconds = Annotated[float, Field(gt=0)]
Moment = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(gt=0, le=1)]
Points = Annotated[tuple[tuple[float, float], ...], Field(min_length=1), AfterValidator(_ordered)]
Sizes = Annotated[Points, AfterValidator(_none_below_zero)]


class _Spell(ScenarioModel):
    """Something that lasts from ``begin`` to ``end``."""

    begin: Moment
    """Plant second at which it begins."""
    end: Moment
    """Plant second at which it is over."""

    @model_validator(mode="after")
    def _lasts(self) -> Self:
        if self.end <= self.begin:
            raise ValueError(
                f"end = {self.end:g} is not after begin = {self.begin:g}; exchange or correct them"
            )
        return self

    def covers(self, time: float) -> bool:
        """Whether it is on at ``time``."""
        return self.begin <= time < self.end


class Sinusoid(_Spell):
    """``sinusoids`` of ``[load]``: oscillations from outside, each a table."""

    begin: Moment = 0.0
    """Plant second at which it begins."""
    end: Moment = 1e12
    """Plant second at which it is over."""
    amplitude: float
    """In units of the load."""
    period: Seconds
    """Seconds of one swing."""


class Load(ScenarioModel):
    """``[load]``: what disturbs the process behind the valve."""

    points: Points = ((0.0, 0.0),)
    """Course as points (plant second, value)."""
    sinusoids: tuple[Sinusoid, ...] = ()
    """Oscillations from outside, added to it."""


class SensorFault(_Spell):
    """``[[sensor]]``: a fault of the transmitter of PV, seen by controller and daemon alike."""

    kind: Literal["freeze", "drift", "spikes", "noise", "bad"]
    """Value stands still; slope added; single outliers; white noise; NaN."""
    rate: float = 0.0
    """PV per second, of a drift."""
    size: float = 0.0
    """PV, of a spike; standard deviation of the noise."""
    share: Share = 0.02
    """Of the samples that are spikes."""

    @model_validator(mode="after")
    def _sized(self) -> Self:
        if self.kind == "drift" and not self.rate:
            raise ValueError('kind = "drift" needs a rate; give PV per second')
        if self.kind in ("spikes", "noise") and not self.size:
            raise ValueError(f'kind = "{self.kind}" needs a size; give it in units of PV')
        return self


class NetworkFault(_Spell):
    """``[[network]]``: what is wrong between daemon and PLC, or with the PLC."""

    kind: Literal["drop", "late", "write_lost", "write_flipped", "write_torn", "restart"]
    """Polls unanswered; polls that get the cycle before; writes unanswered and without effect;
    writes of several registers of which a bit has changed on the way, or of which the first half
    arrives; the PLC off, to start with empty registers."""
    share: Share = 1.0
    """Of the polls or writes that are hit."""


class Repair(ScenarioModel):
    """``[[maintenance]]`` with kind = "repair": the valve is another one from then on."""

    kind: Literal["repair"]
    """The kind."""
    at: Moment
    """Plant second."""
    stick_band: float = Field(default=0.0, ge=0)
    """S afterwards."""
    slip_jump: float = Field(default=0.0, ge=0)
    """J afterwards; not above S."""

    @model_validator(mode="after")
    def _slips(self) -> Self:
        if self.slip_jump > self.stick_band:
            raise ValueError(
                f"slip_jump = {self.slip_jump:g} is above stick_band = {self.stick_band:g}; J is a "
                "part of S"
            )
        return self


class Manual(_Spell):
    """``[[maintenance]]`` with kind = "manual": an operator has the loop."""

    kind: Literal["manual"]
    """The kind."""
    op: Points | None = None
    """OP meanwhile; it stays where it is unless given."""


class Disable(_Spell):
    """``[[maintenance]]`` with kind = "disable": the operator clears the enable register."""

    kind: Literal["disable"]
    """The kind."""


Maintenance = Annotated[Repair | Manual | Disable, Field(discriminator="kind")]


class Misestimate(_Spell):
    """``[[misestimate]]``: windows that end in this time yield a wrong model, as it may happen."""

    stick_band_factor: Seconds = 1.0
    """On S and its interval."""
    slip_jump_factor: Moment = 1.0
    """On J and its interval; cut off at S."""
    gain_factor: float = 1.0
    """On the process gain; negative for a gain of the wrong sign."""

    @model_validator(mode="after")
    def _acts(self) -> Self:
        if self.gain_factor == 0.0:
            raise ValueError("gain_factor = 0 leaves no process; give another number")
        return self
