"""A controller's settings, as read off a record."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from estimator.controller.filtered import Filtered
from estimator.controller.fits import Fit

__all__ = ["Controller", "from_filtered", "from_fit"]


@dataclass(frozen=True, slots=True)
class Controller:
    """A controller ``OP = Kc (e + 1/Ti integral of e + Td de/dt)``, ``e = SP - PV``.

    Attributes:
        structure: ``"P"``, ``"PI"``, ``"PID"`` or ``"I"``.
        gain: Kc, OP per PV; positive where OP rises when PV is too low (reverse acting). For
            ``"I"`` it is 0 and ``integral_rate`` holds what there is.
        integral_time_s: Ti in seconds, infinite without integral action.
        derivative_time_s: Td in seconds, 0 without derivative action.
        integral_rate: ``Kc / Ti``, OP per PV and second.
        filter_time_s: time constant of a first-order filter, 0 where there is none.
        derivative_on: ``"error"`` or ``"pv"``.
        delay: samples from PV to OP's answer in the record, 0 or 1.
        explained: share of OP's moves that these settings explain, 0 to 1.
        exact: whether the record is what the controller saw: what these settings leave of OP's
            moves is the record's rounding.
        filter_on: what is filtered: ``"all"``, ``"derivative"`` alone, or ``"pv"`` and not the
            set-point.
        timed: whether the samples that belong together are known: OP of a sample answers PV of
            the sample, or of the one before it (`delay`).
    """

    structure: str
    gain: float
    integral_time_s: float
    derivative_time_s: float
    integral_rate: float
    filter_time_s: float
    derivative_on: str
    delay: int
    explained: float
    exact: bool
    filter_on: str = "all"
    timed: bool = False

    @property
    def action(self) -> str:
        """``"reverse"`` where OP rises when PV is too low, else ``"direct"``."""
        return "reverse" if (self.gain or self.integral_rate) > 0.0 else "direct"

    def samples_late(self, dead_time: int) -> int:
        """Samples after which PV shows OP's answer to it, behind a process of that dead time.

        OP of a sample answers PV of the same sample: it reaches PV a sample later at the least.
        """
        return max(1, dead_time + self.delay)

    def to_dict(self) -> dict[str, float | str | bool | None]:
        """Plain types, null for no number (an infinite integral time)."""
        return {
            "structure": self.structure,
            "gain": self.gain,
            "integral_time_s": self.integral_time_s
            if math.isfinite(self.integral_time_s)
            else None,
            "derivative_time_s": self.derivative_time_s,
            "action": self.action,
            "filter_time_s": self.filter_time_s,
            "filter_on": self.filter_on,
            "derivative_on": self.derivative_on,
            "delay_samples": self.delay,
            "explained": self.explained,
            "exact": self.exact,
        }


def from_filtered(found: Filtered, period: float, explained: float) -> Controller:
    """Return the settings of a law with a filter."""
    one = from_fit(found.fit, period, explained)
    filtered = -period / math.log(found.pole) if found.pole > 1e-3 else 0.0
    by = "error" if found.on == "derivative" and "d" in found.fit.terms else "pv"
    return replace(one, filter_time_s=filtered, filter_on=found.on, derivative_on=by)


def from_fit(fit: Fit, period: float, explained: float, *, timed: bool = True) -> Controller:
    """Return the settings that the coefficients of a law are."""
    values = dict(zip(fit.terms, (float(v) for v in fit.coefficients), strict=False))
    pole = values.get("f", 0.0)
    gain = (values.get("p", values.get("ppv", 0.0))) / (1.0 - pole)
    rate = values.get("i", 0.0) / (1.0 - pole) / period
    derivative = values.get("d", values.get("dpv", 0.0)) / (1.0 - pole)
    structure = {
        (True, False, False): "P",
        (False, True, False): "I",
        (True, True, False): "PI",
        (True, True, True): "PID",
    }.get((gain != 0.0, rate != 0.0, derivative != 0.0), "PID")
    return Controller(
        structure=structure,
        gain=gain,
        integral_time_s=gain / rate if gain and rate else math.inf,
        derivative_time_s=derivative * period / gain if gain and derivative else 0.0,
        integral_rate=rate,
        filter_time_s=-period / math.log(pole) if pole > 1e-3 else 0.0,
        derivative_on="pv" if "dpv" in values else "error",
        delay=fit.delay,
        explained=max(0.0, min(1.0, explained)),
        exact=False,
        timed=timed,
    )
