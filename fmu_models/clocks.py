"""Time-based input clocks of FMI 3: the FMU waits for ticks, and this program is who ticks.

A clock of constant, fixed or tunable interval ticks at its shift after the start and every interval
from there; one of a changing interval asks at each tick for the time to the next; a countdown ticks
once when the FMU has asked for it (FMI 3.0, 2.2.8). A clock that is due between two steps ticks at
the start of the next one, so that it sees the inputs which hold from that moment on. Triggered
input clocks belong to other FMUs and never tick here.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from ctypes import c_double, c_int
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fmpy import fmi3

from .archive import read_root
from .errors import PlantFileError

__all__ = ["InputClock", "InputClocks", "read_input_clocks"]

_CHANGED = 2
"""Qualifier of an interval that the FMU has set since it was asked for last."""
_CLOSE = 1e-9
"""Seconds, and share of the time, within which a tick is due: rounding of sums of steps."""


@dataclass(frozen=True, slots=True)
class InputClock:
    """A time-based input clock as the description has it.

    Attributes:
        name: of the variable.
        reference: its value reference.
        kind: constant, fixed, tunable, changing or countdown.
        interval: seconds; None where the FMU gives it while it runs.
        shift: seconds from the start to the first tick.
    """

    name: str
    reference: int
    kind: str
    interval: float | None
    shift: float


def read_input_clocks(file: Path) -> tuple[InputClock, ...]:
    """Return the clocks that this program has to tick.

    Args:
        file: an FMU of FMI 3 whose description can be read.

    Raises:
        PlantFileError: an interval that is no positive number.
    """
    root = read_root(file)
    types = {t.get("name"): t for t in root.iter("ClockType")}
    clocks = []
    for own in root.iter("Clock"):
        declared = types.get(own.get("declaredType"))
        told = {**(declared.attrib if declared is not None else {}), **own.attrib}
        kind = told.get("intervalVariability")
        if own.get("causality") != "input" or kind in (None, "triggered"):
            continue
        try:
            resolution = float(told.get("resolution", "nan"))
            interval = told.get("intervalDecimal")
            seconds = float(interval or float(told.get("intervalCounter", "nan")) / resolution)
            if told.get("shiftDecimal") or "shiftCounter" not in told:
                shift = float(told.get("shiftDecimal", "0"))
            else:
                shift = float(told["shiftCounter"]) / resolution
            usable = not seconds <= 0.0 and math.isfinite(shift)
        except (ValueError, ZeroDivisionError):
            usable = False
        if not usable:
            raise PlantFileError(
                f"{file}: clock {own.get('name')} has no positive interval; export the FMU again"
            )
        known = None if math.isnan(seconds) else seconds
        reference = int(own.get("valueReference"))
        clocks.append(InputClock(own.get("name"), reference, kind, known, shift))
    return tuple(clocks)


class InputClocks:
    """The ticks of one instance.

    Args:
        fmu: FMPy's object, instantiated with event mode.
        clocks: see `read_input_clocks`.

    Attributes:
        next: second of the next tick, infinite without one.
    """

    def __init__(self, fmu: Any, clocks: Sequence[InputClock] = ()) -> None:
        self._fmu = fmu
        self._clocks = tuple(clocks)
        self._intervals = [clock.interval for clock in clocks]
        self._due = [math.inf] * len(self._clocks)
        self._pack = struct.Struct(f"<{2 * len(self._clocks)}d")

    @property
    def next(self) -> float:
        """Second of the next tick, infinite without one."""
        return min(self._due, default=math.inf)

    def is_due(self, time: float) -> bool:
        """Whether a clock ticks at ``time`` or should have ticked before."""
        return bool(self._due) and self.next <= time + _CLOSE * max(1.0, abs(time))

    def next_before(self, goal: float) -> float:
        """Return the second of the next tick, or ``goal`` where none comes before."""
        return self.next if self.next < goal - _CLOSE * max(1.0, abs(goal)) else goal

    def begin(self, time: float) -> None:
        """Set the first ticks; the FMU stands in event mode.

        Raises:
            FMICallException: the FMU does not tell an interval.
        """
        for k, clock in enumerate(self._clocks):
            if clock.kind != "countdown":
                self._due[k] = time + clock.shift
                if clock.interval is None:
                    self._intervals[k] = self._ask(clock)[0]
        self.look(time)

    def tick(self, time: float) -> None:
        """Tick what is due; the FMU stands in event mode, and its discrete states come next.

        Raises:
            FMICallException: the FMU refused.
        """
        limit = time + _CLOSE * max(1.0, abs(time))
        ticking = [k for k, due in enumerate(self._due) if due <= limit]
        self._fmu.setClock([self._clocks[k].reference for k in ticking], [True] * len(ticking))
        for k in ticking:
            interval = self._intervals[k]
            periodic = self._clocks[k].kind != "countdown" and interval is not None
            self._due[k] = self._due[k] + interval if periodic and interval else math.inf

    def look(self, time: float) -> None:
        """Ask for the intervals that the FMU may have set in the event at ``time``.

        Raises:
            FMICallException: the FMU refused.
        """
        for k, clock in enumerate(self._clocks):
            if clock.kind not in ("changing", "countdown", "tunable"):
                continue
            interval, qualifier = self._ask(clock)
            if qualifier != _CHANGED or not math.isfinite(interval):
                continue
            if clock.kind == "countdown":
                self._due[k] = time + interval
            elif interval > 0.0:
                last = self._due[k] - (self._intervals[k] or 0.0)
                self._intervals[k] = interval
                # What has not ticked yet begins at its shift.
                self._due[k] = last + interval if last >= time - _CLOSE else self._due[k]

    def _ask(self, clock: InputClock) -> tuple[float, int]:
        references = (fmi3.fmi3ValueReference * 1)(clock.reference)
        interval, qualifier = (c_double * 1)(), (c_int * 1)()
        self._fmu.getIntervalDecimal(references, interval, qualifier)
        return float(interval[0]), int(qualifier[0])

    def save(self) -> bytes:
        """Return the moments of the next ticks; nothing without clocks."""
        intervals = [math.nan if value is None else value for value in self._intervals]
        return self._pack.pack(*self._due, *intervals)

    def restore(self, content: bytes) -> bytes:
        """Take up what `save` returned; return what stands behind it."""
        values = self._pack.unpack_from(content)
        count = len(self._clocks)
        self._due = list(values[:count])
        self._intervals = [None if math.isnan(v) else v for v in values[count:]]
        return content[self._pack.size :]
