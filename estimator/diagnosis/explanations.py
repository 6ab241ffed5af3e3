"""The explanations of one window, weighed on the same rows.

A healthy valve is tried as it is, with an oscillation from outside, and with a gain that changes
with OP or PV (see `estimator.diagnosis.rivals`); a sticky valve as the estimator found it. Each
explanation is the estimator's own likelihood on its own rows, so that all compare in nats.

Once no valve sticks, rows in which the load jumps (innovations far outside) are left out, for every
explanation alike: one jump outweighs hundreds of rows that show the process.

This module, `rivals`, `valve_evidence`, `long_noise` and `plausible` are the only ones of the
diagnosis that know the estimator's hypotheses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from estimator.arrays import Array
from estimator.controller.controller import Controller
from estimator.criteria.conversion import process_model
from estimator.diagnosis import rivals
from estimator.diagnosis.advice_settings import Advising
from estimator.diagnosis.long_noise import under_long_noise
from estimator.diagnosis.plausible import FittedWindow
from estimator.diagnosis.pv_curves import PvCurve
from estimator.diagnosis.rivals import Rival, without_best
from estimator.diagnosis.settings import DIAGNOSIS, Weighing
from estimator.diagnosis.valve_evidence import judge_valve
from estimator.evidence.piecewise_loads import fit_piecewise_loads
from estimator.evidence.records import informed_share
from estimator.evidence.sign import gain_sign, soonest_answer
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.linear_fit import LinearFit, fit_linear
from estimator.outcomes import Reason
from estimator.rows import rows_of
from estimator.search.processes import polish, settle
from estimator.settings import SETTINGS, Settings
from estimator.window import Window, harmonise, screen
from loop_model import ProcessModel

__all__ = ["Explained", "explain"]


@dataclass(frozen=True, slots=True)
class OutsideWave:
    """A wave from outside beside a sticky valve: ``period_s``, ``evidence`` for it in nats."""

    period_s: float
    evidence: float


@dataclass(frozen=True, slots=True)
class Explained:
    """What the explanations of a window come to; evidence in nats, prices paid.

    Attributes:
        reasons: why the window cannot be explained at all; everything else is then empty.
        sticking: log Bayes factor of a sticky valve over the best other explanation.
        outside: of an oscillation from outside over none.
        curved: of a gain that changes with the operating point over one that does not.
        process: of the process over a PV that does not follow OP.
        model: the process of the likeliest explanation, units of OP and PV; None without one.
        stem: the stem of the sticky valve in units of OP, ``(n,)``; OP where none sticks.
        bend: the gain grows by ``exp(bend * change of OP)``; 0 for a straight characteristic.
        over_pv: how the gain changes with PV, in units of PV; None where it does not.
        band, jump: S and J of the sticky valve, units of OP; 0 where none sticks.
        jumps: rows that were left out as jumps of the load.
        spread: evidence for the sticky valve without the part of the window that holds most of it
            (an eighth, or a stroke where that is longer): a valve that sticks does so at every
            stroke, a jump of the load only once.
        sticks: whether the sticky valve is the explanation.
        over_waves: by how many nats a sticky valve whose slips vary is likelier than a wave from
            outside that swings unevenly; infinite where no such wave is likelier than the valve as
            it is (`estimator.evidence.rival_waves`).
        effect: share of PV's variance that sticking makes.
        fitted: the likeliest explanation with the rows it was fitted on; None without one.
        beside_wave: the process as fitted beside a wave from outside, likely or not: what shows it
            away from the oscillation; None where no wave was tried.
        slides: whether its stem, once it moves, follows OP until OP stops or turns.
        wave: the wave from outside that comes with the sticky valve; None where none does.
    """

    reasons: tuple[Reason, ...]
    sticking: float
    outside: float
    curved: float
    process: float
    model: ProcessModel | None
    stem: Array
    bend: float
    band: float
    jump: float
    jumps: int
    spread: float = -math.inf
    effect: float = 0.0
    sticks: bool = False
    over_waves: float = math.inf
    fitted: FittedWindow | None = None
    beside_wave: ProcessModel | None = None
    wave: OutsideWave | None = None
    slides: bool = False
    over_pv: PvCurve | None = None


def explain(
    op: Array,
    pv: Array,
    sp: Array | None,
    auto: Array | None,
    period: float,
    cycles: float,
    *,
    late: int = 0,
    exact: Controller | None = None,
    valve_is_healthy: bool = False,
    settings: Settings = SETTINGS,
    weighing: Weighing = DIAGNOSIS.weighing,
    advising: Advising = DIAGNOSIS.advising,
) -> Explained:
    """Weigh the explanations of a window.

    Args:
        op, pv, sp, auto: samples, ``(n,)``, NaN where bad.
        period: seconds between samples.
        cycles: periods of the window's oscillation, NaN where nothing oscillates.
        late: samples by which PV follows OP at the least: 1 where OP is known to answer the PV
            of its own sample, which would otherwise be read as a process without dead time.
        exact: the controller where it explains OP to rounding.
        valve_is_healthy: whether the valve was judged before and none is looked for.
        settings: of the estimator.
        weighing, advising: of the diagnosis.
    """
    given = op
    if late:
        op = np.concatenate([np.full(late, op[0]), op[:-late]])
    window = harmonise(op, pv, sp, auto, period, settings.screening)
    informed = informed_share(pv)
    reasons = screen(window, informed, settings.screening)
    if reasons:
        return Explained(
            reasons, -math.inf, 0.0, 0.0, 0.0, None, np.asarray(given), 0.0, 0.0, 0.0, 0
        )
    modelling = settings.modelling
    sign = gain_sign(op, pv, sp, exact, modelling)
    soonest = 0 if late else soonest_answer(op, pv, sp, sign, modelling)
    case = Case(rows_of(window, sign, modelling, soonest=soonest), settings)
    as_recorded = None
    if late and not valve_is_healthy:
        recorded = harmonise(given, pv, sp, auto, period, settings.screening)
        as_recorded = replace(case, rows=rows_of(recorded, sign, modelling))
    valve, plain = judge_valve(
        case, cycles, weighing, advising,
        valve_is_healthy=valve_is_healthy, as_recorded=as_recorded,
    )  # fmt: skip
    outside, curved, jumps = 0.0, 0.0, 0
    swung: Rival | None = None
    wave: OutsideWave | None = None
    if valve.sticks:
        assert valve.fit is not None
        chosen = Rival(case, valve.fit)
        wave = _wave_beside(case, valve.fit, window.period)
    else:
        chosen, swung, outside, curved, jumps = _without_valve(
            case, plain, valve.waved, cycles, weighing, advising
        )
    found = chosen.fit.valve
    return Explained(
        reasons=(),
        sticking=float(valve.evidence),
        outside=float(outside),
        curved=float(curved),
        process=float(chosen.case.evidence_of_process(chosen.fit)),
        model=_model(window, chosen, late),
        stem=_stem(window, found, given) if found else np.asarray(given),
        bend=chosen.bend / window.op_span,
        band=window.op_span * found.band if found else 0.0,
        jump=window.op_span * found.jump if found else 0.0,
        slides=found is not None and found.law == "sliding",
        jumps=jumps,
        spread=valve.spread,
        effect=valve.effect,
        sticks=valve.sticks,
        over_waves=valve.over_waves,
        fitted=FittedWindow(chosen.case, window, chosen.fit, late),
        beside_wave=None if swung is None else _model(window, swung, late),
        wave=wave,
        over_pv=None
        if chosen.over_pv is None
        else chosen.over_pv.in_units(window.pv_centre, window.pv_scale),
    )


def _wave_beside(case: Case, sticky: Hypothesis, period: float) -> OutsideWave | None:
    """The wave that the sticky valve's explanation holds, if there is evidence for it."""
    waves = sticky.waves
    if not waves:
        return None
    rest = tuple(one for one in sticky.nuisances if one not in waves)
    alone = settle(case, polish(case, sticky.valve, sticky, rest, sticky.taps))
    evidence = float(sticky.likelihood - alone.likelihood)
    if evidence < case.settings.judging.threshold:
        return None
    return OutsideWave(case.rows.size / waves[0].cycles * period, evidence)


