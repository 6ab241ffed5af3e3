"""What a healthy valve may have beside it: a wave from outside, a curved characteristic.

A wave of a steady period is a sinusoid with harmonics; one whose phase wanders is noise with a
sharp resonance. The latter is the same fit on rows from which a resonance was whitened. Both
filters begin with 1, so that likelihoods stay comparable. A curved characteristic is an exponential
of OP in place of OP: it never turns back. A gain that changes with PV is in `pv_curves`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from estimator.algebra import filter_rows
from estimator.arrays import Array
from estimator.diagnosis.pv_curves import PvCurve, curves_of_pv
from estimator.diagnosis.settings import Weighing
from estimator.evidence.steadiness import steady_evidence
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.hypotheses.noise import WHITE
from estimator.hypotheses.nuisances import Nuisance, Sinusoid
from estimator.search.processes import polish, settle

__all__ = ["Rival", "curved", "waves", "without_best", "without_jumps"]

_FASTEST = 0.45
"""Cycles a sample up to which a sine and a cosine are not alike: at one half both are one column.
A steady wave of eight samples and of any shape has three harmonics that are seen."""


@dataclass(frozen=True, slots=True)
class Rival:
    """An explanation with the case that it was fitted in.

    Attributes:
        price: what its search costs beyond the fit's own parameters; nats.
        bend: the gain grows by e for each ``1 / bend`` of scaled OP.
        over_pv: the curve by which PV was straightened; None where it is as recorded.
        as_recorded: the fit judged by PV as recorded; None where that is the fit itself.
    """

    case: Case
    fit: Hypothesis
    price: float = 0.0
    bend: float = 0.0
    over_pv: PvCurve | None = None
    as_recorded: Hypothesis | None = None

    @property
    def likelihood(self) -> float:
        """Of the fit, less what its search costs beyond the fit's own parameters; nats."""
        return self.fit.likelihood - self.price


def without_best(case: Case, rival: Rival, one: Hypothesis, parts: int) -> float:
    """Log Bayes factor over a rival without that of ``parts`` that shows it best, in nats."""
    judging = replace(case.settings.judging, parts=parts)
    parted = replace(case, settings=replace(case.settings, judging=judging))
    return steady_evidence(parted, rival.fit, one) + rival.price


def without_jumps(case: Case, of: Hypothesis, weighing: Weighing) -> tuple[Case, int]:
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


def waves(case: Case, plain: Hypothesis, cycles: float, weighing: Weighing) -> list[Rival]:
    """The healthy valve with an oscillation of the window's period from outside."""
    found: list[Rival] = []
    if not math.isfinite(cycles):
        return found
    n = case.rows.size
    # harmonics that are too fast to be seen are left out, the others tell the shape
    seen = [tuple(h for h in of if h * cycles <= _FASTEST * n) for of in weighing.harmonics]
    for harmonics in dict.fromkeys(one for one in seen if one):
        wave = Sinusoid(_sharpest(case.rows.y, cycles, harmonics), harmonics)
        nuisances: tuple[Nuisance, ...] = (wave,)
        for taps in (WHITE, plain.taps):
            found.append(Rival(case, polish(case, None, plain, nuisances, taps, wide=True)))
        # one peak: the whitening of several takes too much of what lies between them
        for sharpness, width in weighing.resonances if len(harmonics) == 1 else ():
            filtered = _resonant_rows(case, wave.cycles, harmonics, sharpness, width)
            # a frequency, a sharpness and a size; the start is two numbers more
            price = 0.5 * (3.0 + 2.0 * len(harmonics)) * math.log(case.rows.count)
            for taps in (WHITE, plain.taps):
                fit = polish(filtered, None, plain, (), taps, wide=True)
                found.append(Rival(filtered, fit, price))
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
    weighted = np.zeros((-(-n // _BLOCK), _BLOCK))
    weighted.flat[:n] = np.hanning(n) * (y - y.mean())
    reach = 0.08 * cycles + 0.5
    tried = np.maximum(1.0, np.linspace(cycles - reach, cycles + reach, 33))
    turn = -2j * math.pi / n * np.outer(harmonics, tried)[..., None]
    # a turn is that to the block of samples times that within it
    within, to_block = np.exp(turn * np.arange(_BLOCK)), np.exp(turn * np.arange(0, n, _BLOCK))
    lines = np.sum(to_block @ weighted * within, axis=-1)
    return float(tried[int(np.argmax(np.sum(np.abs(lines) ** 2, axis=0)))])


_BLOCK = 32
"""Samples of a block: about the root of a window's, so that few waves are computed."""


def _resonant_rows(
    case: Case, cycles: float, harmonics: tuple[int, ...], sharpness: float, width: float
) -> Case:
    """Filter narrow resonances out of the rows, so that noise with these peaks becomes white.

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
        return np.asarray(scipy.signal.lfilter(zeros, poles, x - x[0]))

    shared = np.stack([rows.shared[0], *(whiten(row) for row in rows.shared[1:]), *memory])
    return replace(case, rows=replace(rows, u=whiten(rows.u), y=whiten(rows.y), shared=shared))


def curved(case: Case, plain: Hypothesis, weighing: Weighing) -> list[Rival]:
    """The healthy valve with a gain that changes with OP or with PV."""
    of_pv = [
        Rival(one.case, one.fit, one.price, over_pv=one.curve, as_recorded=one.own)
        for one in curves_of_pv(case, plain, weighing)
    ]
    return [*_curved_over_op(case, plain, weighing), *of_pv]


def _curved_over_op(case: Case, plain: Hypothesis, weighing: Weighing) -> list[Rival]:
    """Exponential characteristics."""
    found = []
    price = 0.5 * math.log(case.rows.count)
    best = -math.inf
    for side in (1.0, -1.0):
        for size in weighing.bends:
            bend = side * size
            u = np.expm1(bend * case.rows.u) / bend
            bent = replace(case, rows=replace(case.rows, u=u))
            # the straight process of a curved one is far from its own
            fit = polish(bent, None, plain, (), plain.taps, passes=2, wide=True)
            if fit.likelihood > best:
                best = fit.likelihood
                found.append(Rival(bent, fit, price, bend))
    if not found:
        return []
    last = found[-1]
    sharp = polish(last.case, None, last.fit, (), last.fit.taps, wide=True)
    return [last, replace(last, fit=sharp)]
