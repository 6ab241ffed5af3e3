"""The facts of a loop: everything that is found about it before causes are ranked."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from estimator.arrays import Array, Mask
from estimator.cleaning import find_slow_transmitter
from estimator.controller.controller import Controller
from estimator.controller.shifts import tell_shift
from estimator.diagnosis.amplitude import swing_amplitude
from estimator.diagnosis.curvature import curvature_of
from estimator.diagnosis.explanations import Explained, explain
from estimator.diagnosis.facts import by_hand_of, in_long_runs, limits_of, sensor_of, span_of
from estimator.diagnosis.figures import few_steps, share_around
from estimator.diagnosis.gathered import Gathered
from estimator.diagnosis.headroom import headroom_of
from estimator.diagnosis.linear_loop import LinearLoop
from estimator.diagnosis.loop_record import (
    LoopRecord,
    explained_rows,
    open_loop_swing,
    predictable_shares,
    with_own_setpoint,
    without_setpoint_steps,
    without_steady_wave,
)
from estimator.diagnosis.oscillation import Oscillation, detect_oscillation, has_steady_period
from estimator.diagnosis.removable import removable_share
from estimator.diagnosis.seen_controller import read_seen
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.diagnosis.standing import gap_of
from estimator.faults import faults_of
from estimator.settings import SETTINGS
from loop_model import ProcessModel

__all__ = ["Facts", "find_swing", "gather"]


@dataclass(frozen=True)
class Facts:
    """What is known of a loop.

    Attributes:
        found: what causes are ranked by.
        record: the record as the controller saw it, with its set-point.
        cut: the rows of it that were explained.
        notes: what was done to the record before it was explained.
    """

    found: Gathered
    record: LoopRecord
    cut: LoopRecord
    notes: tuple[str, ...]


def gather(
    record: LoopRecord,
    swing: Oscillation,
    signal: str,
    settings: DiagnosisSettings,
    *,
    valve_is_healthy: bool,
    op_span: float | None = None,
) -> Facts:
    """Read the controller, collect the facts, weigh the explanations, close the loop.

    Args:
        record: a loop with PV.
        swing: its main oscillation, and ``signal`` where that is.
        settings: every chosen number.
        valve_is_healthy: whether the valve is known to be; it is not judged again.
        op_span: OP's span, units of OP; None for `span_of`.
    """
    period = record.period
    controller, record, late = read_seen(record, settings)
    record = with_own_setpoint(record, controller, settings)
    pv, error = record.pv, record.error
    assert pv is not None
    assert error is not None
    by_hand = by_hand_of(
        record.op, record.auto, error, controller, settings.facts, period, record.good
    )
    recorded = record
    if by_hand.any():
        record = replace(record, auto=~by_hand)
    limits = limits_of(record.op, error, controller, by_hand, settings.facts, period, recorded.good)
    sensor = sensor_of(
        pv, error, controller, record.good, settings.facts,
        op_span=span_of(record.op) if op_span is None else op_span,
    )  # fmt: skip
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
    found = Gathered(
        swing=swing,
        signal=signal,
        limits=limits,
        has_pv=True,
        sensor=sensor,
        manual=manual,
        has_mode=recorded.auto is not None,
        still=0.0
        if math.isfinite(gap)
        else _unclear(recorded, controller, by_hand | limits.where, settings),
        controller=controller,
        explained=explained,
        loop=loop,
        loop_beside_wave=beside_wave,
        gap=gap,
        curvature=curvature_of(explained, record.op, pv[record.good]),
        op_span=float(np.ptp(record.op)),
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
        ask_own_wave=lambda: _own_wave(cut, loop, swing, controller, settings),
    )
    return Facts(found, recorded, cut, (*tell_shift(late), *([slow.why] if slow.why else [])))


def find_swing(record: LoopRecord, settings: DiagnosisSettings) -> tuple[Oscillation, str]:
    """The main oscillation, of the error if it has one, else of PV, else of OP."""
    best: tuple[Oscillation, str] | None = None
    calm = record.error
    if calm is not None:
        calm = without_setpoint_steps(calm, record.sp)
    # PV and OP follow the set-point: where that steps now and then, scattered steps have no period
    steps = 0 if record.sp is None else int(np.count_nonzero(np.diff(record.sp)))
    follows = 0 < steps <= few_steps(record.op.size)
    # about a constant set-point PV is the error upside down
    pv = None if record.sp is None or np.ptp(record.sp) == 0.0 else record.pv
    for name, values in (("error", calm), ("pv", pv), ("op", record.op)):
        if values is None:
            continue
        found = detect_oscillation(values, period=record.period, settings=settings.swinging)
        is_own = name == "error" or not follows or has_steady_period(found, settings.judging)
        if found.present and is_own:
            return found, name
        if best is None:
            best = (found, name)
    assert best is not None
    return best


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


def _own_wave(
    cut: LoopRecord,
    loop: LinearLoop | None,
    swing: Oscillation,
    controller: Controller | None,
    settings: DiagnosisSettings,
) -> float:
    """Weigh a wave from outside at the period at which the identified loop swings by itself."""
    if loop is None:
        return math.nan
    period_s = loop.swing()[0] * loop.period
    cycles = cut.op.size * cut.period / period_s
    own = replace(swing, present=True, period_s=period_s, cycles=cycles)
    again = _explain(cut, own, controller, 0.0, True, settings)
    return math.nan if again is None else again.outside


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
