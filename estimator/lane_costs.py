"""Least sums of squares of PV on the responses of many candidates, at several dead times each.

A response of dead time ``d`` is the response of none, ``d`` rows earlier. In memory the rows of
``(n, L)`` stand one after the other, so that the candidates at several dead times in a row are one
run of numbers, which one pass multiplies with a row of PV. Energies need no pass of their own at
every dead time: a sum over shifted rows differs at the ends of each run of judged rows only.
"""

from __future__ import annotations

import numpy as np

from compiled import innermost, kernel
from estimator.arrays import Array, Index
from estimator.lanes import respond, respond_through, whiten_lanes
from estimator.rows import JudgedRows

__all__ = [
    "AT_ONCE",
    "NOTHING",
    "Judged",
    "add_earlier",
    "costs_of_processes",
    "costs_of_stems",
    "shift_earlier",
]

AT_ONCE = 8
"""Rows that one pass adds to a sum, one after the other: the same bits as one a pass, and an eighth
of the reading and writing."""
NOTHING = 1e-7
"""Share of a response's energy below which nothing is left of it beside the other columns."""
_ALIKE = 1e-9
"""Share of its own size below which a determinant is zero: two responses that are one."""

_SIDE_BY_SIDE = 32
"""Candidates that go through all rows together. The signals of more would be asked of the operating
system anew at every call, page by page, which costs more than the sums."""

Judged = tuple[Array, JudgedRows, int, Array, float, float]
"""What candidates are judged by: taps ``(p,)`` of the noise model, judged rows, the stride between
them, signals ``(n, m)``, the sum of squares of the first of them, sign of the gain."""


@innermost
def _add_rows(
    now: Array,
    q: tuple[float, float, float, float],
    p: tuple[float, float, float, float],
    r0: Array,
    r1: Array,
    r2: Array,
    r3: Array,
    r4: Array,
    r5: Array,
    r6: Array,
    r7: Array,
) -> None:
    """Add eight rows, each times a factor: four of ``q`` and four of ``p``."""
    for i in range(now.size):
        total = now[i] + q[0] * r0[i] + q[1] * r1[i] + q[2] * r2[i] + q[3] * r3[i]
        now[i] = total + p[0] * r4[i] + p[1] * r5[i] + p[2] * r6[i] + p[3] * r7[i]


@innermost
def _add_products(
    now: Array,
    r0: Array,
    r1: Array,
    r2: Array,
    r3: Array,
    p0: Array,
    p1: Array,
    p2: Array,
    p3: Array,
) -> None:
    """Add the products of four rows with four others."""
    for i in range(now.size):
        now[i] = now[i] + r0[i] * p0[i] + r1[i] * p1[i] + r2[i] * p2[i] + r3[i] * p3[i]


@innermost
def _add_squares(now: Array, r0: Array, r1: Array, r2: Array, r3: Array) -> None:
    """Add the squares of four rows: what `_add_products` does for rows with themselves."""
    for i in range(now.size):
        now[i] = now[i] + r0[i] * r0[i] + r1[i] * r1[i] + r2[i] * r2[i] + r3[i] * r3[i]


@kernel
def _with_signals(
    run: Array, lanes: int, late: int, rows: Index, signals: Array, out: Array
) -> None:
    """Sums ``(m, w)`` of signals ``(n, m)`` times ``run``, a batch ``(n, L)`` row after row.

    Element ``(c, i)`` of a row ``k`` takes number ``(k - late) L + i``: the lanes at dead time
    ``late``, then those at one less, and so on.
    """
    wide = out.shape[1]
    out[:] = 0.0
    b = 0
    while b + AT_ONCE <= rows.size:
        k0, k1, k2, k3 = rows[b], rows[b + 1], rows[b + 2], rows[b + 3]
        k4, k5, k6, k7 = rows[b + 4], rows[b + 5], rows[b + 6], rows[b + 7]
        r0, r1 = run[(k0 - late) * lanes :], run[(k1 - late) * lanes :]
        r2, r3 = run[(k2 - late) * lanes :], run[(k3 - late) * lanes :]
        r4, r5 = run[(k4 - late) * lanes :], run[(k5 - late) * lanes :]
        r6, r7 = run[(k6 - late) * lanes :], run[(k7 - late) * lanes :]
        for c in range(signals.shape[1]):
            q0, q1, q2, q3 = signals[k0, c], signals[k1, c], signals[k2, c], signals[k3, c]
            q4, q5, q6, q7 = signals[k4, c], signals[k5, c], signals[k6, c], signals[k7, c]
            q, p = (q0, q1, q2, q3), (q4, q5, q6, q7)
            _add_rows(out[c], q, p, r0, r1, r2, r3, r4, r5, r6, r7)
        b += AT_ONCE
    while b < rows.size:
        k = rows[b]
        row = run[(k - late) * lanes :]
        for c in range(signals.shape[1]):
            q, now = signals[k, c], out[c]
            for i in range(wide):
                now[i] += q * row[i]
        b += 1


