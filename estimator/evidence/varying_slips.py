"""How likely a sticky valve is whose slips are late, early, long or short by chance.

Every law of friction is a simplification: a real stem slips a little off where the law says, and
comes to rest a little off. Where a window has many slips and little noise these small errors cost a
sticky valve more than a load of chance costs a healthy one, and the wrong one would be likelier. So
each stroke is late by a time of its own and ends off by a distance of its own, both drawn from
normal distributions (a model with random effects; Laird and Ware, 1982) whose deviations are those
that make the window likeliest. Over the strokes themselves the likelihood is integrated (Laplace's
approximation; Tierney and Kadane, 1986). Process and noise are fitted with them in turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from compiled import kernel
from estimator.algebra import (
    cholesky,
    combine,
    dot,
    filter_rows,
    local_equations,
    project_out,
)
from estimator.arrays import Array, Index
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.hypotheses.linear_fit import delay, fit_linear, left_of_pv
from estimator.hypotheses.strokes import changes_of, strokes_of, varied_stem
from estimator.processes.poles import Poles
from estimator.search.processes import refine_poles

__all__ = ["likelihood_of_varying_slips"]

_FEWEST, _MOST = 2, 160
"""Strokes of a valve that is weighed so: one tells no deviation; work grows with their cube, and of
so many turns at most a wave is looked for."""
_LATE = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
"""Deviations of a stroke's time that are tried, in samples: PV shows a tenth of one, and six or so
are half a fast cycle."""
_BAND = (0.003, 0.01, 0.03, 0.1)
"""The same as shares of S: a stick band that varies is late the more the slower OP moves."""
_LONGEST = 6.0
"""Samples by which a stroke of a varying S is late at most, as a deviation."""
_OFF = (0.0, 0.005, 0.01, 0.03, 0.1)
"""Deviations of the distance by which a stroke ends off, as shares of S."""
_OFF_AT_FIRST = 2
"""Which of those the times are tried with first."""
_RATE_OVER = 5
"""Samples over which OP's rate before a stroke is read."""
_LEAST_RATE = 1e-4
"""Least rate of OP, as a share of its span in a sample: where it stands still nothing is late."""
_FEW, _NEAR = 60, 2
"""Strokes up to which all deviations are tried every time, and how far from the last ones else: it
saves time."""
_ROUNDS, _VARIANCES, _RANKED, _HALVINGS = 6, 8, 2, 5
"""Strokes and process fitted in turn; variances in turn with one deviation, and with one that is
only ranked; lengths of a step."""
_REACHES, _STEPS, _PAYS = (0.08, 0.03), 4, 0.1
"""How far S and J are moved, as shares of S, how often each, and nats that a move must gain."""
_BOUND = 8.0
"""Samples by which a stroke is late at most."""
_SAME, _TIE = 1e-4, 1e-9
"""Change of a variance, as a share, after which it is no longer sought; nats below which two are as
likely: rounding decides nothing."""
_DONE = 0.05
"""Nats that a round must gain to be followed by another."""


@dataclass(frozen=True)
class _Way:
    """Process and noise beside which the strokes of a valve vary."""

    case: Case
    sticky: Hypothesis
    begins: Index
    ends: Index
    poles: Poles
    dead_time: int
    taps: Array

    def stem(self, strokes: Array) -> Array:
        """The stem, ``(n,)``."""
        found: Array = varied_stem(self.sticky.stem, self.begins, self.ends, strokes)
        return found

    def squares(self, strokes: Array) -> float:
        """Sum of squares of what is left of PV, whitened."""
        left = self._left(self.stem(strokes))[1]
        return float(dot(left, left))

    def linearised(self, strokes: Array) -> tuple[Array, Array, float]:
        """Normal equations of the strokes: products ``(2 m, 2 m)``, those with PV ``(2 m,)``.

        PV is what strokes where the law has them leave of it, as a line through these tells; its
        sum of squares is the last. All is whitened.
        """
        basis, left, response, columns = self._left(self.stem(strokes))
        late, rows, taps = self.dead_time, self.case.rows, np.ascontiguousarray(self.taps)
        gains = fit_linear(rows, response, late, columns, taps).gains
        slopes: Array = changes_of(self.sticky.stem, self.begins, self.ends, strokes)
        for row in slopes:
            moved = self.poles.response(row)
            row[:] = gains[0] * delay(moved, late) + gains[1] * delay(moved, late + 1)
        slopes = filter_rows(slopes, taps, rows.weight)
        left = left + project_out(combine(strokes, slopes), basis)
        return *local_equations(slopes, basis, left), dot(left, left)

    def refitted(self, strokes: Array) -> _Way:
        """Process and noise fitted to the stem with these strokes."""
        case, sticky, stem = self.case, self.sticky, self.stem(strokes)
        known = sticky.nuisances
        poles, late = refine_poles(case, stem, self.poles, self.dead_time, known, self.taps)
        fitted = case.fit(sticky.valve, poles, late, known, self.taps, stem=stem)
        return replace(self, poles=poles, dead_time=late, taps=fitted.taps)

    def _left(self, stem: Array) -> tuple[Array, Array, Array, Array]:
        """Basis of process and columns, what it leaves of PV, both whitened; response, columns."""
        columns = self.case.columns(self.sticky.nuisances, stem, self.poles, self.dead_time)
        response, taps = self.poles.response(stem), np.ascontiguousarray(self.taps)
        basis, left = left_of_pv(self.case.rows, response, self.dead_time, columns, taps)
        return basis, left, response, columns


