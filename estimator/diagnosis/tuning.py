"""Better settings for the running controller, and what they would do to this record.

Settings are found for the likeliest process (`estimator.diagnosis.tuning_rules`) and tried on every
plausible one: the record is simulated again with its own disturbance. What they would do is told as
a range that holds for nineteen of twenty of these processes and for those of both halves of the
record, and as one figure where the range is narrow. The range is as much wider as the running
settings, simulated likewise, miss the recorded error. Settings that would make one of twenty swing,
or move OP far beyond where the record shows the process, are not proposed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from estimator.arrays import Array
from estimator.controller.controller import Controller
from estimator.diagnosis.advice_settings import Advising
from estimator.diagnosis.linear_loop import LinearLoop, Margins
from estimator.diagnosis.plausible import PlausibleProcesses
from estimator.diagnosis.replay import Replay
from estimator.diagnosis.tuning_rules import largest_integral_gain, simc
from loop_model import ProcessModel, ValveModel

__all__ = ["Advice", "Proposal", "RecordedLoop", "advise"]

_LARGEST = "largest integral gain at the given Ms (Astrom, Panagopoulos, Hagglund 1998)"
_SIMC = "SIMC, closed-loop time constant as the effective dead time (Skogestad 2003)"

_RUN_AWAY = 1e12
"""Control error beyond which a simulated loop is unstable: no plant has such a PV."""

_STICKY = (
    "The valve sticks: other settings change the size and the period of the cycle and do not end "
    "it. Slower settings make a slower cycle and move the valve less; faster ones follow loads "
    "better and wear the valve more. Repair the valve first."
)
_UNSURE = (
    "What they would do to the control error cannot be told from this record beyond the range "
    "given. Change the settings by half of the way and diagnose again, or record a set-point step."
)


@dataclass(frozen=True, slots=True)
class RecordedLoop:
    """What is replayed: signals without holes ``(n,)``, units of OP and PV.

    ``stem`` is OP for a healthy valve, whose ``friction`` (fS and fD) is zero; ``limits`` of OP.
    ``slides`` is the law of a sticky one, see `Replay.run`.
    """

    pv: Array
    sp: Array
    stem: Array
    limits: tuple[float, float]
    friction: tuple[float, float]
    slides: bool = False

    @classmethod
    def of(
        cls,
        pv: Array,
        sp: Array,
        stem: Array,
        limits: tuple[float, float],
        valve: ValveModel,
        *,
        slides: bool = False,
    ) -> RecordedLoop:
        """The loop with a valve; a stick band of zero is a healthy one."""
        return cls(pv, sp, stem, limits, (valve.static_friction, valve.dynamic_friction), slides)

    def replay(self, process: ProcessModel) -> Callable[[Controller], tuple[Array, Array]]:
        """OP and PV under any controller, if the process is this one."""
        replay = Replay.of(process, self.stem, self.pv)
        return lambda controller: replay.run(
            controller, self.sp, self.limits, self.friction, slides=self.slides
        )

    @property
    def sticks(self) -> bool:
        """Whether the valve sticks."""
        return self.friction[0] > 0.0


@dataclass(frozen=True, slots=True)
class Proposal:
    """Settings by one rule, with what they do to the record.

    Attributes:
        rule: where they are from.
        controller: the settings.
        margins: with the likeliest process.
        integral_ratio: their integral gain over the running one's.
        deviation: standard deviation of the control error, the median of the plausible processes.
        low, high: the range that holds for nineteen of twenty of them and for both halves.
        travel: of OP over the record.
    """

    rule: str
    controller: Controller
    margins: Margins
    integral_ratio: float
    deviation: float
    low: float
    high: float
    travel: float

    def to_dict(self, narrow: float) -> dict[str, Any]:
        """Plain types; no single figure where the range is wider than ``narrow``."""
        is_narrow = self.high <= narrow * self.low
        return {
            "rule": self.rule,
            "structure": self.controller.structure,
            "gain": float(self.controller.gain),
            "integral_time_s": float(self.controller.integral_time_s),
            "derivative_time_s": float(self.controller.derivative_time_s),
            "filter_time_s": float(self.controller.filter_time_s),
            "ms": self.margins.sensitivity,
            "gain_margin": self.margins.gain,
            "phase_margin_deg": self.margins.phase_deg,
            "integral_gain_ratio": self.integral_ratio,
            "predicted_error_std": self.deviation if is_narrow else None,
            "predicted_error_std_low": self.low,
            "predicted_error_std_high": self.high,
            "predicted_op_travel": self.travel,
        }


@dataclass(frozen=True, slots=True)
class Advice:
    """Proposed settings, the best first; advice only, nothing is written.

    Attributes:
        proposals: at least one.
        running: margins of the running controller.
        running_deviation, running_travel: of the running settings, simulated likewise.
        notes: what they cannot cure, in sentences.
        narrow: see `Advising`.
    """

    proposals: tuple[Proposal, ...]
    running: Margins
    running_deviation: float
    running_travel: float
    notes: tuple[str, ...]
    narrow: float

    @property
    def first(self) -> Proposal:
        """The settings that are proposed first."""
        return self.proposals[0]

    @property
    def integral_ratio(self) -> float:
        """Integral gain of the first proposal over the running one's."""
        return self.first.integral_ratio

    @property
    def change(self) -> float:
        """Change of the error's standard deviation, as a share; negative is better.

        NaN where the range is too wide for a single figure.
        """
        first = self.first
        if not self.running_deviation or first.high > self.narrow * first.low:
            return math.nan
        return first.deviation / self.running_deviation - 1.0

    def to_dict(self) -> dict[str, Any]:
        """Return the result in plain types."""
        return self.first.to_dict(self.narrow) | {
            "running_ms": self.running.sensitivity,
            "simulated_running_error_std": self.running_deviation,
            "predicted_change_of_error_std": self.change,
            "simulated_running_op_travel": self.running_travel,
            "alternatives": [one.to_dict(self.narrow) for one in self.proposals[1:]],
            "note": " ".join(self.notes),
        }


