"""Cells of a grid around an optimum of the search, zoomed to where the likelihood is.

Where the residuals are worth few samples the likelihood is wide and sets of slips are too many to
list. ``lead``, how far OP has to go until the first slip, takes the place of the first position
because the likelihood at a fixed lead changes slowly with J, and at a fixed position in spikes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator._kernels import Array, Mask
from estimator.candidate import Candidate
from estimator.posterior import Posterior

__all__ = ["FINE", "HARDLY", "ROUGH", "Nodes", "explore"]

_S, _J, _LEAD = range(3)
_LINE_PASSES = 3
_NEAR = 0.1
_FLOOR = 1e-4
_PASSES = 9
_DROP = 7.0
_SETTLED = 0.75


@dataclass(frozen=True, slots=True)
class Nodes:
    """How many: along a line and across it, in a box on the way and in the last one."""

    line: int
    across: int
    zoom: tuple[int, int, int]
    final: tuple[int, int, int]


FINE = Nodes(25, 3, (9, 7, 5), (17, 13, 5))
ROUGH = Nodes(15, 3, (7, 5, 3), (13, 9, 3))
HARDLY = Nodes(9, 2, (7, 3, 3), (9, 5, 3))
"""For a valve that sticks, for one that may not, and for one that follows OP."""

Evaluate = Callable[[Array], tuple[Array, Array]]
"""Nodes ``(m, 3)`` of S, J and lead to log-likelihood and gain, each ``(m,)``."""


def _at(
    evaluate: Evaluate, low: Array, high: Array, best: Array, counts: tuple[int, ...]
) -> Posterior:
    """Evaluate the nodes of a box, and ``best`` with them."""
    axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)]
    grid = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1)
    grid = np.vstack([grid, best])
    band, jump, lead = grid.T
    inside = (band > 0.0) & (jump <= band) & (lead >= 0.0) & (lead <= band + jump)
    inside[-1] = True
    grid = np.ascontiguousarray(grid[inside])
    log_likelihood, gain = evaluate(grid)
    # cells reach half a step each way; the optimum, which is no cell, has no volume
    half = 0.5 * (high - low) / (np.maximum(np.array(counts), 2) - 1)
    volume = np.full(grid.shape[0], float(np.prod(2.0 * half)))
    volume[-1] = 0.0
    ends = np.maximum(grid[:, :2] - half[:2], 0.0), grid[:, :2] + half[:2]
    return Posterior(grid, *ends, volume, log_likelihood, gain)


def explore(evaluate: Evaluate, best: Candidate, nodes: Nodes = FINE) -> Posterior:
    """Zoom in on the likelihood; ``best`` is where the search ended.

    The likelihood is narrow in S and in the lead, a fraction of OP's step per sample, and may be
    wide in J. So J is scanned first at the best S and lead, then those along with J; the box that
    holds what is alive is zoomed from there.
    """
    node = np.array([best.band, best.jump, best.lead])
    low, high = node.copy(), node.copy()
    low[_J], high[_J] = 0.0, node[_S]
    scan = _at(evaluate, low, high, node, (1, nodes.line, 1))
    node = scan.best
    low[_J], high[_J] = _alive(scan, _J, (high[_J] - low[_J]) / (nodes.line - 1))
    for axis in (_S, _LEAD, _S):
        reach = _NEAR * node[_S]
        low[axis], high[axis] = max(0.0, node[axis] - reach), node[axis] + reach
        for _ in range(_LINE_PASSES):
            counts = [1, nodes.across, 1]
            counts[axis] = nodes.line
            scan = _at(evaluate, low, high, node, (counts[0], counts[1], counts[2]))
            node = scan.best
            low[axis], high[axis] = _alive(scan, axis, (high[axis] - low[axis]) / (nodes.line - 1))
    margin = np.maximum(0.25 * (high - low), _FLOOR * node[_S])
    low, high = np.maximum(low - margin, 0.0), high + margin
    _, low, high = _zoomed(evaluate, low, high, node, nodes.zoom)
    return _at(evaluate, low, high, node, nodes.final)


def _alive(posterior: Posterior, axis: int, step: float) -> tuple[float, float]:
    """The part of an axis where the likelihood is, one step wider on either side."""
    top = posterior.log_likelihood.max()
    nodes = posterior.nodes[posterior.log_likelihood > top - _DROP, axis]
    return max(0.0, float(nodes.min()) - step), float(nodes.max()) + step


def _zoomed(
    evaluate: Evaluate, low: Array, high: Array, top: Array, counts: tuple[int, int, int]
) -> tuple[Posterior, Array, Array]:
    """Narrow the box until the likelihood fills it; return the last nodes and the next box."""
    posterior = _at(evaluate, low, high, top, counts)
    for _ in range(_PASSES):
        alive: Mask = posterior.log_likelihood > posterior.log_likelihood.max() - _DROP
        step = (high - low) / (np.array(counts) - 1)
        nodes = posterior.nodes[alive]
        new_low = np.maximum(nodes.min(axis=0) - step, 0.0)
        new_high = nodes.max(axis=0) + step
        settled = bool((new_high - new_low >= _SETTLED * (high - low)).all())
        low, high = new_low, new_high
        if settled:
            break
        posterior = _at(evaluate, low, high, posterior.best, counts)
    return posterior, low, high
