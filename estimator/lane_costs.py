"""Least sums of squares of PV on the responses of many candidates, at several dead times each.

A response of dead time ``d`` is the response of none, ``d`` rows earlier. In memory the rows of
``(n, L)`` stand one after the other, so that the candidates at several dead times in a row are one
run of numbers, which one pass multiplies with a row of PV. Energies need no pass of their own at
every dead time: a sum over shifted rows differs at the ends of each run of judged rows only.
"""

from __future__ import annotations

import numpy as np

from compiled import kernel
from estimator.arrays import Array, Index
from estimator.lanes import respond, whiten_lanes

__all__ = ["NOTHING", "Judged", "costs_of_stems", "energies_at"]

_AT_ONCE = 8
"""Rows that one pass adds to a sum, one after the other: the same bits as one a pass, and an eighth
of the reading and writing."""
NOTHING = 1e-7
"""Share of a response's energy below which nothing is left of it beside the other columns."""
_FEW_RUNS = 8
"""Runs of judged rows up to which a shifted sum is cheaper than a sum of its own."""
_ALIKE = 1e-9
"""Share of its own size below which a determinant is zero: two responses that are one."""

Judged = tuple[Array, Array, Array, float, int, float]
"""What candidates are judged by: taps ``(p,)`` of the noise model, weight ``(n,)``, signals
``(n, m)``, the sum of squares of the first of them, first judged row, sign of the gain."""


@kernel
def _judged(weight: Array, first: int, stride: int) -> tuple[Index, Index, Index]:
    """Every ``stride``-th row from ``first`` on, those that are judged; first and last of each run.

    A run is rows of which each is ``stride`` after the one before.
    """
    rows, begins = np.empty(weight.size, dtype=np.int64), np.empty(weight.size, dtype=np.int64)
    ends = np.empty(weight.size, dtype=np.int64)
    count = runs = 0
    for k in range(first, weight.size, stride):
        if weight[k] != 0.0:
            if count == 0 or rows[count - 1] != k - stride:
                begins[runs] = k
                runs += 1
            ends[runs - 1] = k
            rows[count] = k
            count += 1
    return rows[:count], begins[:runs], ends[:runs]


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
    while b + _AT_ONCE <= rows.size:
        k0, k1, k2, k3 = rows[b], rows[b + 1], rows[b + 2], rows[b + 3]
        k4, k5, k6, k7 = rows[b + 4], rows[b + 5], rows[b + 6], rows[b + 7]
        r0, r1 = run[(k0 - late) * lanes :], run[(k1 - late) * lanes :]
        r2, r3 = run[(k2 - late) * lanes :], run[(k3 - late) * lanes :]
        r4, r5 = run[(k4 - late) * lanes :], run[(k5 - late) * lanes :]
        r6, r7 = run[(k6 - late) * lanes :], run[(k7 - late) * lanes :]
        for c in range(signals.shape[1]):
            q0, q1, q2, q3 = signals[k0, c], signals[k1, c], signals[k2, c], signals[k3, c]
            q4, q5, q6, q7 = signals[k4, c], signals[k5, c], signals[k6, c], signals[k7, c]
            now = out[c]
            for i in range(wide):
                total = now[i] + q0 * r0[i] + q1 * r1[i] + q2 * r2[i] + q3 * r3[i]
                now[i] = total + q4 * r4[i] + q5 * r5[i] + q6 * r6[i] + q7 * r7[i]
        b += _AT_ONCE
    while b < rows.size:
        k = rows[b]
        row = run[(k - late) * lanes :]
        for c in range(signals.shape[1]):
            q, now = signals[k, c], out[c]
            for i in range(wide):
                now[i] += q * row[i]
        b += 1


