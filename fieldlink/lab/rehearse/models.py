"""The scenario file, key by key, as typed and frozen models.

What is expected of a run has models of its own, in `fieldlink.lab.rehearse.expected`.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from fieldlink.lab.rehearse.defects import Defect
from fieldlink.lab.rehearse.expected import Expectation
from fieldlink.site.models import Span

__all__ = [
    "ControllerSettings",
    "DaemonSettings",
    "Disable",
    "Load",
    "Manual",
    "Misestimate",
    "NetworkFault",
    "PlantVariables",
    "RehearsedPlant",
    "Repair",
    "Scenario",
    "SensorFault",
    "Sinusoid",
    "Summary",
    "ValveWear",
]


class _Model(BaseModel):
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


Seconds = Annotated[float, Field(gt=0)]
Moment = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(gt=0, le=1)]
Points = Annotated[tuple[tuple[float, float], ...], Field(min_length=1), AfterValidator(_ordered)]


class _Spell(_Model):
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


class Summary(_Model):
    """``[scenario]``: the rehearsal as a whole."""

    title: str = Field(min_length=1)
    """One line for people."""
    text: str = ""
    """What it shows, in a few sentences."""
    duration: Seconds
    """Plant seconds that are run."""
    seed: int = Field(default=1, ge=0, le=0x7FFFFFFF)
    """Seed of the plant's noise and of everything else that is random."""
    defects: tuple[Defect, ...] = ()
    """Defects (see --inject) of which each must make the scenario fail."""


class PlantVariables(_Model):
    """``[plant.variables]``: what the FMU calls things."""

    op: str = "op"
    """Input: controller output."""
    pv: str = "pv"
    """Output: process variable."""
    stem: str = "stem"
    """Output: stem position, for judging; need not exist."""
    load: str = "load"
    """Input: load disturbance; needed with [load]."""
    stick_band: str = "stick_band"
    """Tunable parameter or input: S; needed with [valve]."""
    slip_jump: str = "slip_jump"
    """Tunable parameter or input: J; needed with [valve]."""


class RehearsedPlant(_Model):
    """``[plant]``: what stands behind the valve."""

    fmu: str = Field(min_length=1)
    """Name in the catalogue, or path of an .fmu file relative to the scenario file."""
    period: Seconds = 1.0
    """Plant seconds between two scans of the controller."""
    parameters: Mapping[str, float] = {}
    """Start values of the FMU's parameters."""
    variables: PlantVariables = PlantVariables()
    """What the FMU calls things."""


class ControllerSettings(_Model):
    """``[controller]``: what the simulated PLC runs."""

    kind: Literal["pi", "mpc"]
    """PI, or the unaware MPC of the catalogue's linear plants."""
    gain: float | None = None
    """OP per PV, of a PI."""
    integral_time: Seconds | None = None
    """Seconds, of a PI."""
    compensate: bool = False
    """Whether accepted blocks let the compensator take over."""

    @model_validator(mode="after")
    def _tuned(self) -> Self:
        given = (self.gain is not None, self.integral_time is not None)
        if self.kind == "pi" and not all(given):
            raise ValueError('kind = "pi" needs its tuning; add gain and integral_time')
        if self.kind == "mpc" and any(given):
            raise ValueError(
                'kind = "mpc" has no gain and integral_time; remove them or set kind = "pi"'
            )
        return self


class ValveWear(_Model):
    """``[valve]``: stick band and slip jump over time, as points (plant second, value)."""

    stick_band: Points
    """S in units of OP."""
    slip_jump: Points = ((0.0, 0.0),)
    """J in units of OP; cut off at S."""
    in_front: bool = False
    """Whether the FMU has no valve of its own: He's valve stands between OP and its input then."""


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


class Load(_Model):
    """``[load]``: what disturbs the process behind the valve."""

    points: Points = ((0.0, 0.0),)
    """Course as points (plant second, value)."""
    sinusoids: tuple[Sinusoid, ...] = ()
    """Oscillations from outside, added to it."""


