"""Valves that make the same moves fill a rectangle, and the best of them is found."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.published.paper_fit import ArxStructure, ArxWindow
from estimator.published.same_moves import MoveCell, best_with_same_moves
from estimator.valves import HeValve


def _moves(valve: HeValve, op: np.ndarray, stem0: float) -> np.ndarray:
    return np.flatnonzero(np.diff(valve.simulate(op, stem0), prepend=stem0))


@pytest.mark.parametrize("pair", [(4.5, 1.5), (3.0, 0.5), (2.0, 2.0 - 1e-6), (5.5, 0.2)])
def test_every_valve_of_a_cell_makes_the_same_moves(sticky_loop, pair):
    op = sticky_loop.op
    valve = HeValve(*pair)
    stem0 = float(op[0])
    stem = valve.simulate(op, stem0)
    cell = MoveCell.of(op, stem, stem0)
    assert cell.stick_band[0] <= pair[0] < cell.stick_band[1]
    assert cell.slip_jump[0] <= pair[1] < cell.slip_jump[1]
    expected = _moves(valve, op, stem0)
    first = expected[0]
    for a in (0.001, 0.5, 0.999):
        for b in (0.001, 0.5, 0.999):
            s = cell.stick_band[0] + a * (cell.stick_band[1] - cell.stick_band[0])
            j = cell.slip_jump[0] + b * (cell.slip_jump[1] - cell.slip_jump[0])
            if j > s:
                continue
            other = HeValve(s, j)
            # The cell speaks of what follows the first move: begin both valves just after it.
            begin = float(op[first]) - np.sign(op[first] - stem[first]) * other.dynamic_friction
            moves = first + 1 + _moves(other, op[first + 1 :], begin)
            np.testing.assert_array_equal(moves, expected[1:])


def test_the_best_with_the_same_moves_has_the_true_dynamic_friction(sticky_loop):
    op = sticky_loop.op
    stem = sticky_loop.valve.simulate(op, float(op[0]))
    window = ArxWindow.of(op, sticky_loop.process.simulate(stem), ArxStructure(2, 2))
    begun = window.fit(HeValve(4.5, 1.45), float(op[0]))
    best = best_with_same_moves(window, begun)
    assert best.dynamic_friction == pytest.approx(1.5, abs=1e-4)
    assert best.cost < 1e-6 * begun.cost


@pytest.mark.parametrize("pair", [(4.0, 1.0), (6.0, 6.0), (0.0, 0.0), (50.0, 1.0)])
def test_never_worse(sticky_loop, pair):
    window = ArxWindow.of(sticky_loop.op, sticky_loop.pv, ArxStructure(2, 2))
    begun = window.fit(HeValve(*pair), float(sticky_loop.op[0]))
    assert best_with_same_moves(window, begun).cost <= begun.cost