@kernel
def _with_earlier(
    run: Array,
    lanes: int,
    late: int,
    earlier: int,
    judged: tuple[Index, Index, Index],
    stride: int,
    out: Array,
) -> None:
    """Sums of a response times itself ``earlier`` rows before, ``out (D, L)``.

    For the dead times ``late``, ``late - 1``, ... The first ``stride`` ones are added up; the
    others are those, ``stride`` rows shifted.
    """
    rows, begins, ends = judged
    count = out.shape[0]
    added = min(stride, count)
    flat = out.reshape(count * lanes)[: added * lanes]
    out[:] = 0.0
    back = earlier * lanes
    b = 0
    while b + _AT_ONCE <= rows.size:
        k0, k1 = (rows[b] - late) * lanes, (rows[b + 1] - late) * lanes
        k2, k3 = (rows[b + 2] - late) * lanes, (rows[b + 3] - late) * lanes
        k4, k5 = (rows[b + 4] - late) * lanes, (rows[b + 5] - late) * lanes
        k6, k7 = (rows[b + 6] - late) * lanes, (rows[b + 7] - late) * lanes
        r0, r1, r2, r3 = run[k0:], run[k1:], run[k2:], run[k3:]
        r4, r5, r6, r7 = run[k4:], run[k5:], run[k6:], run[k7:]
        p0, p1, p2, p3 = run[k0 - back :], run[k1 - back :], run[k2 - back :], run[k3 - back :]
        p4, p5, p6, p7 = run[k4 - back :], run[k5 - back :], run[k6 - back :], run[k7 - back :]
        for i in range(flat.size):
            total = flat[i] + r0[i] * p0[i] + r1[i] * p1[i] + r2[i] * p2[i] + r3[i] * p3[i]
            flat[i] = total + r4[i] * p4[i] + r5[i] * p5[i] + r6[i] * p6[i] + r7[i] * p7[i]
        b += _AT_ONCE
    while b < rows.size:
        at = (rows[b] - late) * lanes
        now, then = run[at:], run[at - back :]
        for i in range(flat.size):
            flat[i] += now[i] * then[i]
        b += 1
    for d in range(added, count):
        # at a shorter dead time each run of judged rows loses its first row and gains one behind
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
def energies_at(responses: Array, weight: Array, first: int, delays: Index) -> Array:
    """Sums of squares over the judged rows at each of the rising ``delays``, ``(D, L)``."""
    lanes = responses.shape[1]
    run = responses.reshape(responses.size)
    judged = _judged(weight, first, 1)
    longest = delays[-1]
    out = np.empty((delays.size, lanes))
    if judged[1].size <= _FEW_RUNS:
        every = np.empty((longest - delays[0] + 1, lanes))
        _with_earlier(run, lanes, longest, 0, judged, 1, every)
        for d in range(delays.size):
            out[d] = every[longest - delays[d]]
    else:
        for d in range(delays.size):
            _with_earlier(run, lanes, delays[d], 0, judged, 1, out[d : d + 1])
    return out


@kernel
def _paired_costs(
    responses: Array,
    weight: Array,
    signals: Array,
    rest: float,
    first: int,
    shortest: int,
    count: int,
    stride: int,
    sign: float,
) -> Array:
    """Least sum of squares ``(count, L)`` on the responses of two dead times in a row.

    Args:
        responses: whitened, ``(n, L)``, at no dead time.
        weight: 1 for a judged row, ``(n,)``.
        signals: PV as the columns leave it, then an orthonormal basis of them, ``(n, m)``.
        rest: sum of squares of the first signal.
        first: first judged row; the longest dead time reaches no further back.
        shortest, count: dead times, in samples.
        stride: every so many rows count, and the sums are scaled up: a ranking, not a cost.
        sign: of the gain, 0 where it is not known. The two gains have one sign: together they are
            a dead time between two samples.
    """
    lanes, columns = responses.shape[1], signals.shape[1]
    run = responses.reshape(responses.size)
    judged = _judged(weight, first, stride)
    late = shortest + count
    own, cross = np.empty((count + 1, lanes)), np.empty((count, lanes))
    _with_earlier(run, lanes, late, 0, judged, stride, own)
    _with_earlier(run, lanes, late - 1, 1, judged, stride, cross)
    share = np.empty((columns, (count + 1) * lanes))
    _with_signals(run, lanes, late, judged[0], signals, share)
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
    stems: Array, processes: Array, judged: Judged, shortest: int, count: int, stride: int
) -> Array:
    """Costs ``(count, L)`` of stems ``(n, L)``, each through a process of its own, ``(4, L)``."""
    taps, weight, signals, rest, first, sign = judged
    responses = respond(stems, processes[0], processes[1], processes[2], processes[3])
    white = whiten_lanes(responses, taps) if taps.size > 0 else responses
    return _paired_costs(white, weight, signals, rest, first, shortest, count, stride, sign)
