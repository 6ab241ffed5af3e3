"""Valves ranked by one-step errors: exhaustively, because a stem is a few slips.

Under the paper's criterion (12) the process is linear in its coefficients, so that no poles need to
be searched: PV's own past is taken out once for all valves, and each valve costs a few sums over
its slips. Stick bands are told sharply where noise is small, which is where simulation errors have
narrow valleys and a coarse grid misses them. The process has direct feed-through or more dead time
and three coefficients of the stem.
"""

from __future__ import annotations

import numpy as np

from compiled import kernel
from estimator.algebra import dot, filter_rows, orthonormal, project_out
from estimator.arrays import Array, Index
from estimator.rows import Rows

__all__ = ["OneStep", "one_step_costs"]

BLOCK = 8
"""Samples that a walk skips at once where they stay inside the stick band."""

_AT_ONCE = 4
"""Slips that one pass adds to a sum, one after the other."""

LATEST = 32
"""Longest dead time and coefficients of the stem, in samples, that the sums leave room for."""


@kernel
def _walk(
    op: Array,
    blocks: tuple[Array, Array],
    valve: Array,
    known: tuple[Index, Array, Index],
    at: Index,
    level: Array,
    turns: Index,
) -> tuple[int, int]:
    """Slips of a valve of He's law until it slips as a ``known`` one does; how many, and where.

    ``at`` receives the sample of each slip, ``level`` the stem's position before the first and
    after each, ``turns`` how often the stem had turned by then. A slip ends where OP and the
    friction say, wherever the stem was: from the first slip that two valves of the same S and J
    share they move alike. Returned are the number of slips, that one included, and its number
    among the ``known`` ones (samples, levels, turns), or -1.
    """
    top, bottom = blocks
    known_at, known_level, _ = known
    static, dynamic = 0.5 * (valve[0] + valve[1]), 0.5 * (valve[0] - valve[1])
    now = valve[2]
    level[0] = now
    slips = turned = beside = 0
    direction = 0.0
    for b in range(top.size):
        # no sample of the block moves the stem
        if top[b] - now <= static and bottom[b] - now >= -static:
            continue
        for k in range(BLOCK * b, min(BLOCK * b + BLOCK, op.size)):
            error = op[k] - now
            if error > static or error < -static:
                now = op[k] - dynamic if error > 0.0 else op[k] + dynamic
                turned += 1 if error * direction < 0.0 else 0
                direction = error
                at[slips], turns[slips] = k, turned
                slips += 1
                level[slips] = now
                while beside < known_at.size and known_at[beside] < k:
                    beside += 1
                if (
                    beside < known_at.size
                    and known_at[beside] == k
                    and known_level[beside + 1] == now
                ):
                    return slips, beside
    return slips, -1


@kernel
def _moments(at: Index, level: Array, slips: int, out: Array) -> None:
    """What each slip adds to the sums, ``out (5, slips)``.

    Its step; what the square of the stem gains; and what products with the stem one and two samples
    earlier lack: they differ from the square only after a slip.
    """
    for j in range(slips):
        new, old = level[j + 1], level[j]
        older = level[j - 1] if j > 0 and at[j] == at[j - 1] + 1 else old
        after = new * (new - old)
        out[0, j] = new - old
        out[1, j] = new * new - old * old
        out[2, j] = after
        out[3, j] = new * (new - older)
        out[4, j] = 0.0 if j + 1 < slips and at[j + 1] == at[j] + 1 else after


