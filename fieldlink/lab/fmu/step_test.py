"""Step an FMU's input, describe its output as a lag with dead time, and tune a PI for it.

The PI is tuned by SIMC (Skogestad, Simple analytic rules for model reduction and PID controller
tuning, J. Process Control 13 (2003) 291-309).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldlink.lab.fmu.errors import FmuError, nearest
from fieldlink.lab.fmu.experiment import round_to_125
from fieldlink.lab.fmu.signals import is_number
from fmu_models import FmuSummary, StartValue, open_plant

__all__ = ["STEP", "LoopWish", "StepResponse", "is_share", "respond"]

Array = NDArray[np.float64]

STEP = 10.0
"""Percent of OP: large beside rounding, small beside the range."""
_FIRST_STEPS, _MOST_STEPS = 200, 51_200
_SETTLED = 0.02
"""Part of the response that its last fifth may still change by."""
_REMAINS = 0.05
"""Part of the response that may be left when OP has gone back: after the step and after the way
back each tail may still change by ``_SETTLED``, and a little is left for chattering solvers."""
_SAMPLES_A_LAG = 10
"""Samples in the time constant, where neither user nor FMU gives a period."""


@dataclass(frozen=True, slots=True)
class LoopWish:
    """What the user says about the loop.

    Attributes:
        op: input of the FMU that OP in percent drives.
        pv: output of the FMU.
        period: seconds between two scans; None takes the FMU's step, or a tenth of its lag.
        op_start: percent at the start; None takes the FMU's start value.
        op_scale: the FMU's input for 1 % of OP; None takes 1 where the FMU does not speak against.
        start_values: of other variables of the FMU.
        stick_band, slip_jump: of the valve, percent of OP.
    """

    op: str
    pv: str
    period: float | None = None
    op_start: float | None = None
    stick_band: float = 5.0
    slip_jump: float = 1.5
    op_scale: float | None = None
    start_values: Mapping[str, StartValue] = field(default_factory=dict)

    @property
    def scale(self) -> float:
        """The FMU's input for 1 % of OP."""
        return 1.0 if self.op_scale is None else self.op_scale

    def all_start_values(self, op: float) -> dict[str, StartValue]:
        """Return the FMU's start values with OP at ``op`` percent."""
        return {**self.start_values, self.op: op * self.scale}


@dataclass(frozen=True, slots=True)
class StepResponse:
    """A first-order lag with dead time, as a step of OP shows it.

    Attributes:
        start: PV at rest before the step.
        gain: PV per percent of OP; per second where ``integrates``.
        lag, dead_time: seconds.
        integrates: whether PV goes on as long as OP is off.
        period: seconds between two scans.
        op: percent before the step.
        remains: part of the response that is left when OP has gone back; of a process without
            friction next to nothing.
    """

    start: float
    gain: float
    lag: float
    dead_time: float
    integrates: bool
    period: float
    op: float
    remains: float = 0.0

    @property
    def has_own_valve(self) -> bool:
        """Whether the FMU does not come back with OP, as behind a valve that sticks."""
        return abs(self.remains) > _REMAINS

    def tune(self) -> tuple[float, float]:
        """Return gain and integral time (seconds) of a PI by SIMC."""
        late = self.dead_time + 0.5 * self.period
        closed = max(late, 0.2 * self.lag, 2.0 * self.period)
        if self.integrates:
            return 1.0 / (self.gain * (closed + late)), 4.0 * (closed + late)
        return self.lag / (self.gain * (closed + late)), min(self.lag, 4.0 * (closed + late))


def respond(fmu: FmuSummary, wish: LoopWish) -> StepResponse:
    """Step the FMU's input by 10 % and describe what its output does.

    Raises:
        FmuError: a variable is neither input nor output, an input looks like an opening from 0 to
            1 and no scale is given, or an output does not answer.
        PlantError: the FMU does not run.
    """
    _require(fmu, wish.op, "input")
    _require(fmu, wish.pv, "output")
    if wish.op_scale is None and is_share(fmu, wish.op):
        raise FmuError(
            f"{fmu.file.name}: by its range or start value {wish.op} goes from 0 to 1, and OP is "
            "in percent; give --op-scale 0.01, or --op-scale 1 if it does take percent"
        )
    op = _first_op(fmu, wish)
    step = wish.period or fmu.step_size
    if step is None:
        span = (fmu.stop_time or fmu.start_time + 1000.0) - fmu.start_time
        step = span / 500.0
        rough, _ = _measure(fmu, wish, op, step)
        delay = rough.lag + rough.dead_time
        if not rough.integrates or rough.dead_time > step:  # else there is no time to scale by
            step = delay / _SAMPLES_A_LAG
        step = round_to_125(step)
    response, steps = _measure(fmu, wish, op, step)
    return replace(response, remains=_remains(fmu, wish, response, steps))


