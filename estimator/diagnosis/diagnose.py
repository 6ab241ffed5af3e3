"""One loop in, one :class:`Diagnosis` out: the order of the steps, and nothing else.

Look for the oscillation, gather the facts, rank the causes, propose settings.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from estimator.cleaning import find_held
from estimator.diagnosis.all_figures import all_figures, bicoherence_of
from estimator.diagnosis.causes import rank_causes
from estimator.diagnosis.facts import limits_of
from estimator.diagnosis.figures import figures_of
from estimator.diagnosis.gather import find_swing, gather
from estimator.diagnosis.gathered import Gathered
from estimator.diagnosis.loop_record import LoopRecord, loop_record
from estimator.diagnosis.oscillation import Oscillation
from estimator.diagnosis.proposal import propose
from estimator.diagnosis.result import Diagnosis
from estimator.diagnosis.settings import DIAGNOSIS, DiagnosisSettings
from estimator.outcomes import EstimatorError
from estimator.window import period_of, signals_of

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
    op_span: float | None = None,
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
        op_span: units of OP from shut to open, by which it is told how far noise moves the valve;
            without it 1 where OP lies between 0 and 1, else 100.
        settings: every chosen number; see `estimator.diagnosis.settings`.

    Returns:
        The diagnosis; :meth:`Diagnosis.to_dict` is its JSON form. What cannot be told is a cause
        too (``undetermined``, with what would determine it).

    Raises:
        EstimatorError: not rows of numbers of one length and index, no finite sample, a period
            that is not above zero or not that of the index, or a span that is not above zero.
    """
    if op_span is not None and not op_span > 0.0:
        raise EstimatorError(f"op_span is {op_span:g}: it must be above zero")
    period = period_of(period, op, pv, sp, auto)
    record = loop_record(op, pv, sp, auto, period)
    given, others = signals_of(op, {"pv": pv, "sp": sp, "auto": auto})
    held = find_held(given, others.get("pv"))
    if held.why:
        thinned = diagnose(
            given[held.at],
            held.thin(others.get("pv")),
            held.thin(others.get("sp")),
            auto=held.thin(others.get("auto")),
            period=held.every * period,
            advice=advice,
            figures=figures,
            valve_is_healthy=valve_is_healthy,
            op_span=op_span,
            settings=settings,
        )
        return replace(thinned, notes=(*thinned.notes, held.why))
    swing, signal = find_swing(record, settings)
    if record.pv is None or record.error is None:
        return _of_op_alone(record, swing, signal, settings)
    facts = gather(
        record, swing, signal, settings, valve_is_healthy=valve_is_healthy, op_span=op_span
    )
    found = facts.found
    explained, controller, proposal = found.explained, found.controller, None
    if advice and explained is not None and controller is not None:
        causes = rank_causes(found, settings)
        proposal = propose(
            facts.cut, explained, controller, found.limits, causes, settings, has_gap=found.has_gap
        )
    return Diagnosis(
        causes=rank_causes(found, settings, proposal),
        oscillation=swing,
        oscillating=signal,
        indices=all_figures(facts.record, found, proposal, settings) if figures else {},
        controller=controller,
        tuning=None if proposal is None else proposal.to_dict(),
        samples=record.op.size,
        period_s=period,
        notes=(
            *(reason.text for reason in (explained.reasons if explained else ())),
            *facts.notes,
        ),
    )


def _of_op_alone(
    record: LoopRecord, swing: Oscillation, signal: str, settings: DiagnosisSettings
) -> Diagnosis:
    nowhere = np.zeros(record.op.size, dtype=bool)
    centred = record.op - record.op.mean()
    limits = limits_of(record.op, centred, None, nowhere, settings.facts, usable=record.good)
    indices = figures_of(
        record.op, None, None, None, record.auto, record.period, None, swing, limits, None
    )
    indices["bicoherence"] = bicoherence_of(record, swing, signal, settings)
    gathered = Gathered(swing=swing, signal=signal, limits=limits, has_pv=False)
    return Diagnosis(
        rank_causes(gathered, settings), swing, signal, indices, None, None, record.op.size,
        record.period, ("only OP is given: causes need PV",),
    )  # fmt: skip