def _model(window: Window, of: Rival, late: int) -> ProcessModel:
    fit = _linear_fit(of.case, of.fit)
    model = process_model(window, of.fit.poles, of.fit.dead_time, fit, 0.0)
    return replace(model, dead_time=model.dead_time + late)


def _without_valve(
    case: Case,
    healthy: Hypothesis,
    waved: Hypothesis | None,
    cycles: float,
    weighing: Weighing,
    advising: Advising,
) -> tuple[Rival, Rival | None, float, float, int]:
    """The likeliest explanation without a sticky valve; see `ValveEvidence.waved`.

    Returns:
        It, the likeliest one with a wave from outside, the evidence for that wave and for a curved
        characteristic, and the rows left out as jumps of the load.
    """
    least = case.settings.judging.threshold
    masked, jumps = rivals.without_jumps(case, healthy, weighing)
    again = polish(masked, None, healthy, (), healthy.taps, wide=True)
    plain = Rival(masked, settle(masked, again))
    bent = max(rivals.curved(masked, plain.fit, weighing), key=lambda one: one.likelihood)
    curved = bent.likelihood - plain.likelihood
    if curved >= least:
        judging = case.settings.judging
        shown = bent.fit if bent.as_recorded is None else bent.as_recorded
        pays = 0.5 * math.log(masked.rows.count)
        spread = without_best(masked, plain, shown, judging.parts) - pays
        # a characteristic is curved all the time, a load jumps once
        curved = curved if spread >= judging.steady else spread
    if curved >= least:
        under_long = under_long_noise(bent.case, bent.fit, masked, plain.fit, advising)
        curved = min(curved, under_long - bent.price)
    if curved >= least:
        curved = min(curved, _beside_steps(bent) - _beside_steps(plain))
    base, wave = plain, _best_wave(plain, cycles, weighing, waved)
    if curved >= least:
        beside = _best_wave(bent, cycles, weighing)
        # a wave must not explain as well what the characteristic does
        if wave is not None and beside is not None:
            curved = max(bent.likelihood, beside.likelihood - bent.price) - max(
                plain.likelihood, wave.likelihood
            )
        if curved >= least:
            base, wave = bent, beside
    if wave is None:
        return base, None, -math.inf, curved, jumps
    outside = wave.likelihood - base.fit.likelihood
    chosen = replace(wave, bend=base.bend, over_pv=base.over_pv) if outside > 0.0 else base
    if outside > -least:
        # a few slow waves stand for what a short noise model lacks
        under_long = under_long_noise(wave.case, wave.fit, base.case, base.fit, advising)
        outside = min(outside, under_long - wave.price)
    return chosen, wave, outside, curved, jumps


