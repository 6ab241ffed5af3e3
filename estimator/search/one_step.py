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
def one_step_costs(
    op: Array,
    top: Array,
    bottom: Array,
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

    ``top`` and ``bottom`` are OP's extremes in blocks of eight samples, by which a walk skips.
    ``sums`` ``(n + p, c)`` holds, of PV (first) and the columns beside the stem, the sums from a
    row to the end; ``counts`` ``(n + p,)`` the judged rows from a row to the end, ``judged`` 1 for
    each of them. All are zero from row ``n`` on, for the longest dead time. ``shifts`` dead times
    are tried from ``shortest`` on.
    """
    n, m, columns = op.size, valves.shape[0], sums.shape[1]
    cost, best = np.full(m, np.inf), np.full(m, shortest)
    at, level = np.empty(n + 1, dtype=np.int64), np.empty(n + 2)
    wide = shifts + 2
    flat = sums.ravel()
    share = np.empty((wide, columns))
    shared = share.ravel()
    own, next_, second = np.empty(wide), np.empty(wide), np.empty(wide)
    step, more, after = np.empty(n), np.empty(n), np.empty(n)
    twice, alone = np.empty(n), np.empty(n)
    for v in range(m):
        static = 0.5 * (valves[v, 0] + valves[v, 1])
        dynamic = 0.5 * (valves[v, 0] - valves[v, 1])
        now = valves[v, 2]
        level[0] = now
        slips = turns = 0
        direction = 0.0
        for b in range(top.size):
            # no sample of the block moves the stem
            if top[b] - now <= static and bottom[b] - now >= -static:
                continue
            for k in range(BLOCK * b, min(BLOCK * b + BLOCK, n)):
                error = op[k] - now
                if error > static or error < -static:
                    now = op[k] - dynamic if error > 0.0 else op[k] + dynamic
                    turns += 1 if error * direction < 0.0 else 0
                    direction = error
                    at[slips] = k
                    slips += 1
                    level[slips] = now
        if turns < reversals or slips > n // 3:
            continue
        for w in range(wide):
            own[w] = level[0] * level[0] * counts[0]
            next_[w] = second[w] = 0.0
            for c in range(columns):
                share[w, c] = level[0] * sums[0, c]
        for j in range(slips):
            new, old = level[j + 1], level[j]
            step[j] = new - old
            more[j] = new * new - old * old
            # products with the stem one and two samples earlier differ only after a slip
            older = level[j - 1] if j > 0 and at[j] == at[j - 1] + 1 else old
            after[j] = new * step[j]
            twice[j] = new * (new - older)
            alone[j] = 0.0 if j + 1 < slips and at[j + 1] == at[j] + 1 else after[j]
        j = 0
        while j + _AT_ONCE <= slips:
            k0, k1 = at[j] + shortest, at[j + 1] + shortest
            k2, k3 = at[j + 2] + shortest, at[j + 3] + shortest
            s0, s1, s2, s3 = step[j], step[j + 1], step[j + 2], step[j + 3]
            # the rows of all dead times stand one after the other
            p0, p1 = flat[k0 * columns :], flat[k1 * columns :]
            p2, p3 = flat[k2 * columns :], flat[k3 * columns :]
            for i in range(shared.size):
                shared[i] = shared[i] + s0 * p0[i] + s1 * p1[i] + s2 * p2[i] + s3 * p3[i]
            s0, s1, s2, s3 = more[j], more[j + 1], more[j + 2], more[j + 3]
            p0, p1, p2, p3 = counts[k0:], counts[k1:], counts[k2:], counts[k3:]
            for w in range(wide):
                own[w] = own[w] + s0 * p0[w] + s1 * p1[w] + s2 * p2[w] + s3 * p3[w]
            s0, s1, s2, s3 = after[j], after[j + 1], after[j + 2], after[j + 3]
            p0, p1, p2, p3 = judged[k0:], judged[k1:], judged[k2:], judged[k3:]
            for w in range(wide):
                next_[w] = next_[w] + s0 * p0[w] + s1 * p1[w] + s2 * p2[w] + s3 * p3[w]
            s0, s1, s2, s3 = twice[j], twice[j + 1], twice[j + 2], twice[j + 3]
            for w in range(wide):
                second[w] = second[w] + s0 * p0[w] + s1 * p1[w] + s2 * p2[w] + s3 * p3[w]
            s0, s1, s2, s3 = alone[j], alone[j + 1], alone[j + 2], alone[j + 3]
            p0, p1, p2, p3 = judged[k0 + 1 :], judged[k1 + 1 :], judged[k2 + 1 :], judged[k3 + 1 :]
            for w in range(wide):
                second[w] = second[w] + s0 * p0[w] + s1 * p1[w] + s2 * p2[w] + s3 * p3[w]
            j += _AT_ONCE
        while j < slips:
            k = at[j] + shortest
            part = flat[k * columns :]
            for i in range(shared.size):
                shared[i] += step[j] * part[i]
            for w in range(wide):
                own[w] += more[j] * counts[k + w]
                next_[w] += after[j] * judged[k + w]
                second[w] += twice[j] * judged[k + w] + alone[j] * judged[k + w + 1]
            j += 1
        for w in range(wide):
            next_[w] = own[w] - next_[w]
            second[w] = own[w] - second[w]
        for w in range(shifts):
            g00, g11, g22 = own[w], own[w + 1], own[w + 2]
            g01, g12, g02 = next_[w], next_[w + 1], second[w]
            for c in range(1, columns):
                a0, a1, a2 = share[w, c], share[w + 1, c], share[w + 2, c]
                g00 -= a0 * a0
                g11 -= a1 * a1
                g22 -= a2 * a2
                g01 -= a0 * a1
                g12 -= a1 * a2
                g02 -= a0 * a2
            r0, r1, r2 = share[w, 0], share[w + 1, 0], share[w + 2, 0]
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
            if sign * (b0 + b1 + b2) >= 0.0 and 0.0 <= rest - gain < cost[v]:
                cost[v] = rest - gain
                best[v] = shortest + w
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
        self.top = padded.reshape(blocks, BLOCK).max(axis=1)
        self.bottom = padded.reshape(blocks, BLOCK).min(axis=1)

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
            self.top,
            self.bottom,
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
