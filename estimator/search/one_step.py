"""Valves ranked by one-step errors: exhaustively, because a stem is a few slips.

Under the paper's criterion (12) the process is linear in its coefficients, so that no poles need to
be searched: PV's own past is taken out once for all valves, and each valve costs a few sums over
its slips. Stick bands are told sharply where noise is small, which is where simulation errors have
narrow valleys and a coarse grid misses them. The process has direct feed-through or more dead time
and three coefficients of the stem.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from compiled import kernel
from estimator.algebra import dot, filter_rows, orthonormal, project_out
from estimator.arrays import Array, Index
from estimator.rows import Rows
from estimator.search.descent import LEAST_BAND, WIDEST_BAND
from estimator.search.processes import spread_points
from estimator.search.slip_sums import BLOCK, add_slips, ahead_judged, slip_moments, walk

__all__ = ["OneStep", "look_around", "one_step_costs"]

_PAST = 3
"""PV's own past in the ranking, samples."""

_NEAR = 28
"""Valves that are looked at around one."""

_Six = tuple[float, float, float, float, float, float]
"""Products of three columns with each other: 00, 01, 02, 11, 12, 22."""

LATEST = 32
"""Longest dead time and coefficients of the stem, in samples, that the sums leave room for."""


@kernel
def _least(
    shared: Array,
    products: Array,
    columns: int,
    common: Array,
    rests: Array,
    sign: float,
    least: Array,
    best: Index,
) -> None:
    """Least sum of squares over the dead times, and which, of each view ``(v,)``.

    See `add_slips` for the sums, and `OneStep` for the views.
    """
    own, next_, second = products[0], products[1], products[2]
    least[:] = np.inf
    best[:] = 0
    plain = columns - common.size
    for w in range(own.size - 2):
        at0, at1, at2 = w * columns, (w + 1) * columns, (w + 2) * columns
        g01, g12 = own[w] - next_[w], own[w + 1] - next_[w + 1]
        g = own[w], g01, own[w] - second[w], own[w + 1], g12, own[w + 2]
        r0, r1, r2 = shared[at0], shared[at1], shared[at2]
        small = 1e-6 * own[w]
        for c in range(1, plain):
            a = shared[at0 + c], shared[at1 + c], shared[at2 + c]
            g = _without(g, a)
        left = rests[0] - _gain(g, (r0, r1, r2), small, sign)
        if 0.0 <= left < least[0]:
            least[0], best[0] = left, w
        if common.size == 0:
            continue
        for i in range(common.size):
            c = plain + i
            a = shared[at0 + c], shared[at1 + c], shared[at2 + c]
            g = _without(g, a)
            # what PV has in common with these columns is taken out of it
            r0 -= common[i] * a[0]
            r1 -= common[i] * a[1]
            r2 -= common[i] * a[2]
        left = rests[1] - _gain(g, (r0, r1, r2), small, sign)
        if 0.0 <= left < least[1]:
            least[1], best[1] = left, w


@kernel
def _without(g: _Six, a: tuple[float, float, float]) -> _Six:
    """Products of three columns with each other, as in `_gain`, less what is along a fourth."""
    g00, g01, g02, g11, g12, g22 = g
    return (
        g00 - a[0] * a[0],
        g01 - a[0] * a[1],
        g02 - a[0] * a[2],
        g11 - a[1] * a[1],
        g12 - a[1] * a[2],
        g22 - a[2] * a[2],
    )


@kernel
def _gain(
    g: _Six,
    r: tuple[float, float, float],
    small: float,
    sign: float,
) -> float:
    """What three columns explain of PV; minus infinity where no process of the sign does.

    ``g`` are their products with each other (00, 01, 02, 11, 12, 22), ``r`` those with PV.
    """
    g00, g01, g02, g11, g12, g22 = g
    if g00 <= small:
        return -np.inf
    l10, l20 = g01 / g00, g02 / g00
    d1 = g11 - l10 * g01
    if d1 <= small:
        return -np.inf
    l21 = (g12 - l20 * g01) / d1
    d2 = g22 - l20 * g02 - l21 * l21 * d1
    if d2 <= small:
        return -np.inf
    z0 = r[0]
    z1 = r[1] - l10 * z0
    z2 = r[2] - l20 * z0 - l21 * z1
    b2 = z2 / d2
    b1 = z1 / d1 - l21 * b2
    b0 = z0 / g00 - l10 * b1 - l20 * b2
    if sign * (b0 + b1 + b2) < 0.0:
        return -np.inf
    return z0 * z0 / g00 + z1 * z1 / d1 + z2 * z2 / d2


