"""What a scenario file may expect of a run (``[[expect]]``), as models.

A window counts for a time when it *ends* in it. `fieldlink.lab.rehearse.judge` says how each is
judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from compensator import WithdrawReason
from fieldlink.lab.rehearse.event_names import EVENT_NAMES
from fieldlink.site.errors import nearest

__all__ = [
    "BlocksExpected",
    "ChangeExpected",
    "EstimateExpected",
    "EventExpected",
    "Expectation",
    "FallBackExpected",
    "PvExpected",
    "SamplesExpected",
    "TakeOverExpected",
    "VerdictExpected",
]

Moment = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=0)]
END = 1e12


def _one_of(known: Iterable[str]) -> AfterValidator:
    """Refuse a name that no run could give: an expectation of it says nothing."""
    names = tuple(known)

    def check(name: str) -> str:
        if name not in names:
            raise ValueError(f"{name!r} is unknown; {nearest(name, names)}")
        return name

    return AfterValidator(check)


_Event = Annotated[str, _one_of(EVENT_NAMES)]
_Reason = Annotated[str, _one_of(reason.name.lower() for reason in WithdrawReason)]


class _Expected(BaseModel):
    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )


class _Counted(_Expected):
    at_least: Count = 0
    """Fewest."""
    at_most: Count | None = None
    """Most."""

    @model_validator(mode="after")
    def _asks(self) -> Self:
        if not self.at_least and self.at_most is None:
            raise ValueError("any number would do; give at_least or at_most")
        if self.at_most is not None and self.at_least > self.at_most:
            raise ValueError(
                f"at_least = {self.at_least} is above at_most = {self.at_most}; exchange or "
                "correct them"
            )
        return self


class _OfWindows(_Expected):
    after: Moment = 0.0
    """Windows that end at this plant second or later."""
    before: Moment = END
    """Windows that end at this plant second or earlier."""
    windows: Literal["all", "any", "none"] = "all"
    """How many of them; there must be at least one window in any case."""

    @model_validator(mode="after")
    def _lasts(self) -> Self:
        if self.before <= self.after:
            raise ValueError(
                f"before = {self.before:g} is not later than after = {self.after:g}; "
                "exchange or correct them"
            )
        return self


class VerdictExpected(_OfWindows):
    """kind = "verdict": what windows say about the valve."""

    kind: Literal["verdict"]
    """The kind."""
    verdict: Literal["stiction", "no_stiction", "not_assessable"]
    """The verdict."""
    reason: str = ""
    """A piece of text that one of the window's reasons holds, in any case of letters."""


class EstimateExpected(_OfWindows):
    """kind = "estimate": S or J near what the valve really had during the window."""

    kind: Literal["estimate"]
    """The kind."""
    of: Literal["stick_band", "slip_jump"] = "stick_band"
    """Which parameter."""
    tolerance: float = Field(default=0.1, gt=0)
    """Distance allowed, as a share of the true value."""
    covered: bool = False
    """Whether the interval must hold the true value too."""


class TakeOverExpected(_Expected):
    """kind = "take_over": the compensator gets the loop."""

    kind: Literal["take_over"]
    """The kind."""
    after: Moment = 0.0
    """Not before this plant second."""
    by: Moment | None = None
    """At this plant second at the latest."""
    never: bool = False
    """It must not, from `after` on."""

    @model_validator(mode="after")
    def _either(self) -> Self:
        if (self.by is None) != self.never:
            raise ValueError("give either by = SECONDS or never = true; keep one of them")
        return self


class FallBackExpected(_Expected):
    """kind = "fall_back": the controller has the loop again after the compensator had it."""

    kind: Literal["fall_back"]
    """The kind."""
    after: Moment = 0.0
    """Not before this plant second."""
    by: Moment
    """At this plant second at the latest."""
    reason: tuple[_Reason, ...] = ()
    """Names of the reasons that count (worse, growing, hunting, expired, ...); any unless given."""


class PvExpected(_Expected):
    """kind = "pv_std": standard deviation of the true PV around SP in one time, over another."""

    kind: Literal["pv_std"]
    """The kind."""
    first: tuple[float, float]
    """The time to compare with (plant seconds)."""
    then: tuple[float, float]
    """The time to judge."""
    at_most: float | None = Field(default=None, gt=0)
    """Highest ratio."""
    at_least: float | None = Field(default=None, gt=0)
    """Lowest ratio."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.at_most is None and self.at_least is None:
            raise ValueError("nothing is asked of the ratio; give at_most or at_least")
        if (self.at_least or 0.0) > (self.at_most or math.inf):
            raise ValueError("at_least is above at_most; exchange or correct them")
        for name in ("first", "then"):
            begin, end = getattr(self, name)
            if not 0 <= begin < end:
                raise ValueError(
                    f"{name} = [{begin:g}, {end:g}] is not a time; give 0 <= from < to"
                )
        return self


class BlocksExpected(_Counted):
    """kind = "blocks": parameter blocks that the PLC accepted."""

    kind: Literal["blocks"]
    """The kind."""
    status: Literal["valid", "no_stiction", "not_assessable", "any"] = "any"
    """Only those of this status."""
    after: Moment = 0.0
    """From this plant second on."""


class SamplesExpected(_Counted):
    """kind = "samples": counts of the samples."""

    kind: Literal["samples"]
    """The kind."""
    of: Literal["read", "bad", "missed", "duplicates", "restarts"]
    """Which count."""


class EventExpected(_Expected):
    """kind = "event": an event of the daemon's journal, such as device.demoted or loop.silent."""

    kind: Literal["event"]
    """The kind."""
    event: _Event
    """The event's name."""
    after: Moment = 0.0
    """From this plant second on."""
    by: Moment | None = None
    """At this plant second at the latest."""
    never: bool = False
    """It must not happen."""

    @model_validator(mode="after")
    def _either(self) -> Self:
        if (self.by is None) != self.never:
            raise ValueError("give either by = SECONDS or never = true; keep one of them")
        return self


class ChangeExpected(_Expected):
    """kind = "change": what the tracking of S over all windows finds."""

    kind: Literal["change"]
    """The kind."""
    direction: Literal["increase", "decrease"]
    """Wear, or maintenance."""
    at: Moment | None = None
    """Plant second of the onset."""
    within: float = Field(default=0.0, ge=0)
    """Seconds that the found onset may be off."""
    never: bool = False
    """No such change may be found."""

    @model_validator(mode="after")
    def _either(self) -> Self:
        if (self.at is None) != self.never:
            raise ValueError("give either at = SECONDS and within, or never = true")
        return self


Expectation = Annotated[
    VerdictExpected
    | EstimateExpected
    | TakeOverExpected
    | FallBackExpected
    | PvExpected
    | BlocksExpected
    | SamplesExpected
    | EventExpected
    | ChangeExpected,
    Field(discriminator="kind"),
]
