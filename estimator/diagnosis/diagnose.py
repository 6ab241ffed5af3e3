"""One loop in, one :class:`Diagnosis` out: the order of the steps, and nothing else.

Look for the oscillation, read the controller, collect the facts, weigh the explanations, close the
loop, rank the causes, advise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estimator.arrays import Array, Mask
from estimator.diagnosis.causes import Findings, rank_causes
from estimator.diagnosis.controller import Controller, read_controller
from estimator.diagnosis.explanations import Explained, explain
from estimator.diagnosis.facts import Limits, limits_of, sensor_of, share_by_hand
from estimator.diagnosis.figures import figures_of, predictable_share
from estimator.diagnosis.linear_loop import LinearLoop
from estimator.diagnosis.oscillation import Oscillation, bridge, detect_oscillation
from estimator.diagnosis.result import Diagnosis
from estimator.diagnosis.settings import DIAGNOSIS, DiagnosisSettings
from estimator.diagnosis.tuning import Advice, advise
from estimator.outcomes import EstimatorError
from loop_model import ValveModel

__all__ = ["diagnose"]


@dataclass(frozen=True, slots=True)
class _Record:
    """The signals of a loop, whole and without holes."""

    op: Array
    pv: Array | None
    sp: Array | None
    auto: Mask | None
    error: Array | None
    good: Mask
    period: float


def diagnose(
    op: ArrayLike,
    pv: ArrayLike | None = None,
    sp: ArrayLike | None = None,
    *,
    auto: ArrayLike | None = None,
    period: float = 1.0,
    advice: bool = True,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Diagnosis:
    """Say why a loop swings, or how well it runs.

    Args:
        op: controller output, shape ``(n,)``; NaN marks a bad sample.
        pv: process variable, shape ``(n,)``; without it only the oscillation of OP is told.
        sp: set-point, shape ``(n,)``, optional; taken as constant without it.
        auto: non-zero where the controller is in automatic, shape ``(n,)``, optional.
        period: seconds between samples.
        advice: whether to propose settings and simulate them.
        settings: every chosen number; see `estimator.diagnosis.settings`.

    Returns:
        The diagnosis; :meth:`Diagnosis.to_dict` is its JSON form. What cannot be told is a cause
        too (``undetermined``, with what would determine it).

    Raises:
        EstimatorError: not rows of numbers of one length, no finite sample, or a period that is not
            above zero.
    """
    record = _record(op, pv, sp, auto, period)
    swing, signal = _oscillation(record, settings)
    if record.pv is None or record.error is None:
        limits = limits_of(record.op, record.op - record.op.mean(), None,
                           np.zeros(record.op.size, dtype=bool), settings.facts)  # fmt: skip
        findings = Findings(swing=swing, signal=signal, limits=limits, has_pv=False)
        figures = figures_of(
            record.op, None, None, None, record.auto, period, None, swing, limits, None
        )
        return Diagnosis(
            rank_causes(findings, settings), swing, signal, figures, None, None, record.op.size,
            period, ("only OP is given: causes need PV",),
        )  # fmt: skip
    by_hand = ~record.auto if record.auto is not None else np.zeros(record.op.size, dtype=bool)
    controller = read_controller(
        record.op, record.pv, record.sp, auto=record.auto, period=period, settings=settings.reading
    )
    limits = limits_of(record.op, record.error, controller, by_hand, settings.facts)
    sensor = sensor_of(record.pv, record.error, controller, record.good, settings.facts)
    manual = share_by_hand(record.op, record.auto, record.error, settings.facts)
    cut = _window(record, swing, settings)
    explained = _explain(cut, swing, controller, manual, settings)
    loop = _closed(explained, controller)
    findings = Findings(
        swing=swing,
        signal=signal,
        limits=limits,
        has_pv=True,
        sensor=sensor,
        manual=manual,
        controller=controller,
        explained=explained,
        loop=loop,
        op_span=float(np.ptp(record.op)),
        op_middle=float(np.ptp(np.quantile(record.op, [0.05, 0.95]))),
        predictable=_predictable(record, swing, controller, limits, settings),
        samples=cut.op.size,
        setpoint_swings=_setpoint_swings(record, swing, settings),
    )
    dead = None
    if explained is not None and explained.model is not None:
        dead = max(1, round(explained.model.dead_time * explained.model.period / period))
    figures = figures_of(
        record.op, record.pv, record.error, record.sp, record.auto, period, dead, swing, limits,
        sensor,
    )  # fmt: skip
    proposal = None
    if advice and explained is not None and controller is not None:
        proposal = _advise(cut, explained, controller, limits, settings)
    figures |= _shares(explained, loop, proposal)
    return Diagnosis(
        causes=rank_causes(findings, settings, proposal),
        oscillation=swing,
        oscillating=signal,
        indices=figures,
        controller=controller,
        tuning=None if proposal is None else proposal.to_dict(),
        samples=record.op.size,
        period_s=period,
        notes=tuple(reason.text for reason in explained.reasons) if explained else (),
    )


def _record(
    op: ArrayLike,
    pv: ArrayLike | None,
    sp: ArrayLike | None,
    auto: ArrayLike | None,
    period: float,
) -> _Record:
    if not (math.isfinite(period) and period > 0.0):
        raise EstimatorError(f"period is {period!r}: give the seconds between samples, above zero")
    u = bridge(op)
    good = np.isfinite(np.asarray(op, dtype=float))
    given = [("pv", pv), ("sp", sp), ("auto", auto)]
    for name, values in given:
        if values is not None and np.asarray(values).shape != u.shape:
            raise EstimatorError(
                f"op has {u.size} samples and {name} has {np.asarray(values).size}: give every "
                f"signal of the window with the same number of samples"
            )
    if pv is None:
        return _Record(u, None, None, None, None, good, period)
    y = bridge(pv)
    good &= np.isfinite(np.asarray(pv, dtype=float))
    target = None if sp is None or not np.isfinite(np.asarray(sp, float)).any() else bridge(sp)
    mode = None if auto is None else np.asarray(auto, dtype=float) > 0.0
    error = (target if target is not None else float(np.mean(y))) - y
    return _Record(u, y, target, mode, np.asarray(error), good, period)


def _oscillation(record: _Record, settings: DiagnosisSettings) -> tuple[Oscillation, str]:
    """The main oscillation, of the error if it has one, else of PV, else of OP."""
    best: tuple[Oscillation, str] | None = None
    for name, values in (("error", record.error), ("pv", record.pv), ("op", record.op)):
        if values is None:
            continue
        found = detect_oscillation(values, period=record.period, settings=settings.swinging)
        if found.present:
            return found, name
        if best is None:
            best = (found, name)
    assert best is not None
    return best


def _window(record: _Record, swing: Oscillation, settings: DiagnosisSettings) -> _Record:
    """The rows that are explained: of bounded number, with enough samples and enough periods.

    A slow oscillation is thinned, so that a window holds its periods; a fast one is cut to the
    last rows.
    """
    scope = settings.scope
    size = record.op.size
    if swing.present:
        every = max(1, int(swing.period_s / record.period // scope.per_period))
        if size // every < scope.rows // 2:
            # few periods: as many rows as there are, within bounds
            every = max(1, size // scope.rows)
    else:
        every = max(1, size // (2 * scope.rows))
    rows = slice(max(0, size - scope.rows * every), None, every)

    def cut(signal: Array | None) -> Array | None:
        return None if signal is None else signal[rows]

    return _Record(
        op=record.op[rows],
        pv=cut(record.pv),
        sp=cut(record.sp),
        auto=None if record.auto is None else record.auto[rows],
        error=cut(record.error),
        good=record.good[rows],
        period=record.period * every,
    )


def _explain(
    cut: _Record,
    swing: Oscillation,
    controller: Controller | None,
    manual: float,
    settings: DiagnosisSettings,
) -> Explained | None:
    if manual > settings.judging.by_hand:
        return None
    assert cut.pv is not None
    cycles = cut.op.size * cut.period / swing.period_s if swing.present else math.nan
    late = controller is not None and controller.exact and controller.delay == 0
    pv = np.where(cut.good, cut.pv, np.nan)
    auto = None if cut.auto is None else cut.auto.astype(float)
    return explain(
        cut.op, pv, cut.sp, auto, cut.period, cycles, late=int(late), weighing=settings.weighing
    )


def _closed(explained: Explained | None, controller: Controller | None) -> LinearLoop | None:
    if explained is None or explained.model is None or controller is None:
        return None
    return LinearLoop.of(explained.model, controller)


def _predictable(
    record: _Record,
    swing: Oscillation,
    controller: Controller | None,
    limits: Limits,
    settings: DiagnosisSettings,
) -> tuple[float, float]:
    """Shares of the error that are predictable one and two integral times ahead.

    Samples in manual, at a limit, and those that an integral time later still show it do not count.
    """
    nothing = (math.nan, math.nan)
    if controller is None or not math.isfinite(controller.integral_time_s) or swing.present:
        return nothing
    assert record.error is not None
    ahead = round(controller.integral_time_s / record.period)
    if not 0 < ahead <= 0.2 * record.op.size:
        return nothing
    free = record.good.copy()
    if record.auto is not None:
        free &= record.auto
    if limits.share >= settings.facts.least_limit:
        free &= ~limits.where
    held = np.flatnonzero(~free)
    for at in held[np.diff(held, append=record.op.size + 2) > 1]:
        free[at : at + 2 * ahead] = False
    if free.mean() < 0.5:
        return nothing
    error = np.where(free, record.error, np.nan)
    return predictable_share(error, ahead), predictable_share(error, 2 * ahead)


def _setpoint_swings(record: _Record, swing: Oscillation, settings: DiagnosisSettings) -> bool:
    """Whether the set-point oscillates with the loop's own period."""
    if record.sp is None or not swing.present or np.ptp(record.sp) == 0.0:
        return False
    found = detect_oscillation(record.sp, period=record.period, settings=settings.swinging)
    return found.present and abs(found.period_s / swing.period_s - 1.0) < settings.swinging.same


