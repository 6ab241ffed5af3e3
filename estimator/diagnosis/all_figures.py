"""Every figure of a diagnosed loop: those of the record, and those that need the explanations."""

from __future__ import annotations

import math
from collections.abc import Mapping

from estimator.diagnosis.explanations import Explained
from estimator.diagnosis.figures import figures_of
from estimator.diagnosis.gathered import Gathered
from estimator.diagnosis.linear_loop import LinearLoop
from estimator.diagnosis.loop_record import LoopRecord
from estimator.diagnosis.nonlinearity import largest_bicoherence
from estimator.diagnosis.oscillation import Oscillation
from estimator.diagnosis.settings import DiagnosisSettings
from estimator.diagnosis.tuning import Advice

__all__ = ["all_figures", "bicoherence_of"]


def all_figures(
    record: LoopRecord, found: Gathered, proposal: Advice | None, settings: DiagnosisSettings
) -> Mapping[str, float]:
    """Return the indices of a loop by name; NaN where one cannot be told."""
    explained, dead = found.explained, None
    if explained is not None and explained.model is not None:
        dead = max(1, round(explained.model.dead_time * explained.model.period / record.period))
    indices = figures_of(
        record.op, record.pv, record.error, record.sp, record.auto, record.period, dead,
        found.swing, found.limits, found.sensor,
    )  # fmt: skip
    indices |= _shares(explained, found.loop, proposal)
    indices["bicoherence"] = bicoherence_of(record, found.swing, found.signal, settings)
    indices["amplification_at_period"] = found.amplification()[0]
    indices["amplification_beside_wave"] = found.amplification_beside_wave()
    return indices


def bicoherence_of(
    record: LoopRecord, swing: Oscillation, signal: str, settings: DiagnosisSettings
) -> float:
    """Return the largest bicoherence of the signal that swings; NaN where nothing does."""
    values = {"error": record.error, "pv": record.pv, "op": record.op}[signal]
    if values is None or not swing.present:
        return math.nan
    return largest_bicoherence(values, swing.period_s / record.period, settings.bispectrum)


def _shares(
    explained: Explained | None, loop: LinearLoop | None, proposal: Advice | None
) -> Mapping[str, float]:
    """Figures that need the explanations."""
    found = {
        "log_bayes_factor_sticky": math.nan,
        "log_bayes_factor_outside": math.nan,
        "log_bayes_factor_curved": math.nan,
        "log_bayes_factor_over_uneven_wave": math.nan,
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
        if explained.sticks and math.isfinite(explained.over_waves):
            found["log_bayes_factor_over_uneven_wave"] = explained.over_waves
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
