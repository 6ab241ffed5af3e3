"""One loop in, one :class:`Diagnosis` out: the order of the steps, and nothing else.

Look for the oscillation, read the controller, collect the facts, weigh the explanations, close the
loop, rank the causes, advise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from estimator.arrays import Array, Mask
from estimator.cleaning import find_held, find_slow_transmitter
from estimator.controller.reading import Controller, read_aligned, read_controller
from estimator.controller.shifts import find_shift, shifted, tell_shift
from estimator.diagnosis.amplitude import swing_amplitude
from estimator.diagnosis.causes import rank_causes
from estimator.diagnosis.explanations import Explained, explain
from estimator.diagnosis.facts import Limits, by_hand_of, in_long_runs, limits_of, sensor_of
from estimator.diagnosis.figures import figures_of, share_around
from estimator.diagnosis.gathered import Gathered
from estimator.diagnosis.headroom import headroom_of
from estimator.diagnosis.linear_loop import LinearLoop
from estimator.diagnosis.loop_record import (
    LoopRecord,
    explained_rows,
    loop_record,
    open_loop_swing,
    predictable_shares,
    with_own_setpoint,
    without_setpoint_steps,
    without_steady_wave,
)
from estimator.diagnosis.nonlinearity import largest_bicoherence
from estimator.diagnosis.oscillation import Oscillation, detect_oscillation, has_steady_period
from estimator.diagnosis.plausible import find_plausible
from estimator.diagnosis.removable import removable_share
from estimator.diagnosis.result import Cause, CauseName, Diagnosis
from estimator.diagnosis.settings import DIAGNOSIS, DiagnosisSettings
from estimator.diagnosis.standing import gap_of
from estimator.diagnosis.tuning import Advice, RecordedLoop, advise
from estimator.faults import faults_of
from estimator.settings import SETTINGS
from estimator.window import period_of, signals_of
from loop_model import ProcessModel, ValveModel

__all__ = ["diagnose"]


def diagnose(
    op: ArrayLike,
    pv: ArrayLike | None = None,
    sp: ArrayLike | None = None,
    *,
    auto: ArrayLike | None = None,
    period: float | None = None,
    advice: bool = True,
    figures: bool = True,
    valve_is_healthy: bool = False,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Diagnosis:
    """Say why a loop swings, or how well it runs.

    Args:
        op: controller output, shape ``(n,)``; NaN marks a bad sample.
        pv: process variable, shape ``(n,)``; without it only the oscillation of OP is told.
        sp: set-point, shape ``(n,)``, optional; taken as constant without it.
        auto: non-zero where the controller is in automatic, shape ``(n,)``, optional.
        period: seconds between samples; without it those of a pandas index of times, or 1 s.
        advice: whether to propose settings and simulate them.
        figures: whether to compute the indices that no cause needs; without them there are none.
        valve_is_healthy: whether `estimator.identify` has judged this window's valve healthy; it
            is not judged a second time.
        settings: every chosen number; see `estimator.diagnosis.settings`.

    Returns:
        The diagnosis; :meth:`Diagnosis.to_dict` is its JSON form. What cannot be told is a cause
        too (``undetermined``, with what would determine it).

    Raises:
        EstimatorError: not rows of numbers of one length and index, no finite sample, or a period
            that is not above zero or not that of the index.
    """
    period = period_of(period, op, pv, sp, auto)
    record = loop_record(op, pv, sp, auto, period)
    given, others = signals_of(op, {"pv": pv, "sp": sp, "auto": auto})
    held = find_held(given, others.get("pv"))
    if held.why:
        found = diagnose(
            given[held.at],
            held.thin(others.get("pv")),
            held.thin(others.get("sp")),
            auto=held.thin(others.get("auto")),
            period=held.every * period,
            advice=advice,
            figures=figures,
            valve_is_healthy=valve_is_healthy,
            settings=settings,
        )
        return replace(found, notes=(*found.notes, held.why))
    swing, signal = _oscillation(record, settings)
    if record.pv is None or record.error is None:
        limits = limits_of(record.op, record.op - record.op.mean(), None,
                           np.zeros(record.op.size, dtype=bool), settings.facts)  # fmt: skip
        gathered = Gathered(swing=swing, signal=signal, limits=limits, has_pv=False)
        indices = figures_of(
            record.op, None, None, None, record.auto, period, None, swing, limits, None
        )
        indices["bicoherence"] = _nonlinearity(record, swing, signal, settings)
        return Diagnosis(
            rank_causes(gathered, settings), swing, signal, indices, None, None, record.op.size,
            period, ("only OP is given: causes need PV",),
        )  # fmt: skip
    controller, record, late = _read_controller(record, settings)
    record = with_own_setpoint(record, controller, settings)
    pv, error = record.pv, record.error
    assert pv is not None
    assert error is not None
    by_hand = by_hand_of(record.op, record.auto, error, controller, settings.facts, period)
    recorded = record
    if by_hand.any():
        record = replace(record, auto=~by_hand)
    limits = limits_of(record.op, error, controller, by_hand, settings.facts, period)
    sensor = sensor_of(pv, error, controller, record.good, settings.facts)
    manual = float(np.mean(by_hand))
    gap = gap_of(record.op, error, settings.facts)
    if sensor.frozen > settings.judging.frozen:
        # a frozen PV says nothing of the process
        record = replace(record, good=record.good & ~sensor.still)
    faults = faults_of(np.where(record.good, pv, math.nan), SETTINGS.screening)
    # the controller sees every repeated value, but only new ones tell of valve and process
    slow = find_slow_transmitter(np.where(record.good, pv, math.nan))
    clean = replace(record, good=record.good & ~faults)
    unlimited = replace(clean, good=clean.good & ~limits.where)
    cut = explained_rows(clean.thinned(slow), swing, settings)
    free = explained_rows(unlimited.thinned(slow), swing, settings)
    explained = _explain(cut, swing, controller, manual, valve_is_healthy, settings)
    loop = _closed(None if explained is None else explained.model, controller)
    beside_wave = _closed(None if explained is None else explained.beside_wave, controller)
    standing = open_loop_swing(record, swing, by_hand | limits.where, settings)
    predictable = predictable_shares(record, swing, controller, limits, settings)
    calm = without_steady_wave(error, swing, period, settings)
    known = _known_process(explained, swing, settings)
    size, in_phase, unlike = swing_amplitude(record, swing, settings)
    if sensor.frozen > settings.judging.frozen:
        # a PV that stands still changes the size and no phase
        in_phase, unlike = math.nan, 0.0
    removable = removable_share(calm, known, controller, period, settings)
    gathered = Gathered(
        swing=swing,
        signal=signal,
        limits=limits,
        has_pv=True,
        sensor=sensor,
        manual=manual,
        still=0.0
        if math.isfinite(gap)
        else _unclear(recorded, controller, by_hand | limits.where, settings),
        controller=controller,
        explained=explained,
        loop=loop,
        loop_beside_wave=beside_wave,
        gap=gap,
        op_span=float(np.ptp(record.op)),
        op_middle=float(np.ptp(np.quantile(record.op, [0.05, 0.95]))),
        predictable=predictable,
        samples=cut.op.size,
        duration_s=record.op.size * period,
        setpoint_swings=_setpoint_swings(record, swing, settings),
        wave_share=_wave_share(error, explained, period),
        swing_share=share_around(error, swing.period_s / period) if swing.present else 0.0,
        amplitude=size,
        in_phase=in_phase,
        unlike_noise=unlike,
        open_swing=standing,
        open_share=0.0 if standing is None else share_around(error, standing.period_s / period),
        removable=removable,
        ask_headroom=lambda: headroom_of(free, controller, swing, settings),
    )
    proposal = None
    if advice and explained is not None and controller is not None:
        proposal = _advise(
            cut, explained, controller, limits, rank_causes(gathered, settings), settings
        )
    return Diagnosis(
        causes=rank_causes(gathered, settings, proposal),
        oscillation=swing,
        oscillating=signal,
        indices=_figures(recorded, gathered, proposal, settings) if figures else {},
        controller=controller,
        tuning=None if proposal is None else proposal.to_dict(),
        samples=record.op.size,
        period_s=period,
        notes=(
            *(reason.text for reason in (explained.reasons if explained else ())),
            *tell_shift(late),
            *([slow.why] if slow.why else []),
        ),
    )


def _read_controller(
    record: LoopRecord, settings: DiagnosisSettings
) -> tuple[Controller | None, LoopRecord, int]:
    """The controller, the record with PV as that saw it, and the samples by which PV was late."""

    def read(one: LoopRecord, pv: Array) -> Controller | None:
        return read_controller(
            one.op, pv, one.sp, auto=one.auto, period=one.period, settings=settings.reading
        )

    # a sample that was bridged is none that the controller saw
    assert record.pv is not None
    measured = np.where(record.good, record.pv, math.nan)
    found = read(record, measured)
    if found is not None and found.timed:
        return found, record, 0
    aligned = read_aligned(record.op, measured, record.sp, settings.reading)
    late = aligned.late
    if aligned.controller is None:
        action = 0.0 if found is None else math.copysign(1.0, found.gain or found.integral_rate)
        late = find_shift(_in_auto(record), measured, record.sp, action, settings.reading)
    if late == 0:
        return found, record, 0
    moved = _moved(record, measured, late)
    assert moved.pv is not None
    again = read(moved, np.where(moved.good, moved.pv, math.nan))
    if again is None or (found is not None and again.action != found.action):
        # not the controller's law: the process's
        return found, record, 0
    return replace(again, timed=True), moved, late


def _in_auto(record: LoopRecord) -> Array:
    """OP, NaN where a hand moves it."""
    return record.op if record.auto is None else np.where(record.auto, record.op, math.nan)


def _moved(record: LoopRecord, measured: Array, late: int) -> LoopRecord:
    """The record with PV moved forward by ``late`` samples, or OP where that is negative."""
    auto = None if record.auto is None else record.auto.astype(float)
    op = shifted(record.op, -late)
    return loop_record(op, shifted(measured, late), record.sp, auto, record.period)


def _unclear(
    record: LoopRecord, controller: Controller | None, told: Mask, settings: DiagnosisSettings
) -> float:
    """Share of the samples in which a hand may hold OP, beside those for which that is told."""
    facts = settings.facts
    is_read = controller is not None and controller.explained >= facts.of_moves
    if record.auto is not None or is_read:
        return 0.0
    still = in_long_runs(record.op, max(facts.least_run, int(facts.run_share * record.op.size)))
    return float(np.mean(still & ~told))


def _oscillation(record: LoopRecord, settings: DiagnosisSettings) -> tuple[Oscillation, str]:
    """The main oscillation, of the error if it has one, else of PV, else of OP."""
    best: tuple[Oscillation, str] | None = None
    calm = record.error
    if calm is not None:
        calm = without_setpoint_steps(calm, record.sp)
    # about a constant set-point PV is the error upside down
    pv = None if record.sp is None or np.ptp(record.sp) == 0.0 else record.pv
    for name, values in (("error", calm), ("pv", pv), ("op", record.op)):
        if values is None:
            continue
        found = detect_oscillation(values, period=record.period, settings=settings.swinging)
        if found.present:
            return found, name
        if best is None:
            best = (found, name)
    assert best is not None
    return best


def _nonlinearity(
    record: LoopRecord, swing: Oscillation, signal: str, settings: DiagnosisSettings
) -> float:
    values = {"error": record.error, "pv": record.pv, "op": record.op}[signal]
    if values is None or not swing.present:
        return math.nan
    return largest_bicoherence(values, swing.period_s / record.period, settings.bispectrum)


def _explain(
    cut: LoopRecord,
    swing: Oscillation,
    controller: Controller | None,
    manual: float,
    valve_is_healthy: bool,
    settings: DiagnosisSettings,
) -> Explained | None:
    # a PV that stands still throughout has no row left
    if manual > settings.judging.by_hand or not cut.good.any():
        return None
    assert cut.pv is not None
    cycles = cut.op.size * cut.period / swing.period_s if swing.present else math.nan
    exact = controller if controller is not None and controller.timed else None
    late = exact is not None and exact.delay == 0
    pv = np.where(cut.good, cut.pv, np.nan)
    auto = None if cut.auto is None else cut.auto.astype(float)
    return explain(
        cut.op, pv, cut.sp, auto, cut.period, cycles,
        late=int(late), exact=exact, valve_is_healthy=valve_is_healthy,
        weighing=settings.weighing, advising=settings.advising,
    )  # fmt: skip


def _known_process(
    explained: Explained | None, swing: Oscillation, settings: DiagnosisSettings
) -> ProcessModel | None:
    """The process where it shows; beside a steady wave, which is taken for a resonance else."""
    if explained is None or explained.process < settings.judging.threshold:
        return None
    if explained.beside_wave is not None and has_steady_period(swing, settings.judging):
        return explained.beside_wave
    return explained.model


def _closed(model: ProcessModel | None, controller: Controller | None) -> LinearLoop | None:
    if model is None or controller is None:
        return None
    return LinearLoop.of(model, controller)


def _wave_share(error: Array, explained: Explained | None, period: float) -> float:
    if explained is None or explained.wave is None:
        return 0.0
    return share_around(error, explained.wave.period_s / period)


def _setpoint_swings(record: LoopRecord, swing: Oscillation, settings: DiagnosisSettings) -> bool:
    """Whether the set-point oscillates with the loop's own period."""
    if record.sp is None or not swing.present or np.ptp(record.sp) == 0.0:
        return False
    found = detect_oscillation(record.sp, period=record.period, settings=settings.swinging)
    return found.present and abs(found.period_s / swing.period_s - 1.0) < settings.swinging.same


