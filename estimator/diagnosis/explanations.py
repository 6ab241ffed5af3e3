"""The explanations of one window, weighed on the same rows.

A healthy valve is tried as it is, with an oscillation from outside, and with a curved
characteristic; a sticky valve as the estimator found it. Each explanation is the estimator's own
likelihood on its own rows, so that all of them compare in nats:

* a wave from outside of a steady period is a sinusoid with harmonics; one whose phase wanders is
  noise with a sharp resonance. The latter is the same fit on rows from which a resonance was
  whitened. Both filters begin with 1, so that likelihoods stay comparable;
* a curved characteristic is an exponential of OP in place of OP: it never turns back;
* once no valve sticks, rows in which the load jumps (innovations far outside) are left out, for
  every explanation alike: one jump outweighs hundreds of rows that show the process.

This is the one module of the diagnosis that knows the estimator's hypotheses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from estimator.algebra import filter_rows
from estimator.arrays import Array
from estimator.criteria.conversion import process_model
from estimator.diagnosis.settings import DIAGNOSIS, Weighing
from estimator.evidence.effect import effect_of
from estimator.evidence.records import informed_share
from estimator.evidence.sign import controller_action
from estimator.evidence.weighing import weigh
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.linear_fit import LinearFit, fit_linear
from estimator.hypotheses.noise import WHITE
from estimator.hypotheses.nuisances import Nuisance, Sinusoid
from estimator.outcomes import Reason
from estimator.rows import rows_of
from estimator.search.processes import polish, settle
from estimator.settings import SETTINGS, Settings
from estimator.window import harmonise, screen
from loop_model import ProcessModel

__all__ = ["Explained", "explain"]


@dataclass(frozen=True, slots=True)
class Explained:
    """What the explanations of a window come to; evidence in nats, prices paid.

    Attributes:
        reasons: why the window cannot be explained at all; everything else is then empty.
        sticking: log Bayes factor of a sticky valve over the best other explanation.
        outside: of an oscillation from outside over none.
        curved: of a curved characteristic over a straight one.
        process: of the process over a PV that does not follow OP.
        model: the process of the likeliest explanation, units of OP and PV; None without one.
        stem: the stem of the sticky valve in units of OP, ``(n,)``; OP where none sticks.
        bend: the gain grows by ``exp(bend * change of OP)``; 0 for a straight characteristic.
        band, jump: S and J of the sticky valve, units of OP; 0 where none sticks.
        jumps: rows that were left out as jumps of the load.
        spread: evidence for the sticky valve without the eighths of the window that hold most of
            it: a valve that sticks does so at every stroke, a jump of the load only once.
        effect: share of PV's variance that sticking makes.
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


@dataclass(frozen=True, slots=True)
class _Rival:
    """An explanation with the case that it was fitted in."""

    case: Case
    fit: Hypothesis
    price: float = 0.0
    bend: float = 0.0

    @property
    def likelihood(self) -> float:
        return self.fit.likelihood - self.price