@kernel
def one_step_costs(
    op: Array,
    blocks: tuple[Array, Array],
    valves: Array,
    sums: Array,
    counts: Array,
    judged: Array,
    common: Array,
    rests: Array,
    shortest: Index,
    shifts: int,
    sign: float,
    reversals: int,
) -> tuple[Array, Index]:
    """Least sum of squares and its dead time for valves ``(m, 3)`` of He's law; both ``(m, v)``.

    ``blocks`` are OP's highest and lowest values of eight samples each, by which a walk skips.
    ``sums`` ``(n + p, c)`` holds, of PV (first) and the columns beside the stem, the sums from a
    row to the end; ``counts`` ``(n + p,)`` the judged rows from a row to the end, ``judged`` 1 for
    each of them. All are zero from row ``n`` on, for the longest dead time. The last columns are
    those of a second view, ``common`` what PV has in common with each; ``rests`` ``(v,)`` are what
    PV and the columns of a view leave without a stem. ``shifts`` dead times are tried from each
    valve's ``shortest`` on, ``(m,)``. Valves of one S, J and dead time that follow each other cost
    little more than one of them.
    """
    n, m, columns, views = op.size, valves.shape[0], sums.shape[1], rests.size
    cost, best = np.full((m, views), np.inf), np.empty((m, views), np.int64)
    for v in range(m):
        best[v] = shortest[v]
    later = np.empty(views, np.int64)
    wide = shifts + 2
    plain = ahead_judged(judged, wide)
    flat = sums.ravel()
    shared, products = np.empty(wide * columns), np.empty((3, wide))
    at, level, turns = np.empty(n + 2, np.int64), np.empty(n + 3), np.empty(n + 2, np.int64)
    moments = np.empty((5, n + 2))
    # the valve of the same S and J whose sums are known
    known_at, known_level, known_turns = at.copy(), level.copy(), turns.copy()
    known_moments, known_shared, known_products = moments.copy(), shared.copy(), products.copy()
    known = 0
    # whether that valve slips too often, and is known no further
    busy = False
    most = n // 3
    for v in range(m):
        if v == 0 or not _share_sums(valves, shortest, v):
            known, busy = 0, False
            late = shortest[v]
            tables = (flat[late * columns :], counts[late:], judged[late:], plain[late:])
        slips, same = walk(
            op,
            blocks,
            valves[v],
            (known_at[:known], known_level, known_turns),
            most + BLOCK,
            at,
            level,
            turns,
        )
        behind = known - same - 1 if same >= 0 else 0
        if busy and same >= 0 and slips + behind <= most:
            nothing = known_at[:0], known_level, known_turns
            slips, same = walk(op, blocks, valves[v], nothing, most + BLOCK, at, level, turns)
            behind = 0
        if slips + behind > most:
            if known == 0:
                known, busy = slips, True
                known_at, at = at, known_at
                known_level, level = level, known_level
                known_turns, turns = turns, known_turns
            continue
        turned = turns[slips - 1] if slips > 0 else 0
        if behind > 0:
            turned += known_turns[known - 1] - known_turns[same]
        if turned < reversals:
            continue
        if same < 0:
            slip_moments(at, level, slips, moments)
            for w in range(wide):
                for c in range(columns):
                    shared[w * columns + c] = level[0] * sums[0, c]
            products[0], products[1:] = level[0] * level[0] * counts[0], 0.0
            add_slips(at, moments, slips, 1.0, tables, columns, shared, products)
            known, busy = slips, False
            known_at, at = at, known_at
            known_level, level = level, known_level
            known_turns, turns = turns, known_turns
            known_moments, moments = moments, known_moments
            known_shared[:], known_products[:] = shared, products
        else:
            # from the second slip behind the shared one on both add the same
            more = min(2, behind)
            for i in range(more):
                at[slips + i] = known_at[same + 1 + i]
                level[slips + i + 1] = known_level[same + 2 + i]
            slip_moments(at, level, slips + more, moments)
            moved = level[0] - known_level[0]
            for w in range(wide):
                for c in range(columns):
                    place = w * columns + c
                    shared[place] = known_shared[place] + moved * sums[0, c]
            gained = level[0] * level[0] - known_level[0] * known_level[0]
            products[:] = known_products
            products[0] += gained * counts[0]
            beside = min(1, behind)
            add_slips(
                known_at, known_moments, same + 1 + beside, -1.0, tables, columns, shared, products
            )
            add_slips(at, moments, slips + beside, 1.0, tables, columns, shared, products)
        _least(shared, products, columns, common, rests, sign, cost[v], later)
        best[v] += later
    return cost, best


@kernel
def _share_sums(valves: Array, shortest: Index, v: int) -> bool:
    """Whether a valve has the S, J and shortest dead time of the one before."""
    return bool(
        valves[v, 0] == valves[v - 1, 0]
        and valves[v, 1] == valves[v - 1, 1]
        and shortest[v] == shortest[v - 1]
    )