def advise(
    plausible: PlausibleProcesses, running: Controller, loop: RecordedLoop, settings: Advising
) -> Advice | None:
    """Propose settings and simulate them on the record; None where none can be proposed.

    Args:
        plausible: processes of the record.
        running: the controller read off it.
        loop: the record.
        settings: see `estimator.diagnosis.advice_settings`.
    """
    process = plausible.likeliest
    if plausible.evidence < settings.advise_from or not running.integral_rate:
        return None
    pi = largest_integral_gain(process, running, settings.robustness)
    rules = [] if pi is None else [(_LARGEST, pi)]
    rules += [(_SIMC, one) for one in simc(process, running)]
    u, y = loop.replay(process)(running)
    simulated = _deviation(loop.sp - y)
    if not 0.0 < simulated < math.inf:
        return None
    missed = float(np.std(loop.sp - loop.pv)) / simulated
    if not 1.0 / settings.narrow <= missed <= settings.narrow:
        # what does not tell the running settings' error does not tell that of others
        return None
    judge = _judged_by(plausible, running, loop, missed, settings)
    proposals = tuple(one for one in (judge(rule, new) for rule, new in rules) if one is not None)
    if not proposals:
        return None
    notes = [_STICKY] if loop.sticks else []
    if proposals[0].high > settings.narrow * proposals[0].low:
        notes.append(_UNSURE)
    return Advice(
        proposals=proposals,
        running=LinearLoop.of(process, running).margins(),
        running_deviation=simulated,
        running_travel=float(np.abs(np.diff(u)).sum()),
        notes=tuple(notes),
        narrow=settings.narrow,
    )


def _judged_by(
    plausible: PlausibleProcesses,
    running: Controller,
    loop: RecordedLoop,
    missed: float,
    settings: Advising,
) -> Callable[[str, Controller], Proposal | None]:
    """How settings are tried on every plausible process; None is what is not proposed.

    ``missed`` is the recorded error over the one that is simulated with the running settings.
    """
    replays = [loop.replay(process) for process in plausible.processes]
    halves = [loop.replay(process) for process in plausible.halves]
    likeliest = loop.replay(plausible.likeliest)
    # OP goes ahead of a sticking stem by its static friction
    beyond = settings.beyond * float(np.ptp(loop.stem)) + loop.friction[0]
    lowest, highest = float(loop.stem.min()) - beyond, float(loop.stem.max()) + beyond
    most = 1.0 - settings.tail

    def judge(rule: str, new: Controller) -> Proposal | None:
        ratio = new.integral_rate / running.integral_rate
        gains = new.gain / running.gain if running.gain else 1.0
        if not all(settings.slowest <= one <= settings.farthest for one in (ratio, gains)):
            return None
        margins = [LinearLoop.of(process, new).margins() for process in plausible.processes]
        peaks = np.array([one.sensitivity if one.stable else math.inf for one in margins])
        if float(plausible.shares[peaks > settings.robust].sum()) > settings.tail:
            return None
        sizes = np.array([_deviation(loop.sp - run(new)[1]) for run in replays])
        apart = [_deviation(loop.sp - run(new)[1]) for run in halves]
        if not np.isfinite([*sizes, *apart]).all():
            return None
        low, middle, high = _quantiles(sizes, plausible.shares, (settings.tail, 0.5, most))
        low, high = min(low, *apart, middle), max(high, *apart, middle)
        blur = settings.blur_cycle if loop.sticks else settings.blur
        u, _ = likeliest(new)
        if u.min() < lowest or u.max() > highest:
            return None
        return Proposal(
            rule=rule,
            controller=new,
            margins=LinearLoop.of(plausible.likeliest, new).margins(),
            integral_ratio=ratio,
            deviation=middle,
            low=low * (1.0 - blur) * min(1.0, missed),
            high=high * (1.0 + blur) * max(1.0, missed),
            travel=float(np.abs(np.diff(u)).sum()),
        )

    return judge


def _deviation(error: Array) -> float:
    """Standard deviation; infinite where the simulated loop ran away."""
    return float(np.std(error)) if np.abs(error).max() < _RUN_AWAY else math.inf


def _quantiles(values: Array, shares: Array, at: tuple[float, ...]) -> tuple[float, ...]:
    order = np.argsort(values, kind="stable")
    below = np.cumsum(shares[order]) - 0.5 * shares[order]
    return tuple(float(v) for v in np.interp(at, below, values[order]))