def explain(
    op: Array,
    pv: Array,
    sp: Array | None,
    auto: Array | None,
    period: float,
    cycles: float,
    *,
    late: int = 0,
    settings: Settings = SETTINGS,
    weighing: Weighing = DIAGNOSIS.weighing,
) -> Explained:
    """Weigh the explanations of a window.

    Args:
        op, pv, sp, auto: samples, ``(n,)``, NaN where bad.
        period: seconds between samples.
        cycles: periods of the window's oscillation, NaN where nothing oscillates.
        late: samples by which PV follows OP at the least: 1 where OP is known to answer the PV
            of its own sample, which would otherwise be read as a process without dead time.
        settings: of the estimator.
        weighing: of the diagnosis.
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
    action = controller_action(op, pv, sp)
    modelling = settings.modelling
    sign = math.copysign(1.0, action) if abs(action) > modelling.action_t else 0.0
    case = Case(rows_of(window, sign, modelling), settings)
    found = weigh(case)
    plain = _Rival(case, _without_waves(case, found.healthy))
    rivals = [plain, _Rival(case, found.healthy)]
    sticky, evidence = found.sticky, found.evidence
    least = settings.judging.threshold
    if sticky is not None and evidence >= least:
        rivals += _outside(case, plain.fit, cycles, weighing)
        rivals += _curved(case, plain.fit, weighing)
        evidence = sticky.likelihood - max(one.likelihood for one in rivals)
    spread, effect = -math.inf, 0.0
    if sticky is not None and evidence >= least:
        rival = max(rivals, key=lambda one: one.likelihood)
        spread = _spread(case, sticky, rival, evidence, weighing)
        effect = effect_of(case, sticky)
    if sticky is not None and min(evidence, spread) >= least:
        outside, curved, jumps = 0.0, 0.0, 0
        chosen = _Rival(case, sticky)
    else:
        masked, jumps = _without_jumps(case, plain.fit, weighing)
        again = polish(masked, None, plain.fit, (), plain.fit.taps, wide=True)
        plain = _Rival(masked, settle(masked, again))
        bends = [
            replace(one, price=one.price + _concentration(masked, one, plain, weighing))
            for one in _curved(masked, plain.fit, weighing)
        ]
        bent = max(bends, key=lambda one: one.likelihood)
        curved = bent.likelihood - plain.likelihood
        # what the characteristic explains needs no wave
        base = bent if curved >= least else plain
        waves = _outside(base.case, base.fit, cycles, weighing)
        wave = max(waves, key=lambda one: one.likelihood, default=base)
        outside = wave.likelihood - base.fit.likelihood if waves else -math.inf
        chosen = replace(wave, bend=base.bend) if outside > 0.0 else base
    bend = chosen.bend / window.op_span
    fit = _linear_fit(chosen.case, chosen.fit)
    sticks = sticky if chosen.fit.valve is not None else None
    return Explained(
        reasons=(),
        sticking=float(evidence),
        outside=float(outside),
        curved=float(curved),
        process=float(chosen.case.evidence_of_process(chosen.fit)),
        model=_delayed(
            process_model(window, chosen.fit.poles, chosen.fit.dead_time, fit, 0.0), late
        ),
        stem=window.op_centre + window.op_span * chosen.fit.stem if sticks else np.asarray(given),
        bend=bend,
        band=window.op_span * sticks.valve.band if sticks and sticks.valve else 0.0,
        jump=window.op_span * sticks.valve.jump if sticks and sticks.valve else 0.0,
        jumps=jumps,
        spread=spread,
        effect=effect,
    )


def _concentration(case: Case, one: _Rival, other: _Rival, weighing: Weighing) -> float:
    """Nats of an explanation's evidence that come from the best parts of the window."""
    evidence = one.likelihood - other.likelihood
    if evidence <= 0.0:
        return 0.0
    return evidence - _spread(case, one.fit, other, evidence, weighing)


def _delayed(model: ProcessModel, late: int) -> ProcessModel:
    return replace(model, dead_time=model.dead_time + late)


def _spread(
    case: Case, sticky: Hypothesis, rival: _Rival, evidence: float, weighing: Weighing
) -> float:
    """The evidence less that of the parts of the window that hold most of it."""
    rows = case.rows
    sizes = []
    for one, weight in ((rival.fit, rival.case.rows.weight), (sticky, rows.weight)):
        e = filter_rows(one.residual[None], one.taps, weight)[0]
        sizes.append(0.5 * e * e * rows.count / max(one.squares, 1e-300))
    parts = np.array_split(sizes[0] - sizes[1], weighing.parts)
    gains = sorted((float(part.sum()) for part in parts), reverse=True)
    share = sum(gains[: weighing.best_parts])
    # the levels of the two fits differ by a constant per row, which the evidence holds
    rest = evidence - sum(gains)
    kept = 1.0 - weighing.best_parts / weighing.parts
    return evidence - share - rest * (1.0 - kept)


def _linear_fit(case: Case, of: Hypothesis) -> LinearFit:
    columns = case.columns(of.nuisances, of.stem, of.poles, of.dead_time)
    return fit_linear(case.rows, of.poles.response(of.stem), of.dead_time, columns, of.taps)


def _without_waves(case: Case, healthy: Hypothesis) -> Hypothesis:
    """The likeliest healthy valve in which nothing swings from outside, nothing is curved."""
    if not healthy.nuisances:
        return healthy
    return settle(case, polish(case, None, healthy, (), healthy.taps, wide=True))


def _without_jumps(case: Case, of: Hypothesis, weighing: Weighing) -> tuple[Case, int]:
    """The case without the rows in which the load jumps."""
    rows = case.rows
    innovations = filter_rows(of.residual[None], of.taps, rows.weight)[0]
    judged = rows.weight > 0.0
    size = float(np.median(np.abs(innovations[judged]))) / 0.6745
    far = judged & (np.abs(innovations) > weighing.jump * max(size, rows.floor))
    count = int(far.sum())
    if not 0 < count <= weighing.most_jumps * int(judged.sum()):
        return case, 0
    weight = np.where(far, 0.0, rows.weight)
    return replace(case, rows=replace(rows, weight=weight, count=float(weight.sum()))), count