@kernel
def _add(
    at: Index,
    moments: Array,
    slips: int,
    factor: float,
    tables: tuple[Array, Array, Array],
    columns: int,
    shared: Array,
    products: Array,
) -> None:
    """Add ``factor`` times the sums of the first ``slips`` at all dead times.

    ``shared`` ``(w c,)`` are the sums with PV and the columns, ``products`` ``(3, w)`` those of the
    stem with itself: its square, and what products one and two samples apart lack.
    """
    flat, counts, judged = tables
    own, next_, second = products[0], products[1], products[2]
    step, more, after, twice, alone = moments[0], moments[1], moments[2], moments[3], moments[4]
    wide = own.size
    j = 0
    while j + _AT_ONCE <= slips:
        k0, k1, k2, k3 = at[j], at[j + 1], at[j + 2], at[j + 3]
        s0, s1 = factor * step[j], factor * step[j + 1]
        s2, s3 = factor * step[j + 2], factor * step[j + 3]
        # the rows of all dead times stand one after the other
        p0, p1 = flat[k0 * columns :], flat[k1 * columns :]
        p2, p3 = flat[k2 * columns :], flat[k3 * columns :]
        for i in range(shared.size):
            shared[i] = shared[i] + s0 * p0[i] + s1 * p1[i] + s2 * p2[i] + s3 * p3[i]
        s0, s1 = factor * more[j], factor * more[j + 1]
        s2, s3 = factor * more[j + 2], factor * more[j + 3]
        p0, p1, p2, p3 = counts[k0:], counts[k1:], counts[k2:], counts[k3:]
        for w in range(wide):
            own[w] = own[w] + s0 * p0[w] + s1 * p1[w] + s2 * p2[w] + s3 * p3[w]
        s0, s1 = factor * after[j], factor * after[j + 1]
        s2, s3 = factor * after[j + 2], factor * after[j + 3]
        p0, p1, p2, p3 = judged[k0:], judged[k1:], judged[k2:], judged[k3:]
        for w in range(wide):
            next_[w] = next_[w] + s0 * p0[w] + s1 * p1[w] + s2 * p2[w] + s3 * p3[w]
        s0, s1 = factor * twice[j], factor * twice[j + 1]
        s2, s3 = factor * twice[j + 2], factor * twice[j + 3]
        for w in range(wide):
            second[w] = second[w] + s0 * p0[w] + s1 * p1[w] + s2 * p2[w] + s3 * p3[w]
        s0, s1 = factor * alone[j], factor * alone[j + 1]
        s2, s3 = factor * alone[j + 2], factor * alone[j + 3]
        p0, p1, p2, p3 = judged[k0 + 1 :], judged[k1 + 1 :], judged[k2 + 1 :], judged[k3 + 1 :]
        for w in range(wide):
            second[w] = second[w] + s0 * p0[w] + s1 * p1[w] + s2 * p2[w] + s3 * p3[w]
        j += _AT_ONCE
    while j < slips:
        k = at[j]
        part = flat[k * columns :]
        for i in range(shared.size):
            shared[i] += factor * step[j] * part[i]
        for w in range(wide):
            own[w] += factor * more[j] * counts[k + w]
            next_[w] += factor * after[j] * judged[k + w]
            second[w] += factor * (twice[j] * judged[k + w] + alone[j] * judged[k + w + 1])
        j += 1


@kernel
def _least(
    shared: Array, products: Array, columns: int, rest: float, sign: float
) -> tuple[float, int]:
    """Least sum of squares over the dead times, and which; see `_add` for the sums."""
    own, next_, second = products[0], products[1], products[2]
    least, best = np.inf, 0
    for w in range(own.size - 2):
        at0, at1, at2 = w * columns, (w + 1) * columns, (w + 2) * columns
        g00, g11, g22 = own[w], own[w + 1], own[w + 2]
        g01, g12 = own[w] - next_[w], own[w + 1] - next_[w + 1]
        g02 = own[w] - second[w]
        for c in range(1, columns):
            a0, a1, a2 = shared[at0 + c], shared[at1 + c], shared[at2 + c]
            g00 -= a0 * a0
            g11 -= a1 * a1
            g22 -= a2 * a2
            g01 -= a0 * a1
            g12 -= a1 * a2
            g02 -= a0 * a2
        r0, r1, r2 = shared[at0], shared[at1], shared[at2]
        small = 1e-6 * own[w]
        if g00 <= small:
            continue
        l10, l20 = g01 / g00, g02 / g00
        d1 = g11 - l10 * g01
        if d1 <= small:
            continue
        l21 = (g12 - l20 * g01) / d1
        d2 = g22 - l20 * g02 - l21 * l21 * d1
        if d2 <= small:
            continue
        z0 = r0
        z1 = r1 - l10 * z0
        z2 = r2 - l20 * z0 - l21 * z1
        gain = z0 * z0 / g00 + z1 * z1 / d1 + z2 * z2 / d2
        b2 = z2 / d2
        b1 = z1 / d1 - l21 * b2
        b0 = z0 / g00 - l10 * b1 - l20 * b2
        if sign * (b0 + b1 + b2) >= 0.0 and 0.0 <= rest - gain < least:
            least, best = rest - gain, w
    return least, best