def _advise(
    cut: _Record,
    explained: Explained,
    controller: Controller,
    limits: Limits,
    settings: DiagnosisSettings,
) -> Advice | None:
    judging = settings.judging
    # a process that is hardly told from none gives settings that are not safe
    if explained.model is None or explained.process < judging.advise_from:
        return None
    assert cut.pv is not None
    sp = cut.sp if cut.sp is not None else np.full(cut.op.size, float(np.mean(cut.pv)))
    valve = ValveModel(explained.band, min(explained.jump, explained.band))
    ends = (
        float(cut.op.min()) if limits.low else -math.inf,
        float(cut.op.max()) if limits.high else math.inf,
    )
    proposal = advise(
        explained.model, controller, cut.pv, sp, explained.stem,
        valve if explained.band > 0.0 else None, ends,
    )  # fmt: skip
    if proposal is None or not proposal.integral_ratio <= judging.farthest:
        return None
    return proposal


def _shares(
    explained: Explained | None, loop: LinearLoop | None, proposal: Advice | None
) -> Mapping[str, float]:
    """Figures that need the explanations."""
    found = {
        "log_bayes_factor_sticky": math.nan,
        "log_bayes_factor_outside": math.nan,
        "log_bayes_factor_curved": math.nan,
        "share_without_sticking": math.nan,
        "share_without_tuning": math.nan,
        "gain_margin": math.nan,
        "phase_margin_deg": math.nan,
        "sensitivity_ms": math.nan,
    }
    if explained is not None:
        found["log_bayes_factor_sticky"] = explained.sticking
        found["log_bayes_factor_outside"] = explained.outside
        found["log_bayes_factor_curved"] = explained.curved
        found["share_without_sticking"] = min(1.0, explained.effect)
    if loop is not None:
        margins = loop.margins()
        found["gain_margin"] = margins.gain
        found["phase_margin_deg"] = margins.phase_deg
        found["sensitivity_ms"] = margins.sensitivity
    if proposal is not None:
        found["share_without_tuning"] = max(0.0, 1.0 - (1.0 + proposal.change) ** 2)
    return found
