"""The scenario file, key by key, as typed and frozen models.

What happens in a run and what is expected of it have models of their own, in
`fieldlink.lab.rehearse.happenings` and `fieldlink.lab.rehearse.expected`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, Self

from pydantic import Field, model_validator

from fieldlink.lab.rehearse.expected import (
    Expectation,
    FallBackExpected,
    PvExpected,
    TakeOverExpected,
)
from fieldlink.lab.rehearse.happenings import (
    Load,
    Maintenance,
    Misestimate,
    NetworkFault,
    Points,
    ScenarioModel,
    Seconds,
    SensorFault,
    Sizes,
)
from fieldlink.lab.rehearse.injected_defects import Defect
from fieldlink.site.models import Span
from fieldlink.site.start_value import StartValue

__all__ = [
    "ControllerSettings",
    "DaemonSettings",
    "PlantVariables",
    "RehearsedPlant",
    "Scenario",
    "Summary",
    "ValveWear",
]


class Summary(ScenarioModel):
    """``[scenario]``: the rehearsal as a whole."""

    title: str = Field(min_length=1)
    """One line for people."""
    text: str = ""
    """What it shows, in a few sentences."""
    duration: Seconds
    """Plant seconds that are run."""
    seed: int = Field(default=1, ge=0, le=0x7FFFFFFF)
    """Seed of the scenario's own noise and faults, and of a catalogue plant's noise."""
    defects: tuple[Defect, ...] = ()
    """Defects (see --inject) of which each must make the scenario fail."""


class PlantVariables(ScenarioModel):
    """``[plant.variables]``: what the FMU calls things."""

    op: str = "op"
    """Input: controller output."""
    op_scale: float = Field(default=1.0, gt=0, le=1e6)
    """The FMU's input for 1 % of OP: 0.01 for an opening from 0 to 1."""
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


class RehearsedPlant(ScenarioModel):
    """``[plant]``: what stands behind the valve."""

    fmu: str = Field(min_length=1)
    """Name in the catalogue, or path of an .fmu file relative to the scenario file."""
    period: Seconds = 1.0
    """Plant seconds between two scans of the controller."""
    parameters: Mapping[str, StartValue] = {}
    """Start values of the FMU's parameters: numbers, words, texts in quotes."""
    variables: PlantVariables = PlantVariables()
    """What the FMU calls things."""


class ControllerSettings(ScenarioModel):
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


class ValveWear(ScenarioModel):
    """``[valve]``: stick band and slip jump over time, as points (plant second, value)."""

    stick_band: Sizes
    """S in units of OP."""
    slip_jump: Sizes = ((0.0, 0.0),)
    """J in units of OP; cut off at S."""
    in_front: bool = False
    """Whether the FMU has no valve of its own: He's valve stands between OP and its input then."""


class DaemonSettings(ScenarioModel):
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


class Scenario(ScenarioModel):
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
    """The expected results."""

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
        if not self.controller.compensate:
            for expected in self.expect:
                if isinstance(expected, TakeOverExpected | FallBackExpected):
                    raise ValueError(
                        f'kind = "{expected.kind}" expects something of a compensator that is not '
                        "there; set controller.compensate = true"
                    )
        self._require_in_time()
        return self

    def _require_in_time(self) -> None:
        """What begins after the run would never happen, and be expected without any risk."""
        begins = [
            (f"{name}.{number}", begin)
            for name in ("sensor", "network", "maintenance", "misestimate", "expect")
            for number, item in enumerate(getattr(self, name))
            for begin in (getattr(item, key, None) for key in ("begin", "at", "after"))
            if begin is not None
        ]
        begins += [(f"load.sinusoids.{n}", s.begin) for n, s in enumerate(self.load.sinusoids)]
        begins += [
            (f"expect.{number}", max(item.first[0], item.then[0]))
            for number, item in enumerate(self.expect)
            if isinstance(item, PvExpected)
        ]
        for where, begin in begins:
            if begin >= self.scenario.duration:
                raise ValueError(
                    f"{where} begins at {begin:g} s and scenario.duration is "
                    f"{self.scenario.duration:g} s; run longer or begin earlier"
                )