@dataclass(frozen=True, slots=True)
class _Varied:
    """A valve, how likely it is with strokes that vary, and which deviations they have."""

    sticky: Hypothesis
    likelihood: float
    deviations: tuple[int, int]


def likelihood_of_varying_slips(case: Case, laws: Sequence[Hypothesis]) -> float:
    """Log-likelihood in nats, prices included, of a sticky valve whose strokes vary.

    The law is the likeliest of those given; S and J are fitted anew with strokes that vary. At
    least as likely as without: a deviation of zero is among those that are tried.
    """
    best = max((_varied(case, one) for one in laws), key=lambda one: one.likelihood)
    for reach in _REACHES:
        for _ in range(_STEPS):
            others = _beside(case, best.sticky, reach)
            tried = (_varied(case, one, best.deviations) for one in others)
            found = max(tried, key=lambda one: one.likelihood, default=best)
            if found.likelihood < best.likelihood + _PAYS:
                break
            best = found
    return best.likelihood


def _beside(case: Case, sticky: Hypothesis, reach: float) -> Iterator[Hypothesis]:
    """The valve with S, J or both a little wider and narrower, process and noise as they are."""
    valve = sticky.valve
    assert valve is not None
    for way in (-reach, reach):
        for band, jump in ((way, 0.0), (0.0, 2.0 * way), (way, way)):
            wide = valve.band * (1.0 + band)
            other = replace(
                valve, band=wide, jump=min(max(valve.jump + jump * valve.band, 0.0), wide)
            )
            stem = case.stem(other)
            if case.tells(np.ascontiguousarray(stem[:, None]))[0]:
                yield case.fit(
                    other,
                    sticky.poles,
                    sticky.dead_time,
                    sticky.nuisances,
                    sticky.taps,
                    stem=stem,
                )


def _varied(case: Case, sticky: Hypothesis, near: tuple[int, int] | None = None) -> _Varied:
    """One valve whose strokes vary; their deviations are ``near`` those of another, if given."""
    begins, ends = strokes_of(sticky.stem)
    best = _Varied(sticky, sticky.likelihood, (0, _OFF_AT_FIRST))
    if sticky.valve is None or not _FEWEST <= begins.size <= _MOST:
        return best
    rows = float(case.rows.count), case.rows.floor
    late, off = _lateness(case, sticky.valve, begins), sticky.valve.band * np.array(_OFF)
    way = _Way(case, sticky, begins, ends, sticky.poles, sticky.dead_time, sticky.taps)
    strokes, at = np.zeros(2 * begins.size), near or best.deviations
    few = begins.size <= _FEW
    for turn in range(_ROUNDS):
        gram, pull, whole = way.linearised(strokes)
        reach = len(late) if few or (turn == 0 and near is None) else _NEAR
        at = _likeliest(gram, pull, whole, late, off, at, reach, rows)
        variances = _variances(late[at[0]], off[at[1]])
        aim, variance, _ = _shrunk(gram, pull, whole, variances, rows, _VARIANCES)
        strokes = _stepped(way, np.where(variances > 0.0, strokes, 0.0), aim, variances, variance)
        squares = way.squares(strokes) + variance * _away(strokes, variances)
        variance = squares / rows[0] + rows[1]
        root = cholesky(_told(_scaled(gram, np.sqrt(variances)), variance))
        found = _worth(root, variances, variance, rows[0])
        found -= case.price(way.poles, sticky.nuisances, way.taps, valve=True)
        if turn > 1 and found < best.likelihood + _DONE:
            break
        if found > best.likelihood:
            best = _Varied(sticky, found, at)
        way = way.refitted(strokes)
    return best


def _stepped(way: _Way, start: Array, aim: Array, variances: Array, variance: float) -> Array:
    """Numbers on the way from a start to an aim that are likelier than the start; it, if none."""

    def cost(strokes: Array) -> float:
        return way.squares(strokes) / variance + _away(strokes, variances)

    m = start.size // 2
    before, length = cost(start), 1.0
    for _ in range(_HALVINGS):
        tried = start + length * (aim - start)
        tried[:m] = np.clip(tried[:m], -_BOUND, _BOUND)
        if cost(tried) <= before:
            return tried
        length *= 0.5
    return start


