"""A record as the controller saw it: each sample once, PV without faults and beside its OP."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.arrays import Array, Mask
from estimator.controller.reading import Controller, read_aligned
from estimator.faults import faults_of
from estimator.outcomes import Reason, ReasonCode
from estimator.settings import Screening
from estimator.window import Window

__all__ = ["Cleaned", "Held", "as_recorded", "clean", "find_held", "screen_faults"]

_CHANGES = 20
"""Changes that must all come a number of samples apart: one record in a million does by chance."""


@dataclass(frozen=True, slots=True)
class Held:
    """A record that was polled more slowly than it is stored.

    Attributes:
        every: samples for which each value stands; 1 where each is one of its own.
        first: the sample at which the first whole value begins.
    """

    every: int
    first: int

    def thin(self, signal: Array | None) -> Array | None:
        """Each value of a signal ``(n,)``, if there is one, once."""
        return None if signal is None else signal[self.first :: self.every]

    def hold(self, values: Array, samples: int) -> Array:
        """Thinned values ``(m,)`` as the record stores them, ``(samples,)``."""
        place = (np.arange(samples) - self.first) // self.every
        held: Array = values[np.maximum(place, 0)]
        return held

    def tell(self) -> str:
        """What was done, in words."""
        return f"the record keeps each value for {self.every} samples: each is taken once"


def find_held(op: Array, pv: Array | None) -> Held:
    """How a record ``(n,)`` repeats itself, where OP and PV do at the same samples."""
    changes = np.zeros(op.size, dtype=np.bool_)
    for signal in (op,) if pv is None else (op, pv):
        known = np.nan_to_num(signal, nan=math.inf)
        changes[1:] |= known[1:] != known[:-1]
    places = np.flatnonzero(changes)
    if places.size < _CHANGES:
        return Held(1, 0)
    every = int(np.gcd.reduce(np.diff(places)))
    return Held(every, int(places[0]) % every) if every > 1 else Held(1, 0)


@dataclass(frozen=True, slots=True)
class Cleaned:
    """PV ``(n,)`` as the controller saw it, NaN where it is bad.

    Attributes:
        pv: the samples.
        faults: which samples as recorded are faults of the sensor, ``(n,)``.
        late: samples by which PV was recorded later than OP.
        controller: what explains OP's moves to rounding; None where nothing does.
    """

    pv: Array
    faults: Mask
    late: int
    controller: Controller | None

    def tell(self) -> tuple[Reason, ...]:
        """What was left out, for a window that was judged; empty where nothing was."""
        if not self.faults.any():
            return ()
        return (Reason(ReasonCode.PV_FAULTS, f"{_words(self.faults)}: these are left out"),)

    def tell_late(self) -> tuple[str, ...]:
        """That PV was moved; empty where it was not."""
        if self.late == 0:
            return ()
        by = "1 sample" if self.late == 1 else f"{self.late} samples"
        return (
            f"PV is recorded {by} after the OP that answers it: it is judged as if {by} earlier",
        )


def clean(op: Array, pv: Array, sp: Array | None, settings: Screening) -> Cleaned:
    """PV without its sensor's faults, moved to the OP that answers it; ``(n,)`` each."""
    faults = faults_of(pv, settings)
    aligned = read_aligned(op, np.where(faults, math.nan, pv), sp)
    return Cleaned(aligned.pv, faults, aligned.late, aligned.controller)


def as_recorded(signal: Array, late: int) -> Array:
    """A signal ``(n,)`` that belongs to the moved PV, moved back; its first value is repeated."""
    return np.append(np.full(late, signal[0]), signal[: signal.size - late])


def screen_faults(window: Window, faults: Mask, settings: Screening) -> tuple[Reason, ...]:
    """Why a window without the ``faults`` ``(n,)`` cannot be judged; empty where it can."""
    left = int(window.good.sum())
    if not faults.any() or left >= (1.0 - settings.max_bad) * window.size:
        return ()
    text = (
        f"{_words(faults)}, which leaves {left} of {window.size} samples: "
        f"{1.0 - settings.max_bad:.0%} are needed"
    )
    return (Reason(ReasonCode.PV_FAULTS, text),)


def _words(faults: Mask) -> str:
    return f"PV jumps away, or stands still, in {int(faults.sum())} samples"