@kernel
def add_earlier(run: Array, lanes: int, late: int, earlier: int, rows: Index, flat: Array) -> None:
    """Add a response times itself ``earlier`` rows before; the places are those of `_with_signals`.

    For the dead times ``late``, ``late - 1``, ..., as many as ``flat`` holds lanes.
    """
    back = earlier * lanes
    b = 0
    while b + AT_ONCE <= rows.size:
        k0, k1 = (rows[b] - late) * lanes, (rows[b + 1] - late) * lanes
        k2, k3 = (rows[b + 2] - late) * lanes, (rows[b + 3] - late) * lanes
        k4, k5 = (rows[b + 4] - late) * lanes, (rows[b + 5] - late) * lanes
        k6, k7 = (rows[b + 6] - late) * lanes, (rows[b + 7] - late) * lanes
        r0, r1, r2, r3 = run[k0:], run[k1:], run[k2:], run[k3:]
        r4, r5, r6, r7 = run[k4:], run[k5:], run[k6:], run[k7:]
        b += AT_ONCE
        if earlier == 0:
            _add_squares(flat, r0, r1, r2, r3)
            _add_squares(flat, r4, r5, r6, r7)
            continue
        p0, p1, p2, p3 = run[k0 - back :], run[k1 - back :], run[k2 - back :], run[k3 - back :]
        p4, p5, p6, p7 = run[k4 - back :], run[k5 - back :], run[k6 - back :], run[k7 - back :]
        _add_products(flat, r0, r1, r2, r3, p0, p1, p2, p3)
        _add_products(flat, r4, r5, r6, r7, p4, p5, p6, p7)
    while b < rows.size:
        at = (rows[b] - late) * lanes
        now, then = run[at:], run[at - back :]
        for i in range(flat.size):
            flat[i] += now[i] * then[i]
        b += 1


@kernel
def shift_earlier(
    run: Array,
    late: int,
    earlier: int,
    judged: JudgedRows,
    stride: int,
    out: Array,
) -> None:
    """Complete the sums ``(D, L)`` of `add_earlier`, of which the first ``stride`` are known.

    At a shorter dead time each run of judged rows loses its first row and gains one behind.
    """
    _, begins, ends = judged
    count, lanes = out.shape
    back = earlier * lanes
    for d in range(stride, count):
        old, new = out[d - stride], out[d]
        for j in range(lanes):
            new[j] = old[j]
        for b in range(begins.size):
            left, gained = (begins[b] - late + d - stride) * lanes, (ends[b] - late + d) * lanes
            r0, p0 = run[left:], run[left - back :]
            r1, p1 = run[gained:], run[gained - back :]
            for j in range(lanes):
                new[j] = new[j] - r0[j] * p0[j] + r1[j] * p1[j]


@kernel
def _with_earlier(
    run: Array,
    lanes: int,
    late: int,
    earlier: int,
    judged: JudgedRows,
    stride: int,
    out: Array,
) -> None:
    """Sums ``out`` ``(D, L)`` of a response times itself ``earlier`` rows before."""
    added = min(stride, out.shape[0])
    out[:] = 0.0
    add_earlier(run, lanes, late, earlier, judged[0], out.reshape(out.size)[: added * lanes])
    shift_earlier(run, late, earlier, judged, stride, out)


