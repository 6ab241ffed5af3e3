"""The posterior of the valve: samples with weights, from which every interval and sentence comes.

The likelihood over S, J and the first position is sampled under every law that explains the window
nearly as well as the best one (adaptive importance sampling: Cornuet, Marin, Mira and Robert,
Adaptive multiple importance sampling, Scand. J. Statist. 39, 2012). The process is free: gain and
columns are solved for every sample, dead time is at its best, and poles may move to first order.

Where each stroke is one slip, J trades against the gain from 0 to S in cells that no local sampler
crosses: two rounds look along that valley.

And the law that fits best may not be the valve's: pressure that follows OP late, bristles, friction
that hangs on speed move S by tens of per cent, either way. That is one of two cases, not a wider
spread of one: where the law holds, S is sharp. How far it is ahead of the other laws says how
probable the other case is, and so does what PV leaves of it after the stem's turns, beside what it
leaves elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from compiled import kernel
from estimator.algebra import cholesky, dot, filter_rows
from estimator.arrays import Array
from estimator.hypotheses.gain import pole_derivatives
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.processes.poles import coefficients
from estimator.result import Interval
from estimator.search.descent import moved_valves, turned_points
from estimator.settings import Spreading
from estimator.valves.laws import BETWEEN, LAWS

__all__ = ["EXACT", "Gap", "Peak", "Posterior", "gap_of_no_law", "sample_posterior"]

_IMPOSSIBLE = 1e6
"""Nats by which a stem that does not work like a valve is behind."""
_NOTHING = 1e-9
"""Weight of a sample, as a share of the heaviest one's, below which it moves no interval."""
_STILL = 1e-9
"""Moves of the stem (shares of OP's span), and of J over S beyond its bounds, that are rounding."""
_ALIKE = 0.05
"""Stems that differ by less, as a share of S, are those of one law."""
_PARTS = ndtri((np.arange(19) + 0.5) / 19.0)
"""Equal parts of a normal distribution; the outermost ones are beyond the ends of 90 %."""
_SLICES = 500
"""Slices of a distribution of samples, each of which stands for its samples: ends of an interval
move by less than a fiftieth of what lies beyond them."""
_VALLEY = (1, 2)
"""Rounds that look along the valley of J."""
_ALL_JUMPS, _OTHER_START = 0.4, 0.02
"""Standard deviations there, over S: of J, so that all from 0 to S are tried, and of the first
position beside what keeps the first slip where it is."""
_AFTER_TURN = 4
"""Samples after a turn of the stem that say whether it turned there and as far."""
_MOST_UNEVEN = 8.0
"""Beyond, the errors follow the turns, and how much says nothing more."""


@dataclass(frozen=True, slots=True)
class Peak:
    """One valve that explains the window, with its share of the probability."""

    band: float
    jump: float
    share: float


@dataclass(frozen=True, slots=True)
class Gap:
    """How far a valve may lie from what a law says of it, and how probable that is.

    Attributes:
        share: its probability; those of all gaps sum to one.
        below, above, jump: standard deviations of S downwards and upwards, and of J, as shares of
            OP's span.
    """

    share: float
    below: float
    above: float
    jump: float


EXACT = Gap(1.0, 0.0, 0.0, 0.0)
"""A valve that is what a law says."""


@dataclass(frozen=True, slots=True)
class Posterior:
    """Weighted valves ``(m, 3)`` (S, J and first position), weights ``(m,)`` that sum to one.

    Attributes:
        samples, weights: the samples, in scaled units.
        gaps: what lies between them and the valve: one of these.
    """

    samples: Array
    weights: Array
    gaps: tuple[Gap, ...] = (EXACT,)

    @property
    def valves(self) -> Array:
        """S and J of every sample, ``(m, 2)``."""
        return self.samples[:, :2]

    def interval(self, of_band: float, of_jump: float, confidence: float) -> Interval:
        """Equal-tailed interval of ``of_band S + of_jump J``, its value the median."""
        values = self.valves @ np.array([of_band, of_jump])
        values, weights = _merged(values, self.weights)
        weights = weights / _PARTS.size
        # Runs in rising order, which a stable sort only has to merge.
        spread = np.concatenate(
            [(values + part[:, None]).ravel() for part in _parts(self.gaps, of_band, of_jump)]
        )
        weight = np.concatenate([np.tile(gap.share * weights, _PARTS.size) for gap in self.gaps])
        order = np.argsort(spread, kind="stable")
        share = np.cumsum(weight[order]) - 0.5 * weight[order]
        tail = 0.5 * (1.0 - confidence)
        low, middle, high = np.interp([tail, 0.5, 1.0 - tail], share, spread[order])
        return Interval(float(middle), float(low), float(high))

    def peaks(self, apart: float = 0.05, share: float = 0.1) -> tuple[Peak, ...]:
        """Valves whose stick bands are apart, each with at least a ``share``; likeliest first."""
        alive = np.flatnonzero(self.weights > 1e-4)
        order = alive[np.argsort(self.valves[alive, 0], kind="stable")]
        band = self.valves[order, 0]
        found = []
        for part in np.split(order, 1 + np.flatnonzero(np.diff(band) > apart * band[1:])):
            mass = float(self.weights[part].sum())
            if mass >= share:
                top = part[int(self.weights[part].argmax())]
                found.append(Peak(float(self.valves[top, 0]), float(self.valves[top, 1]), mass))
        return tuple(sorted(found, key=lambda peak: -peak.share))