def _advise(
    cut: LoopRecord,
    explained: Explained,
    controller: Controller,
    limits: Limits,
    causes: tuple[Cause, ...],
    settings: DiagnosisSettings,
) -> Advice | None:
    # not one linear process, PV is not the process's own, or it is not known what moves it
    names, first = [cause.name for cause in causes], causes[0].name
    if CauseName.CHARACTERISTIC in names or CauseName.SENSOR in names:
        return None
    if first is CauseName.UNDETERMINED:
        return None
    # a tuning that swings drives OP to its limits; else they are what the load asks for
    if CauseName.SATURATION in names and first is not CauseName.TIGHT_TUNING:
        return None
    if explained.fitted is None:
        return None
    assert cut.pv is not None
    assert cut.error is not None
    sp = cut.sp if cut.sp is not None else np.full(cut.op.size, np.median(cut.pv + cut.error))
    valve = ValveModel(explained.band, min(explained.jump, explained.band))
    ends = (
        float(cut.op.min()) if limits.low else -math.inf,
        float(cut.op.max()) if limits.high else math.inf,
    )
    return advise(
        find_plausible(explained.fitted, settings.advising),
        controller,
        RecordedLoop.of(cut.pv, sp, explained.stem, ends, valve, slides=explained.slides),
        settings.advising,
    )