@kernel
def one_step_costs(
    op: Array,
    blocks: tuple[Array, Array],
    valves: Array,
    sums: Array,
    counts: Array,
    judged: Array,
    rest: float,
    shortest: int,
    shifts: int,
    sign: float,
    reversals: int,
) -> tuple[Array, Index]:
    """Least sum of squares and its dead time for valves ``(m, 3)`` of He's law; both ``(m,)``.

    ``blocks`` are OP's highest and lowest values of eight samples each, by which a walk skips.
    ``sums`` ``(n + p, c)`` holds, of PV (first) and the columns beside the stem, the sums from a
    row to the end; ``counts`` ``(n + p,)`` the judged rows from a row to the end, ``judged`` 1 for
    each of them. All are zero from row ``n`` on, for the longest dead time. ``shifts`` dead times
    are tried from ``shortest`` on. Valves of one S and J that follow each other cost little more
    than one of them.
    """
    n, m, columns = op.size, valves.shape[0], sums.shape[1]
    cost, best = np.full(m, np.inf), np.full(m, shortest)
    wide = shifts + 2
    tables = (sums[shortest:].ravel(), counts[shortest:], judged[shortest:])
    shared, products = np.empty(wide * columns), np.empty((3, wide))
    at, level, turns = np.empty(n + 2, np.int64), np.empty(n + 3), np.empty(n + 2, np.int64)
    moments = np.empty((5, n + 2))
    # the valve of the same S and J whose sums are known
    known_at, known_level, known_turns = at.copy(), level.copy(), turns.copy()
    known_moments, known_shared, known_products = moments.copy(), shared.copy(), products.copy()
    known = 0
    for v in range(m):
        if v == 0 or valves[v, 0] != valves[v - 1, 0] or valves[v, 1] != valves[v - 1, 1]:
            known = 0
        slips, same = _walk(
            op,
            blocks,
            valves[v],
            (known_at[:known], known_level, known_turns),
            at,
            level,
            turns,
        )
        behind = known - same - 1 if same >= 0 else 0
        turned = turns[slips - 1] if slips > 0 else 0
        if behind > 0:
            turned += known_turns[known - 1] - known_turns[same]
        if turned < reversals or slips + behind > n // 3:
            continue
        if same < 0:
            _moments(at, level, slips, moments)
            for w in range(wide):
                for c in range(columns):
                    shared[w * columns + c] = level[0] * sums[0, c]
            products[0], products[1:] = level[0] * level[0] * counts[0], 0.0
            _add(at, moments, slips, 1.0, tables, columns, shared, products)
            known = slips
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
            _moments(at, level, slips + more, moments)
            moved = level[0] - known_level[0]
            for w in range(wide):
                for c in range(columns):
                    place = w * columns + c
                    shared[place] = known_shared[place] + moved * sums[0, c]
            gained = level[0] * level[0] - known_level[0] * known_level[0]
            products[:] = known_products
            products[0] += gained * counts[0]
            beside = min(1, behind)
            _add(
                known_at, known_moments, same + 1 + beside, -1.0, tables, columns, shared, products
            )
            _add(at, moments, slips + beside, 1.0, tables, columns, shared, products)
        cost[v], late = _least(shared, products, columns, rest, sign)
        best[v] = shortest + late
    return cost, best


class OneStep:
    """PV and its past made ready for the ranking; ``columns`` ``(m, n)`` are beside the stem."""

    def __init__(self, rows: Rows, columns: Array, past: int) -> None:
        n = rows.size
        shifted = np.zeros((past, n))
        for i in range(past):
            shifted[i, i + 1 :] = rows.y[: n - i - 1]
        none = np.zeros(0)
        basis = orthonormal(filter_rows(np.vstack([shifted, columns]), none, rows.weight))
        target = project_out(rows.y * rows.weight, basis)
        # the target is orthogonal to the basis: its products with a stem need nothing taken out
        signals = np.vstack([target[None], basis])
        tail = np.cumsum(signals[:, ::-1], axis=1)[:, ::-1]
        beyond = LATEST + 1
        self.sums = np.ascontiguousarray(np.vstack([tail.T, np.zeros((beyond, len(signals)))]))
        self.counts = np.append(np.cumsum(rows.weight[::-1])[::-1], np.zeros(beyond))
        self.judged = np.append(rows.weight, np.zeros(beyond))
        self.rest = dot(target, target)
        self.rows = rows
        blocks = -(-n // BLOCK)
        padded = np.concatenate([rows.u, np.full(blocks * BLOCK - n, rows.u[-1])])
        padded = padded.reshape(blocks, BLOCK)
        self.blocks = padded.max(axis=1), padded.min(axis=1)

    def costs(
        self, valves: Array, shortest: int, shifts: int, reversals: int = 2
    ) -> tuple[Array, Index]:
        """Cost and dead time of every valve; see :func:`one_step_costs`.

        Raises:
            ValueError: a dead time beyond `LATEST` samples is asked for.
        """
        if shortest + shifts > LATEST:
            asked = shortest + shifts
            raise ValueError(f"dead time and coefficients reach {asked} samples, of {LATEST}")
        found: tuple[Array, Index] = one_step_costs(
            self.rows.u,
            self.blocks,
            np.ascontiguousarray(valves),
            self.sums,
            self.counts,
            self.judged,
            self.rest,
            shortest,
            shifts,
            self.rows.sign,
            reversals,
        )
        return found