def is_share(fmu: FmuSummary, name: str) -> bool:
    """Whether an input looks like an opening from 0 to 1: it ends at 1, or starts between."""
    variable = fmu.variable(name)
    if variable is None:
        return False
    try:
        if variable.high:
            return float(variable.high) == 1.0
        return 0.0 < float(variable.start.split()[0]) <= 1.0
    except (ValueError, IndexError):
        return False


def _require(fmu: FmuSummary, name: str, causality: str) -> None:
    known = [
        element
        for v in fmu.variables
        if v.causality == causality and is_number(v)
        for element in fmu.elements(v)
    ]
    if name not in known:
        raise FmuError(f"{fmu.file.name}: it has no {causality} {name!r}; {nearest(name, known)}")


def _first_op(fmu: FmuSummary, wish: LoopWish) -> float:
    if wish.op_start is not None:
        return wish.op_start
    variable = fmu.variable(wish.op)
    text = variable.start.split()[0] if variable is not None and variable.start else ""
    try:
        start = float(text) / wish.scale
    except ValueError:
        return 40.0
    return start if 5.0 <= start <= 95.0 - STEP else 40.0


def _measure(fmu: FmuSummary, wish: LoopWish, op: float, step: float) -> tuple[StepResponse, int]:
    """Compare a run with the step with one without, so that what drifts anyway is left out.

    Returns:
        The response, and how many steps it took to settle.
    """
    steps = _FIRST_STEPS
    while True:
        runs = []
        for value in (op, op + STEP):
            with open_plant(fmu.file, parameters=wish.all_start_values(op), period=step) as plant:
                runs.append(plant.run(steps, {wish.op: value * wish.scale})[wish.pv])
        rise = (runs[1] - runs[0]) / STEP
        start = float(runs[0][-1])
        if not np.abs(rise).max() > 1e-9 * max(1.0, abs(start)):
            low, high = op * wish.scale, (op + STEP) * wish.scale
            raise FmuError(
                f"{fmu.file.name}: {wish.pv} does not answer to {wish.op} stepping from {low:g} to "
                f"{high:g} in {steps * step:g} s; name other variables, or another OP with "
                "--op-start"
            )
        tail = rise[-steps // 5 :]
        if np.ptp(tail) <= _SETTLED * np.abs(rise).max():
            return _describe(rise, step, start, op, integrates=False), steps
        if _is_ramp(rise):
            return _describe(rise, step, start, op, integrates=True), steps
        if steps >= _MOST_STEPS:
            raise FmuError(
                f"{fmu.file.name}: {wish.pv} has not settled {steps * step:g} s after a step of "
                f"{wish.op}; give a longer --period, or another OP with --op-start"
            )
        steps *= 2


def _remains(fmu: FmuSummary, wish: LoopWish, response: StepResponse, steps: int) -> float:
    """Return what part of the response is left when OP has gone there and back.

    Of an integrating process, whose PV stays where it went, that is the part of its slope.
    """
    op, runs = response.op, []
    for value in (op, op + STEP):
        with open_plant(
            fmu.file, parameters=wish.all_start_values(op), period=response.period
        ) as plant:
            plant.run(steps, {wish.op: value * wish.scale})
            runs.append(plant.run(steps, {wish.op: op * wish.scale})[wish.pv])
    left = (runs[1] - runs[0])[-steps // 5 :] / STEP
    if response.integrates:
        slope = float(np.polyfit(response.period * np.arange(left.size), left, 1)[0])
        return slope / response.gain
    return float(left.mean()) / response.gain


def _is_ramp(rise: Array) -> bool:
    """Whether the second half rises as steadily as a straight line."""
    half = rise[rise.size // 2 :]
    k = np.arange(half.size)
    slope, offset = np.polyfit(k, half, 1)
    straight = np.abs(half - (slope * k + offset)).max() <= 0.01 * np.ptp(half)
    quarter = rise[3 * rise.size // 4 :]
    return bool(
        straight
        and abs(np.polyfit(np.arange(quarter.size), quarter, 1)[0] - slope) <= 0.01 * abs(slope)
    )


def _describe(
    rise: Array, step: float, start: float, op: float, *, integrates: bool
) -> StepResponse:
    time = step * np.arange(1, rise.size + 1)
    if integrates:
        half = rise.size // 2
        slope, offset = np.polyfit(time[half:], rise[half:], 1)
        late = -offset / slope
        late = late if late > 1e-6 * step else 0.0  # the rest is rounding
        return StepResponse(start, float(slope), late, late, True, step, op)
    final = float(rise[-1])
    share = rise / final
    early, later = (_first_passage(time, share, part) for part in (0.283, 0.632))
    lag = max(1.5 * (later - early), step)
    return StepResponse(start, final, lag, max(0.0, later - lag), False, step, op)


def _first_passage(time: NDArray[Any], share: NDArray[Any], part: float) -> float:
    """Return when ``share`` first passes ``part``, on a line between the samples."""
    k = int(np.argmax(share >= part))
    before = (0.0, 0.0) if k == 0 else (float(time[k - 1]), float(share[k - 1]))
    return float(np.interp(part, (before[1], share[k]), (before[0], time[k])))
