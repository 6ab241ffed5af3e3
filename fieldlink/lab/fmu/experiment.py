"""When a run ends and how long its steps are, where the user does not say."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fieldlink.lab.fmu.errors import FmuError
from fmu_models import FmuSummary

__all__ = ["MOST_STEPS", "Steps", "choose_step", "choose_stop", "divide", "round_to_125"]

MOST_STEPS = 20_000_000
"""Of a run: the table of ten columns takes 1.6 GB of memory."""
_MOST_BY_DEFAULT = 1_000_000
"""Steps of a run whose step was not given: half a minute of a fast FMU."""
_DEFAULT_STEPS = 500
"""Where the FMU recommends no step: enough for a smooth picture."""


@dataclass(frozen=True, slots=True)
class Steps:
    """The steps of a run.

    Attributes:
        count: how many, the last included.
        last: seconds of the last, where it is shorter than the others.
    """

    count: int
    last: float | None


def choose_stop(fmu: FmuSummary, wanted: float | None) -> float:
    """Return the second at which a run ends: ``wanted``, or the default experiment's.

    Raises:
        FmuError: neither is given, or it is not finite.
    """
    stop = fmu.stop_time if wanted is None else wanted
    if stop is None:
        raise FmuError(f"{fmu.file.name}: it names no stop time; give one with --stop SECONDS")
    if not math.isfinite(stop):
        raise FmuError(f"{fmu.file.name}: the stop time must be a finite second; got {stop:g}")
    return stop


def choose_step(fmu: FmuSummary, stop: float, wanted: float | None) -> tuple[float, str | None]:
    """Return the seconds of a step, and what the user should know about it.

    Without ``wanted`` it is what the FMU recommends. Where that is nothing, or would make more than
    a million steps, it is a round part of the experiment that makes some hundred steps.

    Raises:
        FmuError: the experiment ends before it begins.
    """
    if wanted is not None:
        return wanted, None
    span = stop - fmu.start_time
    own = fmu.step_size
    if not span > 0.0:
        if own:
            return own, None
        raise FmuError(
            f"{fmu.file.name}: the stop time {stop:g} s must lie after the start at "
            f"{fmu.start_time:g} s; give a later one with --stop"
        )
    if own and span / own <= _MOST_BY_DEFAULT:
        return own, None
    step = round_to_125(span / _DEFAULT_STEPS)
    if own:
        step = own * round_to_125(span / _DEFAULT_STEPS / own)
        why = f"its own step of {own:g} s would make {span / own:.3g} steps"
    else:
        why = "it names no step"
    return step, f"{why}, so it takes {step:g} s; choose another with --step"


def round_to_125(raw: float) -> float:
    """Return 1, 2 or 5 times a power of ten, the nearest."""
    power = 10.0 ** math.floor(math.log10(raw))
    return min((factor * power for factor in (1.0, 2.0, 5.0, 10.0)), key=lambda h: abs(h - raw))


def divide(start: float, stop: float, step: float, *, variable: bool) -> Steps:
    """Divide a run into steps; the last is shorter where ``stop`` is not a multiple of ``step``.

    Args:
        start: second of the first step.
        stop: second at which the run ends.
        step: seconds.
        variable: whether the FMU takes a shorter step; else the run ends one step earlier.

    Raises:
        FmuError: no step, or too many; a stop before the start.
    """
    if not 0.0 < step < math.inf:
        raise FmuError(f"a step must be a positive number of seconds; got {step:g}")
    if not stop > start:
        raise FmuError(
            f"the stop time {stop:g} s must lie after the start at {start:g} s; give a later one "
            "with --stop"
        )
    exact = (stop - start) / step
    count = math.ceil(exact - 1e-9)
    last = stop - (start + (count - 1) * step)
    short = last < step * (1.0 - 1e-9)
    if short and not variable:
        count -= 1
    if not 1 <= count <= MOST_STEPS:
        raise FmuError(
            f"from {start:g} s to {stop:g} s in steps of {step:g} s are {count} steps; give a stop "
            f"time and a step with 1 to {MOST_STEPS} steps"
        )
    return Steps(count, last if short and variable else None)