def _lateness(case: Case, valve: Valve, begins: Index) -> Array:
    """Deviations of the strokes' times that are tried, in samples, ``(t, m)``."""
    before = np.maximum(begins - 1, 0)
    moved = case.rows.u[before] - case.rows.u[np.maximum(before - _RATE_OVER, 0)]
    rate = np.maximum(np.abs(moved) / _RATE_OVER, _LEAST_RATE)
    alike = [np.full(begins.size, late) for late in _LATE]
    varied = [np.minimum(share * valve.band / rate, _LONGEST) for share in _BAND]
    return np.array(alike + varied)


@kernel
def _likeliest(
    gram: Array,
    pull: Array,
    whole: float,
    late: Array,
    off: Array,
    at: tuple[int, int],
    reach: int,
    rows: tuple[float, float],
) -> tuple[int, int]:
    """Which deviations of times and of ends make the window likeliest.

    Args:
        gram, pull: products of the slopes with each other and with what is left of PV.
        whole: sum of squares of that.
        late: deviations of the times that are tried, ``(t, m)``.
        off: the same of the ends, ``(e,)``.
        at: which of both to begin with.
        reach: how far from those to try.
        rows: number of judged rows and least variance.
    """
    first, second = at
    best = -np.inf
    for _ in range(2):
        before = second
        for i in range(max(first - reach, 0), min(first + reach + 1, late.shape[0])):
            variances = _variances(late[i], off[second])
            worth = _shrunk(gram, pull, whole, variances, rows, _RANKED)[2]
            if worth > best + _TIE:
                best, at = worth, (i, second)
        first = at[0]
        for e in range(max(second - reach, 0), min(second + reach + 1, off.size)):
            variances = _variances(late[first], off[e])
            worth = _shrunk(gram, pull, whole, variances, rows, _RANKED)[2]
            if worth > best + _TIE:
                best, at = worth, (first, e)
        second = at[1]
        if second == before:
            break
    return at


@kernel
def _variances(late: Array, off: float) -> Array:
    """Variances of times and ends, ``(2 m,)``."""
    out = np.full(2 * late.size, off * off)
    out[: late.size] = late * late
    return out


@kernel
def _shrunk(
    gram: Array,
    pull: Array,
    whole: float,
    variances: Array,
    rows: tuple[float, float],
    turns: int,
) -> tuple[Array, float, float]:
    """Likeliest numbers ``(2 m,)`` of a linear model, variance of what they leave, how likely."""
    count, floor = rows
    roots = np.sqrt(variances)
    scaled, small = _scaled(gram, roots), roots * pull
    found, variance, worth = np.zeros(small.size), whole / count + floor, 0.0
    for _ in range(turns):
        root = cholesky(_told(scaled, variance))
        found = _solved(root, small) / variance
        rest, before = max(whole - dot(small, found), 0.0), variance
        worth = _worth(root, variances, variance, count) + 0.5 * (count - rest / variance)
        variance = rest / count + floor
        if abs(variance - before) < _SAME * before:
            break
    return roots * found, variance, worth


@kernel
def _solved(root: Array, right: Array) -> Array:
    """Solution of a positive definite system, its lower factor known."""
    n = right.size
    x = right.copy()
    for i in range(n):
        for k in range(i):
            x[i] -= root[i, k] * x[k]
        x[i] /= root[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= root[k, i] * x[k]
        x[i] /= root[i, i]
    return x


@kernel
def _scaled(gram: Array, roots: Array) -> Array:
    """Products of the slopes with numbers of deviation one in place of the numbers."""
    out = np.empty(gram.shape)
    for i in range(roots.size):
        for j in range(roots.size):
            out[i, j] = gram[i, j] * roots[i] * roots[j]
    return out


@kernel
def _told(scaled: Array, variance: float) -> Array:
    """Precision of numbers of deviation one: what the window tells of them, and the prior."""
    out = scaled / variance
    for i in range(out.shape[0]):
        out[i, i] += 1.0
    return out


@kernel
def _worth(root: Array, variances: Array, variance: float, count: float) -> float:
    """Log-likelihood integrated over the strokes, less what their deviations cost.

    ``root`` is the factor of the strokes' precision.
    """
    found = -0.5 * count * math.log(variance)
    for i in range(root.shape[0]):
        found -= math.log(root[i, i])
    m = variances.size // 2
    free = int(variances[:m].max() > 0.0) + int(variances[m:].max() > 0.0)
    return found - 0.5 * free * math.log(count)


@kernel
def _away(strokes: Array, variances: Array) -> float:
    """Sum of squares of numbers, each over its variance."""
    total = 0.0
    for i in range(strokes.size):
        if variances[i] > 0.0:
            total += strokes[i] ** 2 / variances[i]
    return total
