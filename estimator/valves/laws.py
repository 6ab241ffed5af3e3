"""Valve laws for the search: many valves at once, one a lane.

A law turns OP and a table of valves into stems. All laws share three parameters, so that the search
needs to know nothing of them: stick band ``S``, slip jump ``J`` and the stem's position ``x_0``
before the first sample. In all of them a stem at rest breaks away where ``|u - x| > fS``; they
differ in what comes after, with ``fS = (S + J) / 2`` and ``fD = (S - J) / 2``:

* ``he``: it stands at ``u -+ fD`` and sticks again at once (He et al., 2007; equation (4) of Bacci
  di Capaci et al., 2018). The valve answers once in a sample.
* ``sliding``: it follows OP at ``u -+ fD`` until OP stops or turns (Choudhury et al., 2005; Kano et
  al., 2004; a valve with Coulomb and static friction and little mass).
* ``steps``: it goes in slips of J, as many as OP asks for, because the valve answers faster than
  the samples are taken: He's law for a record that is slower than the controller's scan.
* ``sliding-between``: the sliding law for such a record.

In a record that is slower than the scan OP also turns between two samples, where the lines before
and after meet, and the stem answers there: without these turns S comes out too small.

A fifth law is one kernel with this signature and one line in :data:`LAWS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import MappingProxyType

import numpy as np

from compiled import kernel
from estimator.arrays import Array

__all__ = ["BETWEEN", "LAWS", "NEEDS", "Law", "stem_of"]

Law = Callable[[Array, Array], Array]
"""``law(op, valves)``: OP ``(n,)`` and valves ``(L, 3)`` (S, J, x_0) to stems ``(n, L)``."""


@kernel
def _frictions(valves: Array) -> tuple[Array, Array]:
    """Static and dynamic friction ``(L,)`` each."""
    lanes = valves.shape[0]
    static, dynamic = np.empty(lanes), np.empty(lanes)
    for j in range(lanes):
        static[j] = 0.5 * (valves[j, 0] + valves[j, 1])
        dynamic[j] = 0.5 * (valves[j, 0] - valves[j, 1])
    return static, dynamic


@kernel
def he_stems(op: Array, valves: Array) -> Array:
    """He's law."""
    n, lanes = op.size, valves.shape[0]
    static, dynamic = _frictions(valves)
    now = valves[:, 2].copy()
    out = np.empty((n, lanes))
    for k in range(n):
        u = op[k]
        for j in range(lanes):
            error = u - now[j]
            x = u - dynamic[j] if error > static[j] else now[j]
            x = u + dynamic[j] if error < -static[j] else x
            now[j] = x
            out[k, j] = x
    return out


@kernel
def sliding_stems(op: Array, valves: Array) -> Array:
    """The sliding law: having broken away, the stem follows OP until OP stops or turns."""
    n, lanes = op.size, valves.shape[0]
    static, dynamic = _frictions(valves)
    now = valves[:, 2].copy()
    moving = np.zeros(lanes)
    out = np.empty((n, lanes))
    before = op[0]
    for k in range(n):
        u = op[k]
        change = u - before
        before = u
        for j in range(lanes):
            error = u - now[j]
            up = error > static[j] or (moving[j] > 0.0 and change > 0.0)
            down = error < -static[j] or (moving[j] < 0.0 and change < 0.0)
            x = u - dynamic[j] if up else now[j]
            x = u + dynamic[j] if down else x
            state = 1.0 if up else 0.0
            moving[j] = -1.0 if down else state
            now[j] = x
            out[k, j] = x
    return out


@kernel
def _with_turns(op: Array) -> Array:
    """OP ``(2 n,)`` with a value before each sample: the turn between the two, or their middle.

    OP turns between two samples where the lines through the two before and the two after meet there
    and go different ways.
    """
    n = op.size
    out = np.empty(2 * n)
    out[0] = out[1] = op[0]
    for k in range(1, n):
        before, now = op[k - 1], op[k]
        out[2 * k], out[2 * k + 1] = 0.5 * (before + now), now
        if k == 1 or k == n - 1:
            continue
        rise, fall = before - op[k - 2], op[k + 1] - now
        if rise * fall < 0.0:
            share = (now - fall - before) / (rise - fall)
            if 0.0 < share < 1.0:
                out[2 * k] = before + share * rise
    return out


@kernel
def step_stems(op: Array, valves: Array) -> Array:
    """He's law scanned faster than the record: slips of J, as many as OP asks for."""
    path, lanes = _with_turns(op), valves.shape[0]
    static, _ = _frictions(valves)
    now = valves[:, 2].copy()
    size = np.empty(lanes)
    for j in range(lanes):
        size[j] = max(valves[j, 1], 1e-3 * valves[j, 0])
    out = np.empty((op.size, lanes))
    for k in range(path.size):
        u, row = path[k], out[k // 2]
        for j in range(lanes):
            error = u - now[j]
            beyond = abs(error) - static[j]
            steps = math.floor(beyond / size[j]) + 1.0 if beyond > 0.0 else 0.0
            x = now[j] + (steps * size[j] if error > 0.0 else -steps * size[j])
            now[j] = x
            row[j] = x
    return out


@kernel
def sliding_between_stems(op: Array, valves: Array) -> Array:
    """The sliding law scanned faster than the record."""
    return sliding_stems(_with_turns(op), valves)[1::2].copy()


LAWS: MappingProxyType[str, Law] = MappingProxyType(
    {
        "he": he_stems,
        "sliding": sliding_stems,
        "steps": step_stems,
        "sliding-between": sliding_between_stems,
    }
)
"""The laws by name; the first one is searched first."""

BETWEEN = ("steps", "sliding-between")
"""Laws of a record that is slower than the scan: what OP did between two samples is a guess."""

NEEDS: MappingProxyType[str, str] = MappingProxyType({"sliding-between": "steps"})
"""Laws that are tried only where another one, named here, explains the window nearly as well as the
best: a record is slower than the scan or it is not."""


def stem_of(op: Array, law: str, valve: tuple[float, float, float]) -> Array:
    """The stem ``(n,)`` of one valve (S, J, x_0)."""
    return np.ascontiguousarray(LAWS[law](op, np.array([valve]))[:, 0])