def _outside(case: Case, plain: Hypothesis, cycles: float, weighing: Weighing) -> list[_Rival]:
    """The healthy valve with an oscillation of the window's period from outside."""
    found: list[_Rival] = []
    if not math.isfinite(cycles):
        return found
    n = case.rows.size
    for harmonics in weighing.harmonics:
        if max(harmonics) * cycles > 0.25 * n:
            continue
        wave = Sinusoid(_sharpest(case.rows.y, cycles, harmonics), harmonics)
        nuisances: tuple[Nuisance, ...] = (wave,)
        for taps in (WHITE, plain.taps):
            found.append(_Rival(case, polish(case, None, plain, nuisances, taps, wide=True)))
        # one peak: the whitening of several takes too much of what lies between them
        for sharpness, width in weighing.resonances if len(harmonics) == 1 else ():
            filtered = _resonant_rows(case, wave.cycles, harmonics, sharpness, width)
            # a frequency, a sharpness and a size; the start is two numbers more
            price = 0.5 * (3.0 + 2.0 * len(harmonics)) * math.log(case.rows.count)
            for taps in (WHITE, plain.taps):
                fit = polish(filtered, None, plain, (), taps, wide=True)
                found.append(_Rival(filtered, fit, price))
    if not found:
        return found
    best = max(found, key=lambda one: one.likelihood)
    settled = settle(
        best.case, polish(best.case, None, best.fit, best.fit.nuisances, best.fit.taps)
    )
    return [best, replace(best, fit=settled)]


def _sharpest(y: Array, cycles: float, harmonics: tuple[int, ...]) -> float:
    """Cycles in the window, near the given ones, that hold most of PV."""
    n = y.size
    weighted = np.hanning(n) * (y - y.mean())
    k = np.arange(n)

    def power(c: float) -> float:
        return float(
            sum(
                abs(np.sum(weighted * np.exp(-2j * math.pi * h * c / n * k))) ** 2
                for h in harmonics
            )
        )

    reach = 0.08 * cycles + 0.5
    tried = np.maximum(1.0, np.linspace(cycles - reach, cycles + reach, 33))
    return float(tried[int(np.argmax([power(c) for c in tried]))])


def _resonant_rows(
    case: Case, cycles: float, harmonics: tuple[int, ...], sharpness: float, width: float
) -> Case:
    """The rows whitened of narrow resonances: for them noise with these peaks is white.

    Each filter has its zeros at the resonance and its poles a little inside, so that it leaves
    other frequencies alone. What it remembers from before the window is two more columns.
    """
    rows = case.rows
    zeros, poles = np.ones(1), np.ones(1)
    k = np.arange(rows.size)
    memory = []
    for h in harmonics:
        angle = 2.0 * math.pi * h * cycles / rows.size
        r, inside = math.exp(-sharpness * angle), math.exp(-(sharpness + width) * angle)
        zeros = np.convolve(zeros, [1.0, -2.0 * r * math.cos(angle), r * r])
        poles = np.convolve(poles, [1.0, -2.0 * inside * math.cos(angle), inside * inside])
        memory += [inside**k * np.cos(angle * k), inside**k * np.sin(angle * k)]

    def whiten(x: Array) -> Array:
        return np.asarray(lfilter(zeros, poles, x - x[0]))

    shared = np.stack([rows.shared[0], *(whiten(row) for row in rows.shared[1:]), *memory])
    return replace(case, rows=replace(rows, u=whiten(rows.u), y=whiten(rows.y), shared=shared))


def _curved(case: Case, plain: Hypothesis, weighing: Weighing) -> list[_Rival]:
    """The healthy valve with exponential characteristics."""
    found = []
    price = 0.5 * math.log(case.rows.count)
    best = -math.inf
    for side in (1.0, -1.0):
        for size in weighing.bends:
            bend = side * size
            u = np.expm1(bend * case.rows.u) / bend
            curved = replace(case, rows=replace(case.rows, u=u))
            fit = polish(curved, None, plain, (), plain.taps, passes=1, wide=False)
            if fit.likelihood > best:
                best = fit.likelihood
                found.append(_Rival(curved, fit, price, bend))
    if not found:
        return []
    last = found[-1]
    sharp = polish(last.case, None, last.fit, (), last.fit.taps, wide=True)
    return [last, replace(last, fit=sharp)]