def _merged(values: Array, weights: Array) -> tuple[Array, Array]:
    """Values in rising order with their weights, those of one slice as the one in its middle."""
    rising = np.argsort(values, kind="stable")
    values, weights = values[rising], weights[rising]
    slices = np.floor(_SLICES * (np.cumsum(weights) - 0.5 * weights)).astype(np.int64)
    begins = np.flatnonzero(np.diff(slices, prepend=-1))
    ends = np.append(begins[1:], values.size)
    return values[(begins + ends) // 2], np.add.reduceat(weights, begins)


def _parts(gaps: tuple[Gap, ...], of_band: float, of_jump: float) -> list[Array]:
    """Equally probable errors of ``of_band S + of_jump J`` under each of the gaps."""
    found = []
    for gap in gaps:
        jump = of_jump * gap.jump
        below, above = (math.hypot(of_band * band, jump) for band in (gap.below, gap.above))
        found.append(np.where(_PARTS > 0.0, above, below) * _PARTS)
    return found


def gap_of_no_law(spreading: Spreading, band: float, step: float, share: float = 1.0) -> Gap:
    """The gap where no law is the valve's, for an S of ``band`` (a share of OP's span).

    ``step`` is what OP moves in a sample. Upwards there is only what OP's travel leaves: OP that
    moved the stem both ways moved farther than S, at both ends up to a step farther than the record
    shows. And a real valve slips between two samples, anywhere: the deviation of a uniform
    distribution.
    """
    _, down, up = spreading.law
    room = min(1.0, max(0.0, 1.0 + 2.0 * step - band))
    late = step / math.sqrt(12.0)
    below, above = (math.hypot(late, band * wide) for wide in (down, up * room))
    return Gap(share, below, above, band * spreading.law_jump[1])


def sample_posterior(case: Case, explanations: tuple[Hypothesis, ...]) -> Posterior:
    """The posterior around the sticky hypotheses, one a law, the likeliest first."""
    spreading = case.settings.spreading
    best = explanations[0]
    assert best.valve is not None
    uneven = _unevenness(case, best)
    valves, weights = [], []
    for one in explanations:
        behind = best.likelihood - one.likelihood
        if behind > spreading.law_nats:
            continue
        found, log_weight = _sample(case, one, uneven)
        weight = np.exp(log_weight - log_weight.max())
        valves.append(found)
        # a law that is a little behind may still be that of the valve: no law is quite
        weights.append(weight / weight.sum() * math.exp(-spreading.law_temper * behind))
    weight, valve = np.concatenate(weights), np.vstack(valves)
    # most samples are there to find the others
    counts = weight > _NOTHING * weight.max()
    weight, valve = weight[counts], valve[counts]
    # a lead is worth less where the leading law's own errors follow the turns
    doubt = math.exp(-_lead_of_law(explanations) / (spreading.lead * uneven**2))
    band = best.valve.band
    known, known_jump = band * spreading.law[0], band * spreading.law_jump[0]
    gaps = (
        Gap(1.0 - doubt, known, known, known_jump),
        gap_of_no_law(spreading, band, _usual_step(case.rows.u), doubt),
    )
    return Posterior(valve, weight / weight.sum(), gaps)


def _unevenness(case: Case, of: Hypothesis) -> float:
    """Mean square of the innovations after the stem's turns over that elsewhere, at least 1.

    A law that turns the stem at other samples or as far otherwise than the valve leaves more of PV
    after its turns; noise does not know of them.
    """
    rows = case.rows
    steps = np.sign(np.where(np.abs(np.diff(of.stem)) > _STILL, np.diff(of.stem), 0.0))
    moves = np.flatnonzero(steps)
    turns = moves[np.diff(steps[moves], prepend=0.0) != 0.0] + 1 + of.dead_time
    after = np.zeros(rows.size)
    for late in range(_AFTER_TURN):
        after[np.minimum(turns + late, rows.size - 1)] = 1.0
    after, elsewhere = after * rows.weight, (1.0 - after) * rows.weight
    innovations = filter_rows(of.residual[None], of.taps, rows.weight)[0]
    squares = np.square(innovations)
    count, others = float(after.sum()), float(elsewhere.sum())
    quiet = float(dot(squares, elsewhere))
    if count == 0.0 or others == 0.0 or quiet == 0.0:
        return 1.0
    ratio = float(dot(squares, after)) / count / (quiet / others)
    return min(max(ratio, 1.0), _MOST_UNEVEN)


def _lead_of_law(explanations: tuple[Hypothesis, ...]) -> float:
    """Nats by which the likeliest law is ahead of the next one; 0 where only one was tried.

    Laws that move the stem alike are one: ``he`` and ``steps`` where no sample asks for two slips.
    A law of what happens between two samples is ahead of others of samples only: 0.
    """
    best = explanations[0]
    assert best.valve is not None
    if best.valve.law in BETWEEN:
        return 0.0
    others = [
        one.likelihood
        for one in explanations
        if one.valve is not None
        and one.valve.law != best.valve.law
        and float(np.abs(one.stem - best.stem).max()) > _ALIKE * best.valve.band
    ]
    return best.likelihood - max(others) if others else 0.0


def _usual_step(op: Array) -> float:
    steps = np.abs(np.diff(op))
    moving = steps[steps > 0.0]
    return float(np.median(moving)) if moving.size else 0.0


def _sample(case: Case, of: Hypothesis, uneven: float) -> tuple[Array, Array]:
    """Valves and log weights of one law's samples."""
    spreading = case.settings.spreading
    valve = of.valve
    assert valve is not None
    columns = np.vstack(
        [
            case.columns(of.nuisances, of.stem, of.poles, of.dead_time),
            pole_derivatives(of),
        ]
    )
    design = case.design_of(columns, of.taps)
    row = np.array([[of.poles.slow, of.poles.fast, of.poles.third]])
    process = np.repeat(coefficients(of.poles.shape, row), spreading.lanes, axis=1)
    shortest = max(case.rows.soonest, of.dead_time - 1)
    count = min(3, case.max_dead_time + 1 - shortest)
    centre = np.array([valve.band, valve.jump, valve.start])
    # A sample that a historian drew says nothing of its own; and valves differ in the samples after
    # their turns, whose errors are larger than the noise model says.
    temper = spreading.temper * case.rows.informed / uneven
    middle, root = np.zeros(3), np.diag(np.array(spreading.reach))
    tables, likelihoods, proposals = [], [], []
    for turn in range(spreading.rounds):
        points = turned_points(spreading.lanes, 3, turn)
        table = middle + points @ root.T
        if turn == 0:
            table[0] = 0.0
        stems = LAWS[valve.law](case.rows.u, moved_valves(centre, table))
        costs = design.paired(stems, process, shortest, count).min(axis=0)
        tables.append(table)
        likelihood = -temper * case.worth(costs)
        # never minus infinity for all: the valve itself is among them
        jumps = valve.jump / valve.band + table[:, 1]
        possible = case.tells(stems) & (jumps > -_STILL) & (jumps < 1.0 + _STILL)
        likelihoods.append(np.where(possible, likelihood, likelihood - _IMPOSSIBLE))
        proposals.append((middle, root))
        every = np.vstack(tables)
        log_like = np.concatenate(likelihoods)
        middles, roots = (np.stack(part) for part in zip(*proposals, strict=True))
        log_weight = log_like - _log_mixture(every, middles, roots)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        middle = weight @ every
        apart = every - middle
        spread = (apart * weight[:, None]).T @ apart
        # wider than what was found: a proposal that is too narrow never finds out
        covariance = spreading.wider**2 * spread + np.diag(
            np.square(spreading.narrowest * np.ones(3))
        )
        if turn + 1 in _VALLEY:
            middle, root = _along_valley(of, middle, math.sqrt(covariance[0, 0]))
        else:
            root = cholesky(covariance)
    valves = moved_valves(centre, every)
    return valves, log_weight


def _along_valley(of: Hypothesis, middle: Array, reach: float) -> tuple[Array, Array]:
    """Mean and root of a proposal with all slip jumps from 0 to S, the first slip where it is.

    The stick band stays near its ``middle``, within a ``reach``. With J the static friction grows
    by half of it, and the first position moves against the first slip.
    """
    assert of.valve is not None
    moves = np.diff(of.stem)
    moves = moves[np.abs(moves) > _STILL]
    side = -0.5 * float(np.sign(moves[0])) if moves.size else 0.0
    jump = 0.5 - of.valve.jump / of.valve.band
    centre = np.array([middle[0], jump, middle[2] + side * (jump - middle[1])])
    root = np.diag([reach, _ALL_JUMPS, _OTHER_START])
    root[2, 1] = side * _ALL_JUMPS
    return centre, root


@kernel
def _log_mixture(points: Array, middles: Array, roots: Array) -> Array:
    """Log density (up to a constant) of an equal mixture of normal distributions, ``(m,)``.

    At points ``(m, w)``; of means ``(p, w)`` and lower factors ``(p, w, w)`` of covariances.
    """
    m, wide = points.shape
    count = middles.shape[0]
    out = np.empty(m)
    logs, scaled = np.empty(count), np.empty(wide)
    for k in range(m):
        for p in range(count):
            total = 0.0
            for i in range(wide):
                left = points[k, i] - middles[p, i]
                for c in range(i):
                    left -= roots[p, i, c] * scaled[c]
                scaled[i] = left / roots[p, i, i]
                total -= 0.5 * scaled[i] * scaled[i] + math.log(roots[p, i, i])
            logs[p] = total
        top = logs.max()
        out[k] = top + math.log(np.exp(logs - top).sum() / count)
    return out