def _figures(
    record: LoopRecord, found: Gathered, proposal: Advice | None, settings: DiagnosisSettings
) -> Mapping[str, float]:
    explained, dead = found.explained, None
    if explained is not None and explained.model is not None:
        dead = max(1, round(explained.model.dead_time * explained.model.period / record.period))
    indices = figures_of(
        record.op, record.pv, record.error, record.sp, record.auto, record.period, dead,
        found.swing, found.limits, found.sensor,
    )  # fmt: skip
    indices |= _shares(explained, found.loop, proposal)
    indices["bicoherence"] = _nonlinearity(record, found.swing, found.signal, settings)
    indices["amplification_at_period"] = found.amplification()[0]
    indices["amplification_beside_wave"] = found.amplification_beside_wave()
    return indices


def _shares(
    explained: Explained | None, loop: LinearLoop | None, proposal: Advice | None
) -> Mapping[str, float]:
    """Figures that need the explanations."""
    found = {
        "log_bayes_factor_sticky": math.nan,
        "log_bayes_factor_outside": math.nan,
        "log_bayes_factor_curved": math.nan,
        "wave_beside_valve_period_s": math.nan,
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
        if explained.wave is not None:
            found["wave_beside_valve_period_s"] = explained.wave.period_s
        found["share_without_sticking"] = min(1.0, explained.effect)
    if loop is not None:
        margins = loop.margins()
        found["gain_margin"] = margins.gain
        found["phase_margin_deg"] = margins.phase_deg
        found["sensitivity_ms"] = margins.sensitivity
    if proposal is not None and math.isfinite(proposal.change):
        found["share_without_tuning"] = max(0.0, 1.0 - (1.0 + proposal.change) ** 2)
    return found
