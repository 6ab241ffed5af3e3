"""Sums over the slips of He's stem: what valves of one S and J share is added up once."""

from __future__ import annotations

import numpy as np

from compiled import innermost, kernel
from estimator.arrays import Array, Index

__all__ = ["BLOCK", "add_slips", "ahead_judged", "slip_moments", "walk"]

BLOCK = 8
"""Samples that a walk skips at once where they stay inside the stick band."""
_AT_ONCE = 4
"""Slips that one pass adds to a sum, one after the other."""


@kernel
def walk(
    op: Array,
    blocks: tuple[Array, Array],
    valve: Array,
    known: tuple[Index, Array, Index],
    most: int,
    at: Index,
    level: Array,
    turns: Index,
) -> tuple[int, int]:
    """Slips of a valve of He's law until it slips as a ``known`` one does; how many, and where.

    It ends after more than ``most`` slips.

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
                if slips > most:
                    return slips, -1
    return slips, -1


@kernel
def slip_moments(at: Index, level: Array, slips: int, out: Array) -> None:
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
def ahead_judged(judged: Array, wide: int) -> Array:
    """1 where a row and the ``wide`` rows after it are judged, 0 elsewhere."""
    found = np.zeros(judged.size)
    run = 0
    for k in range(judged.size - 1, -1, -1):
        run = run + 1 if judged[k] != 0.0 else 0
        if run > wide:
            found[k] = 1.0
    return found


@innermost
def _add_four(
    sums: Array,
    s: tuple[float, float, float, float],
    r0: Array,
    r1: Array,
    r2: Array,
    r3: Array,
) -> None:
    """Add four rows, each times a factor."""
    for i in range(sums.size):
        sums[i] = sums[i] + s[0] * r0[i] + s[1] * r1[i] + s[2] * r2[i] + s[3] * r3[i]


@kernel
def add_slips(
    at: Index,
    moments: Array,
    slips: int,
    factor: float,
    tables: tuple[Array, Array, Array, Array],
    columns: int,
    shared: Array,
    products: Array,
) -> None:
    """Add ``factor`` times the sums of the first ``slips`` at all dead times.

    ``tables`` are the sums with PV and the columns, the judged rows from a row on, the judged rows,
    and what `ahead_judged` gives for them. ``shared`` ``(w c,)`` are the sums with PV and the
    columns, ``products`` ``(3, w)`` those of the stem with itself: its square, and what products
    one and two samples apart lack.
    """
    flat, counts, judged, plain = tables
    own, next_, second = products[0], products[1], products[2]
    step, more, after, twice, alone = moments[0], moments[1], moments[2], moments[3], moments[4]
    wide = own.size
    counted = mores = afters = seconds = 0.0
    for j in range(slips):
        k = at[j]
        if plain[k] != 0.0:
            # a row later one judged row less is left: one sum stands for all dead times
            counted += more[j] * counts[k]
            mores += more[j]
            afters += after[j]
            seconds += twice[j] + alone[j]
        else:
            for w in range(wide):
                own[w] += factor * more[j] * counts[k + w]
                next_[w] += factor * after[j] * judged[k + w]
                second[w] += factor * (twice[j] * judged[k + w] + alone[j] * judged[k + w + 1])
    for w in range(wide):
        own[w] += factor * (counted - w * mores)
        next_[w] += factor * afters
        second[w] += factor * seconds
    j = 0
    while j + _AT_ONCE <= slips:
        k0, k1, k2, k3 = at[j], at[j + 1], at[j + 2], at[j + 3]
        s0, s1 = factor * step[j], factor * step[j + 1]
        s2, s3 = factor * step[j + 2], factor * step[j + 3]
        # the rows of all dead times stand one after the other
        p0, p1 = flat[k0 * columns :], flat[k1 * columns :]
        p2, p3 = flat[k2 * columns :], flat[k3 * columns :]
        _add_four(shared, (s0, s1, s2, s3), p0, p1, p2, p3)
        j += _AT_ONCE
    while j < slips:
        now, part = factor * step[j], flat[at[j] * columns :]
        for i in range(shared.size):
            shared[i] += now * part[i]
        j += 1