def _beside_steps(of: Rival) -> float:
    """Likelihood of an explanation with a load of steps and lines, where one makes it likelier.

    A few steps of the load take OP to places of its own, and a curve may stand for each of them.
    """
    loads = fit_piecewise_loads(of.case, (of.fit,), -math.inf)
    return max([of.likelihood, *(one.likelihood - of.price for one in loads)])


def _best_wave(
    base: Rival, cycles: float, weighing: Weighing, waved: Hypothesis | None = None
) -> Rival | None:
    """The likeliest wave from outside, of a steady period or, ``waved``, of none."""
    found = rivals.waves(base.case, base.fit, cycles, weighing)
    if waved is not None:
        fit = base.case.fit(None, waved.poles, waved.dead_time, waved.nuisances, waved.taps)
        found.append(Rival(base.case, fit))
    return max(found, key=lambda one: one.likelihood, default=None)


def _stem(window: Window, valve: Valve, op: Array) -> Array:
    # of OP as recorded: the fit's own stem is that of OP moved by the samples that the model holds
    scaled = (np.asarray(op) - window.op_centre) / window.op_span
    return np.asarray(window.op_centre + window.op_span * valve.stem(scaled))


def _linear_fit(case: Case, of: Hypothesis) -> LinearFit:
    columns = case.columns(of.nuisances, of.stem, of.poles, of.dead_time)
    return fit_linear(case.rows, of.poles.response(of.stem), of.dead_time, columns, of.taps)
