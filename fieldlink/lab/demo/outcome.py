"""What a demonstration comes to, in figures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldlink.lab.plc import Truth
from loop_model import ValveModel

__all__ = ["Change", "DemoOutcome", "Estimated", "Phase", "phases"]

SETTLE = 100
"""Cycles after take-over that are the way to the new state and not the state itself."""


@dataclass(frozen=True, slots=True)
class Phase:
    """A loop's figures over a run of cycles.

    Attributes:
        start, stop: cycles.
        pv_std: standard deviation of PV.
        valve_travel: sum of the stem's movements per 100 cycles, units of OP.
        reversals: changes of the stem's direction per 100 cycles.

    The last two are NaN where the stem is unknown.
    """

    start: int
    stop: int
    pv_std: float
    valve_travel: float
    reversals: float

    @classmethod
    def of(cls, truth: Truth, start: int, stop: int) -> Phase:
        """Measure cycles ``start`` to ``stop``.

        A cycle that came before the plant was ready knows neither PV nor stem; the stem's way past
        it is the one between its neighbours.
        """
        stem = truth.stem[start:stop]
        moves = np.diff(stem[np.isfinite(stem)])
        pv_std = float(np.nanstd(truth.pv[start:stop]))
        if moves.size == 0:
            return cls(start, stop, pv_std, math.nan, math.nan)
        directions = np.sign(moves[moves != 0.0])
        per_hundred = 100.0 / (stop - start)
        return cls(
            start,
            stop,
            pv_std,
            float(np.abs(moves).sum()) * per_hundred,
            float(np.count_nonzero(np.diff(directions))) * per_hundred,
        )


def phases(truth: Truth) -> tuple[Phase, Phase | None]:
    """Return a loop before and after its compensator took over; None where it never did.

    Both are of the same length, the one before ends at the take-over.
    """
    cycles = truth.cycle.size
    taken: NDArray[np.int64] = np.flatnonzero(truth.compensated)
    if taken.size == 0 or cycles - taken[0] <= SETTLE + 1:
        return Phase.of(truth, 0, cycles), None
    take_over = int(taken[0])
    length = min(take_over, cycles - take_over - SETTLE)
    return (
        Phase.of(truth, take_over - length, take_over),
        Phase.of(truth, cycles - length, cycles),
    )


@dataclass(frozen=True, slots=True)
class Estimated:
    """The true value of a parameter (NaN where unknown) and the identified one."""

    true: float
    value: float
    low: float
    high: float

    def to_dict(self) -> dict[str, float | None]:
        """Plain numbers, null for NaN."""
        return {
            "true": _finite(self.true),
            "value": _finite(self.value),
            "low": _finite(self.low),
            "high": _finite(self.high),
        }


@dataclass(frozen=True, slots=True)
class Change:
    """A figure before and after the take-over; NaN where there was none."""

    before: float
    after: float

    @property
    def ratio(self) -> float:
        """After over before."""
        return self.after / self.before if self.before else math.nan

    def to_dict(self) -> dict[str, float | None]:
        """Plain numbers, null for NaN."""
        return {
            "before": _finite(self.before),
            "after": _finite(self.after),
            "ratio": _finite(self.ratio),
        }


@dataclass(frozen=True, slots=True)
class DemoOutcome:
    """The figures of one demonstration; `to_dict` is what ``fieldlink demo --json`` prints."""

    stick_band: Estimated
    slip_jump: Estimated
    pv_std: Change
    valve_travel: Change
    reversals: Change
    requests: int
    late_slots: int
    report: Path
    page: str | None = None

    @classmethod
    def of(
        cls,
        *,
        valve: ValveModel | None,
        stick_band: tuple[float, float, float],
        slip_jump: tuple[float, float, float],
        truth: Truth,
        requests: int,
        late_slots: int,
        report: Path,
        page: str | None = None,
    ) -> DemoOutcome:
        """Put the figures together; ``stick_band`` and ``slip_jump`` are value, low, high."""
        before, after = phases(truth)

        def change(name: str) -> Change:
            return Change(
                getattr(before, name), math.nan if after is None else getattr(after, name)
            )

        return cls(
            Estimated(math.nan if valve is None else valve.stick_band, *stick_band),
            Estimated(math.nan if valve is None else valve.slip_jump, *slip_jump),
            change("pv_std"),
            change("valve_travel"),
            change("reversals"),
            requests,
            late_slots,
            report,
            page,
        )

    def to_dict(self) -> dict[str, Any]:
        """The JSON object."""
        return {
            "stick_band": self.stick_band.to_dict(),
            "slip_jump": self.slip_jump.to_dict(),
            "pv_std": self.pv_std.to_dict(),
            "valve_travel": self.valve_travel.to_dict(),
            "reversals": self.reversals.to_dict(),
            "requests": self.requests,
            "late_slots": self.late_slots,
            "report": str(self.report),
            "page": self.page,
        }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