class OneStep:
    """PV and its past made ready for the ranking, in one view or two.

    Args:
        rows: the window.
        columns: those beside the stem, ``(m, n)``.
        past: samples of PV's own past.
        more: columns of a second view, in which they are beside the stem too, ``(k, n)``.
    """

    def __init__(
        self, rows: Rows, columns: Array, past: int = _PAST, more: Array | None = None
    ) -> None:
        n = rows.size
        shifted = np.zeros((past, n))
        for i in range(past):
            shifted[i, i + 1 :] = rows.y[: n - i - 1]
        none = np.zeros(0)
        basis = orthonormal(filter_rows(np.vstack([shifted, columns]), none, rows.weight))
        target = project_out(rows.y * rows.weight, basis)
        extra = basis[:0]
        if more is not None:
            both = np.vstack([basis, filter_rows(more, none, rows.weight)])
            extra = orthonormal(both)[len(basis) :]
        # the target is orthogonal to the basis: its products with a stem need nothing taken out
        signals = np.vstack([target[None], basis, extra])
        tail = np.cumsum(signals[:, ::-1], axis=1)[:, ::-1]
        beyond = LATEST + 1
        self.sums = np.ascontiguousarray(np.vstack([tail.T, np.zeros((beyond, len(signals)))]))
        self.counts = np.append(np.cumsum(rows.weight[::-1])[::-1], np.zeros(beyond))
        self.judged = np.append(rows.weight, np.zeros(beyond))
        self.common = np.array([dot(row, target) for row in extra])
        rest = dot(target, target)
        left = [rest] if more is None else [rest, rest - dot(self.common, self.common)]
        self.rests = np.array(left)
        self.rows = rows
        blocks = -(-n // BLOCK)
        padded = np.concatenate([rows.u, np.full(blocks * BLOCK - n, rows.u[-1])])
        padded = padded.reshape(blocks, BLOCK)
        self.blocks = padded.max(axis=1), padded.min(axis=1)

    def of_view(self, view: int) -> OneStep:
        """The same with one of its views alone."""
        alone = copy(self)
        alone.common, alone.rests = self.common[:0], self.rests[view : view + 1]
        plain = self.sums.shape[1] - self.common.size
        if view == 0:
            alone.sums = np.ascontiguousarray(self.sums[:, :plain])
            return alone
        alone.sums = self.sums.copy()
        for column, common in zip(self.sums[:, plain:].T, self.common, strict=True):
            # what PV has in common with these columns is taken out of it
            alone.sums[:, 0] -= common * column
        return alone

    def costs(
        self, valves: Array, shortest: int | Index, shifts: int, reversals: int = 2
    ) -> tuple[Array, Index]:
        """Cost and dead time of every valve in every view, ``(m, v)``; see `one_step_costs`.

        ``shortest`` is one dead time for all, or one a valve.

        Raises:
            ValueError: a dead time beyond `LATEST` samples is asked for.
        """
        each = np.broadcast_to(np.asarray(shortest, dtype=np.int64), len(valves))
        asked = int(each.max(initial=0)) + shifts
        if asked > LATEST:
            raise ValueError(f"dead time and coefficients reach {asked} samples, of {LATEST}")
        found: tuple[Array, Index] = one_step_costs(
            self.rows.u,
            self.blocks,
            np.ascontiguousarray(valves),
            self.sums,
            self.counts,
            self.judged,
            self.common,
            self.rests,
            np.ascontiguousarray(each),
            shifts,
            self.rows.sign,
            reversals,
        )
        return found


def look_around(
    ranking: OneStep,
    ranked: tuple[Array, Array, Index],
    tops: list[int],
    reach: float,
    longest: int,
    reversals: int = 2,
) -> tuple[Array, Array, Index]:
    """Ranked valves, and behind them others around some of them, ``reach`` wide as a share of S.

    ``ranked`` are valves ``(m, 3)``, their costs and dead times in the only view ``(m,)``; ``tops``
    are the numbers of those that are looked around, with dead times up to a sample beside theirs
    and to ``longest``.
    """
    valves, cost, late = ranked
    more = _around(valves[tops], spread_points(_NEAR + 1, 3)[1:], reach)
    soonest = np.clip(late[tops] - 1, 1, max(1, longest - 2)).repeat(_NEAR)
    more_cost, more_late = ranking.costs(more, soonest, min(3, longest), reversals)
    return (
        np.vstack([valves, more]),
        np.concatenate([cost, more_cost[:, 0]]),
        np.concatenate([late, more_late[:, 0]]),
    )


def _around(valves: Array, points: Array, reach: float) -> Array:
    """Valves ``(k m, 3)`` around each of ``(k, 3)``, ``reach`` wide as a share of S."""
    wide = reach * points
    band = np.clip(valves[:, :1] * np.exp(2.0 * wide[:, 0]), LEAST_BAND, WIDEST_BAND)
    jump = np.clip(valves[:, 1:2] + 2.0 * band * wide[:, 1], 0.0, band)
    start = valves[:, 2:] + band * wide[:, 2]
    return np.stack([band.ravel(), jump.ravel(), start.ravel()], axis=1)