@kernel
def _paired_costs(responses: Array, judged: Judged, shortest: int, count: int) -> Array:
    """Least sum of squares ``(count, L)`` on the responses of two dead times in a row.

    Args:
        responses: at no dead time, ``(n, L)``.
        judged: what they are judged by. The signals are PV as the columns leave it, then an
            orthonormal basis of the columns. The longest dead time reaches no further back than
            the first judged row. With a stride every so many rows count, and the sums are scaled
            up: a ranking, not a cost. The two gains have the one sign, 0 where it is not known:
            together they are a dead time between two samples.
        shortest, count: dead times, in samples.
    """
    taps, rows, stride, signals, rest, sign = judged
    white = whiten_lanes(responses, taps) if taps.size > 0 else responses
    lanes, columns = responses.shape[1], signals.shape[1]
    run = white.reshape(white.size)
    late = shortest + count
    own, cross = np.empty((count + 1, lanes)), np.empty((count, lanes))
    _with_earlier(run, lanes, late, 0, rows, stride, own)
    _with_earlier(run, lanes, late - 1, 1, rows, stride, cross)
    share = np.empty((columns, (count + 1) * lanes))
    _with_signals(run, lanes, late, rows[0], signals, share)
    out = np.empty((count, lanes))
    left = np.empty((count + 1, lanes))
    for d in range(count + 1):
        at = d * lanes
        for j in range(lanes):
            energy = stride * own[d, j]
            for c in range(1, columns):
                energy -= (stride * share[c, at + j]) * (stride * share[c, at + j])
            left[d, j] = energy if energy > NOTHING * stride * own[d, j] else 0.0
    for d in range(count):
        # the later one of the pair stands first
        at, after = (count - d - 1) * lanes, (count - d) * lanes
        for j in range(lanes):
            e1, e2 = left[count - d, j], left[count - d - 1, j]
            a1, a2 = stride * share[0, after + j], stride * share[0, at + j]
            both = stride * cross[count - d - 1, j]
            for c in range(1, columns):
                both -= (stride * share[c, after + j]) * (stride * share[c, at + j])
            gain = 0.0
            if e1 > 0.0 and sign * a1 >= 0.0:
                gain = a1 * a1 / e1
            if e2 > 0.0 and sign * a2 >= 0.0:
                gain = max(gain, a2 * a2 / e2)
            det = e1 * e2 - both * both
            if det > _ALIKE * e1 * e2 and e1 > 0.0:
                g1, g2 = (a1 * e2 - a2 * both) / det, (a2 * e1 - a1 * both) / det
                if g1 * g2 >= 0.0 and sign * g1 >= 0.0 and sign * g2 >= 0.0:
                    gain = max(gain, g1 * a1 + g2 * a2)
            out[d, j] = rest - gain
    return out


@kernel
def costs_of_stems(
    stems: Array, processes: Array, judged: Judged, shortest: int, count: int
) -> Array:
    """Costs ``(count, L)`` of stems ``(n, L)``, each through a process of its own, ``(4, L)``."""
    lanes = stems.shape[1]
    if lanes <= _SIDE_BY_SIDE:
        responses = respond(stems, processes[0], processes[1], processes[2], processes[3])
        return _paired_costs(responses, judged, shortest, count)
    out = np.empty((count, lanes))
    for begin in range(0, lanes, _SIDE_BY_SIDE):
        end = min(begin + _SIDE_BY_SIDE, lanes)
        some = processes[:, begin:end].copy()
        responses = respond(stems[:, begin:end].copy(), some[0], some[1], some[2], some[3])
        out[:, begin:end] = _paired_costs(responses, judged, shortest, count)
    return out


@kernel
def costs_of_processes(
    stem: Array, processes: Array, judged: Judged, shortest: int, count: int
) -> Array:
    """Costs ``(count, L)`` of one stem ``(n,)`` through each of the processes ``(4, L)``."""
    return _paired_costs(respond_through(stem, processes), judged, shortest, count)
