"""The site of a rehearsal: a plant that outlives its PLC, wears, and is disturbed and repaired.

`SimulatedSite.program` is what the simulated PLC runs for the loop. A PLC that restarts asks for a
new one; the plant behind it goes on meanwhile, as plants do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from compensator import Supervisor, WithdrawReason
from fieldlink.lab.plc import (
    Commands,
    ControlledLoop,
    CycleRecord,
    HostedPlant,
    LoopProgram,
    LoopSetup,
)
from fieldlink.lab.rehearse.happenings import Manual
from fieldlink.lab.rehearse.injected_defects import Defect
from fieldlink.lab.rehearse.models import Scenario
from fieldlink.lab.rehearse.piecewise import value_at
from fieldlink.lab.rehearse.worn_plant import WornPlant
from fieldlink.registers import Refusal
from fieldlink.site import Site

__all__ = ["Moment", "SimulatedSite", "Trend"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Moment:
    """The true values of one scan of the loop; the signals are those of `CycleRecord`.

    ``pv`` is the true one, ``measured`` the transmitter's value; ``stick_band`` and
    ``slip_jump`` are the valve's. NaN where unknown.
    """

    time: float
    op: float
    pv: float
    measured: float
    sp: float
    stem: float
    stick_band: float
    slip_jump: float
    automatic: bool
    compensated: bool
    reason: str


@dataclass(frozen=True, eq=False)
class Trend:
    """`Moment`s as arrays of one length; ``reason`` says why the compensator was withdrawn."""

    time: Array
    op: Array
    pv: Array
    measured: Array
    sp: Array
    stem: Array
    stick_band: Array
    slip_jump: Array
    automatic: NDArray[np.bool_]
    compensated: NDArray[np.bool_]
    reason: tuple[str, ...]

    @classmethod
    def of(cls, moments: Sequence[Moment]) -> Trend:
        """Return the moments as arrays, one for each signal."""
        columns = {f.name: [getattr(m, f.name) for m in moments] for f in fields(Moment)}
        reason = tuple(columns.pop("reason"))
        flags = {name: np.array(columns.pop(name), bool) for name in ("automatic", "compensated")}
        return cls(**{name: np.array(c) for name, c in columns.items()}, **flags, reason=reason)


class SimulatedSite:
    """One plant and its surroundings through a rehearsal.

    Args:
        scenario: what happens.
        site, loop: the site that stands for it, and its loop.
        defect: what is broken on purpose.

    Raises:
        PlcError: the plant cannot be started, or its controller does not fit.
        ScenarioError: the plant lacks a variable that the scenario needs.
    """

    def __init__(self, scenario: Scenario, site: Site, loop: str, defect: Defect | None) -> None:
        self._scenario = scenario
        self._defect = defect
        self._setup = LoopSetup.of(site, loop)
        self._op = self._setup.op
        self._plant = WornPlant(self._setup.open(), scenario, self._op)
        self._start_pv = self._plant.true_pv
        self._pvs = self._plant.true_pv, self._plant.measured_pv
        self.moments: list[Moment] = []

    @property
    def time(self) -> float:
        """Plant seconds since the start."""
        return len(self.moments) * self._scenario.plant.period

    def program(self, loop: str) -> LoopProgram:  # noqa: ARG002
        """Return the loop's program for a PLC that starts now."""
        supervise = _Unwatched if self._defect is Defect.NO_FALL_BACK else Supervisor
        plant = HostedPlant(self._plant)
        return _Program(self, self._setup.control(plant, self._op, supervise))

    def coast(self) -> None:
        """Let a period pass without a PLC: OP stays where it is."""
        self._pvs = self._plant.true_pv, self._plant.measured_pv
        names = self._scenario.plant.variables
        stem = self._plant.step({names.op: self._op}).get(names.stem, math.nan)
        self._note(CycleRecord(self._op, math.nan, math.nan, stem, False, False))

    def close(self) -> None:
        """End the plant."""
        self._plant.end()

    def begin(self, inner: ControlledLoop, commands: Commands) -> None:
        """Begin a scan of the loop with what happens at its time."""
        time = self.time
        self._pvs = self._plant.true_pv, self._plant.measured_pv
        course = self._scenario.setpoint
        sp = self._start_pv if course is None else value_at(course, time)
        automatic, op = commands.automatic, self._op
        for event in self._scenario.maintenance:
            if isinstance(event, Manual) and event.covers(time):
                automatic = False
                op = self._op if event.op is None else value_at(event.op, time)
        block = None if self._defect is Defect.NO_COMPENSATION else commands.block
        inner.begin(Commands(automatic, op, sp, block))

    def end(self, inner: ControlledLoop) -> CycleRecord:
        """End the scan."""
        record = inner.end()
        self._op = record.op
        supervisor = inner.supervisor
        self._note(record, "" if supervisor is None else supervisor.reason.name.lower())
        return record

    def _note(self, record: CycleRecord, reason: str = "") -> None:
        time, (pv, measured) = self.time, self._pvs
        S, J = self._plant.valve(time)
        self.moments.append(
            Moment(
                time=time,
                op=record.op,
                pv=pv,
                measured=measured,
                sp=record.sp,
                stem=record.stem,
                stick_band=S,
                slip_jump=J,
                automatic=record.automatic,
                compensated=record.compensated,
                reason=reason,
            )
        )


class _Program:
    """The loop's program of one life of the PLC; the stage keeps the plant."""

    def __init__(self, stage: SimulatedSite, inner: ControlledLoop) -> None:
        self._stage = stage
        self._inner = inner

    @property
    def op(self) -> float:
        return self._inner.op

    @property
    def pv(self) -> float:
        return self._inner.pv

    @property
    def stem(self) -> float:
        return self._inner.stem

    @property
    def refusal(self) -> Refusal | None:
        return self._inner.refusal

    @property
    def supervisor(self) -> Supervisor | None:
        return self._inner.supervisor

    @property
    def plant(self) -> HostedPlant:
        return self._inner.plant

    def begin(self, commands: Commands) -> None:
        self._stage.begin(self._inner, commands)

    def end(self) -> CycleRecord:
        return self._stage.end(self._inner)

    def close(self) -> None:
        """The plant outlives the PLC."""


_NOTICED = {
    WithdrawReason.WORSE,
    WithdrawReason.NO_GAIN,
    WithdrawReason.GROWING,
    WithdrawReason.HUNTING,
    WithdrawReason.TRAVEL,
    WithdrawReason.WRONG_SIGN,
    WithdrawReason.LEFT_RANGE,
}


class _Unwatched(Supervisor):
    """The defect of a PLC that does not notice that compensation makes the loop worse."""

    def withdraw(self, reason: WithdrawReason) -> None:
        if reason not in _NOTICED:
            super().withdraw(reason)
