"""The cost over (S, J), for a picture."""

from __future__ import annotations

import numpy as np

from estimator.arrays import Array
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.processes.poles import coefficients
from estimator.result import CostSurface
from estimator.valves.laws import LAWS
from estimator.window import Window

__all__ = ["cost_surface"]

_NODES = 25
_WIDEST = 1.1
"""Widest S and J, as shares of OP's span."""
_EACH = 3
"""Stick bands and slip jumps that are tried in a cell, each."""
_STARTS = (-0.9, -0.3, 0.3, 0.9)
_BLOCK = 32


def cost_surface(case: Case, window: Window, best: Hypothesis) -> CostSurface:
    """Least innovations of each cell over (S, J), with process and noise of ``best``.

    The optimum is a needle that no map resolves: several valves of a cell are tried, ``best`` in
    its own.
    """
    assert best.valve is not None
    nodes = np.linspace(0.0, _WIDEST, _NODES)
    cost = np.full((_NODES, _NODES), np.inf)
    within = ((np.arange(_EACH) + 0.5) / _EACH - 0.5) * nodes[1]
    fine = (nodes[:, None] + within).ravel()
    band, jump = (grid.ravel() for grid in np.meshgrid(fine, fine, indexing="ij"))
    inside = (band > 0.0) & (jump >= 0.0) & (jump <= band)
    pairs = np.stack([band[inside], jump[inside]], axis=1)
    friction = 0.5 * pairs.sum(axis=1)
    first = case.rows.u[0]
    table = np.vstack(
        [np.column_stack([pairs, first + share * friction]) for share in _STARTS]
        + [np.array([[best.valve.band, best.valve.jump, best.valve.start]])]
    )
    design = case.design(best.nuisances, best.taps, best.stem, best.poles, best.dead_time)
    row = np.array([[best.poles.slow, best.poles.fast, best.poles.third]])
    process = coefficients(best.poles.shape, row)
    for begin in range(0, len(table), _BLOCK):
        valves: Array = np.ascontiguousarray(table[begin : begin + _BLOCK])
        stems = LAWS[best.valve.law](case.rows.u, valves)
        lanes = np.repeat(process, len(valves), axis=1)
        found = design.paired(stems, lanes, best.dead_time, 1)[0]
        cell = np.rint(valves[:, :2] / nodes[1]).astype(int)
        for (i, j), value in zip(cell, found, strict=True):
            if i < _NODES and j < _NODES:
                cost[i, j] = min(cost[i, j], value)
    cost[np.isinf(cost)] = np.nan
    return CostSurface(
        nodes[1:] * window.op_span, nodes * window.op_span, cost[1:] / case.rows.count
    )
