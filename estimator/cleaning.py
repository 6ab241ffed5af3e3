"""A record as the controller saw it: each sample once, PV without faults and beside its OP."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.arrays import Array, Index, Mask
from estimator.controller.controller import Controller
from estimator.controller.reading import read_aligned
from estimator.controller.shifts import tell_shift
from estimator.faults import faults_of
from estimator.outcomes import Reason, ReasonCode
from estimator.settings import Screening
from estimator.window import Window

__all__ = [
    "Cleaned",
    "Held",
    "as_recorded",
    "clean",
    "find_held",
    "find_slow_transmitter",
    "screen_faults",
]

_CHANGES = 20
"""Changes that must all come a number of samples apart: one record in a million does by chance."""
_JITTER = 0.25
"""Share by which the times may differ for which a transmitter's values stand."""
_REGULAR = 0.9
"""Share of them that are that alike: of values that change by chance not half are."""
_ONE_STEP = 0.5
"""Share of the steps from which they are those of a coarse signal that moves steadily."""


@dataclass(frozen=True, slots=True)
class Held:
    """A record in which values stand for several samples.

    Attributes:
        at: the samples at which each value is new, ``(m,)``.
        every: samples for which a value stands, in the mean; 1 where each is one of its own.
        why: what that means, in words; empty where each is one of its own.
    """

    at: Index
    every: float = 1.0
    why: str = ""

    def thin(self, signal: Array | None) -> Array | None:
        """Each value of a signal ``(n,)``, if there is one, once."""
        return None if signal is None else signal[self.at]

    def hold(self, values: Array, samples: int) -> Array:
        """Thinned values ``(m,)`` as the record stores them, ``(samples,)``."""
        place = np.searchsorted(self.at, np.arange(samples), side="right") - 1
        held: Array = values[np.maximum(place, 0)]
        return held


def find_held(op: Array, pv: Array | None) -> Held:
    """How a record ``(n,)`` repeats itself, where OP and PV do at the same samples."""
    changed = _changes_of(op) if pv is None else _changes_of(op) | _changes_of(pv)
    places = np.flatnonzero(changed) + 1
    every = int(np.gcd.reduce(np.diff(places))) if places.size >= _CHANGES else 1
    if every == 1:
        return Held(np.arange(op.size))
    at = np.arange(int(places[0]) % every, op.size, every)
    return Held(at, every, f"the record keeps each value for {every} samples: each is taken once")


def find_slow_transmitter(pv: Array) -> Held:
    """How PV ``(n,)`` repeats itself alone: an analyser, a wireless transmitter.

    Its values come by a clock, so that all stand about equally long. A coarse or a compressed PV
    stands long where it moves little; where it moves steadily, all its steps are alike.
    """
    each = Held(np.arange(pv.size))
    places = np.flatnonzero(_changes_of(pv)) + 1
    if places.size < _CHANGES:
        return each
    gaps, steps = np.diff(places), np.abs(np.diff(pv[places]))
    usual = float(np.median(gaps))
    if usual < 2.0:
        return each
    alike = np.abs(gaps - usual) <= max(1.0, _JITTER * usual)
    if float(np.mean(alike & (gaps > 1))) < _REGULAR:
        return each
    _, times = np.unique(np.round(steps / np.nanmax(steps), 6), return_counts=True)
    if times.max() > _ONE_STEP * steps.size:
        return each
    # where a value happens to be that of the last one, it stands for two
    number = np.concatenate([[0.0], np.cumsum(np.maximum(1.0, np.rint(gaps / usual)))])
    every = float(places[-1] - places[0]) / float(number[-1])
    at = np.rint(np.interp(np.arange(number[-1] + 1.0), number, places)).astype(np.int64)
    return Held(at, every, f"PV has a new value every {every:.3g} samples: it is judged at these")


def _changes_of(signal: Array) -> Mask:
    """Which samples of ``(n,)`` but the first differ from the one before, ``(n - 1,)``."""
    known = np.nan_to_num(signal, nan=math.inf)
    changed: Mask = known[1:] != known[:-1]
    return changed


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
        return tell_shift(self.late)


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
