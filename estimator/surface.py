"""The cost over (S, J), for a picture."""

from __future__ import annotations

from itertools import product

import numpy as np

from estimator._simulated import simulated_costs
from estimator._slips import Op
from estimator.candidate import Candidate
from estimator.regression import Regression
from estimator.result import CostSurface
from estimator.window import Window

__all__ = ["cost_surface"]

_NODES = 25
_WIDEST = 1.1
"""Widest S and J, as shares of OP's span."""
_EACH = 4
"""Stick bands and slip jumps that are tried in a cell, each."""
_LEADS = np.linspace(0.1, 1.0, 10)


def cost_surface(window: Window, op: Op, regression: Regression, best: Candidate) -> CostSurface:
    """Least simulation cost of each cell over (S, J), with the process of ``best``.

    The optimum is a needle that no map resolves: several valves of a cell are tried, ``best`` in
    its own.
    """
    nodes = np.linspace(0.0, _WIDEST, _NODES)
    tables = regression.tables(best.structure)
    cost = np.full((_NODES, _NODES), np.inf)

    def look(valves: np.ndarray, first: float) -> None:
        found = simulated_costs(op, tables, valves, first, best.dead_time, 1)[0][0]
        cell = np.rint(valves[:, :2] / nodes[1]).astype(int)
        np.minimum.at(cost, (cell[:, 0], cell[:, 1]), found)

    within = ((np.arange(_EACH) + 0.5) / _EACH - 0.5) * nodes[1]
    fine = (nodes[:, None] + within).ravel()
    band, jump = (grid.ravel() for grid in np.meshgrid(fine, fine, indexing="ij"))
    inside = (band > 0.0) & (jump >= 0.0) & (jump <= band)
    band, jump = band[inside], jump[inside]
    for first, lead in product((-1.0, 1.0), _LEADS):
        look(np.ascontiguousarray(np.stack([band, jump, lead * band], axis=1)), first)
    own = np.array([[best.band, best.jump, best.lead]])
    if best.band < _WIDEST:
        look(own, best.first)
    cost[np.isinf(cost)] = np.nan
    return CostSurface(
        nodes[1:] * window.op_span, nodes * window.op_span, cost[1:] / regression.total
    )