class SensorFault(_Spell):
    """``[[sensor]]``: a fault of the transmitter of PV, seen by controller and daemon alike."""

    kind: Literal["freeze", "drift", "spikes", "bad"]
    """Value stands still; slope added; single outliers; NaN."""
    rate: float = 0.0
    """PV per second, of a drift."""
    size: float = 0.0
    """PV, of a spike."""
    share: Share = 0.02
    """Of the samples that are spikes."""

    @model_validator(mode="after")
    def _sized(self) -> Self:
        if self.kind == "drift" and not self.rate:
            raise ValueError('kind = "drift" needs a rate; give PV per second')
        if self.kind == "spikes" and not self.size:
            raise ValueError('kind = "spikes" needs a size; give it in units of PV')
        return self


class NetworkFault(_Spell):
    """``[[network]]``: what is wrong between daemon and PLC, or with the PLC."""

    kind: Literal["drop", "late", "write_lost", "write_flipped", "write_torn", "restart"]
    """Polls unanswered; polls that get the cycle before; writes unanswered and without effect;
    writes of several registers of which a bit has changed on the way, or of which the first half
    arrives; the PLC off, to start with empty registers."""
    share: Share = 1.0
    """Of the polls or writes that are hit."""


class Repair(_Model):
    """``[[maintenance]]`` with kind = "repair": the valve is another one from then on."""

    kind: Literal["repair"]
    """The kind."""
    at: Moment
    """Plant second."""
    stick_band: float = Field(default=0.0, ge=0)
    """S afterwards."""
    slip_jump: float = Field(default=0.0, ge=0)
    """J afterwards."""


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


class DaemonSettings(_Model):
    """``[daemon]``: how fieldlink watches the loop; keys as in a site file."""

    window: int = Field(default=600, ge=50, le=100_000)
    """Samples that are judged together."""
    estimate_every: Seconds | None = None
    """Plant seconds between estimates; half a window unless given."""
    write_back: bool = False
    """Whether blocks are written."""
    min_windows: int = Field(default=1, ge=1)
    """Windows that must agree before a block is written."""
    min_interval: float = Field(default=60.0, ge=0)
    """Least plant seconds between two blocks."""
    valid_for: int = Field(default=86400, ge=1)
    """Plant seconds after which the PLC stops using a block."""
    deadband: float = Field(default=0.05, ge=0)
    """Least change of S or J that is worth a new block."""
    stick_band: Span = (0.0, 20.0)
    """Lowest and highest S that may be written."""
    slip_jump: Span = (0.0, 20.0)
    """Lowest and highest J that may be written."""
    criterion: Literal["auto", "oe", "arx"] = "auto"
    """Fit criterion."""


class Scenario(_Model):
    """Top of the file: its tables, and the set-point."""

    scenario: Summary
    """The rehearsal as a whole."""
    plant: RehearsedPlant
    """What stands behind the valve."""
    controller: ControllerSettings
    """What the simulated PLC runs."""
    valve: ValveWear | None = None
    """The valve over time; the FMU's own one unless given."""
    setpoint: Points | None = None
    """Set-point as points (plant second, value); PV at the start unless given."""
    load: Load = Load()
    """What disturbs the process."""
    sensor: tuple[SensorFault, ...] = ()
    """Faults of the transmitter."""
    network: tuple[NetworkFault, ...] = ()
    """Faults between daemon and PLC."""
    maintenance: tuple[Maintenance, ...] = ()
    """What people do at the loop."""
    misestimate: tuple[Misestimate, ...] = ()
    """Times in which the estimator is made to be wrong."""
    daemon: DaemonSettings = DaemonSettings()
    """How fieldlink watches the loop."""
    expect: tuple[Expectation, ...] = Field(min_length=1)
    """What must come of it."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.controller.compensate and not self.daemon.write_back:
            raise ValueError(
                "controller.compensate = true needs blocks; set daemon.write_back = true"
            )
        window = self.daemon.window * self.plant.period
        if window > self.scenario.duration:
            raise ValueError(
                f"one window takes {window:g} s and scenario.duration is "
                f"{self.scenario.duration:g} s; run longer or take a shorter daemon.window"
            )
        return self
