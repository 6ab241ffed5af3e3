"""The paper's criterion ``arx``: one-step-ahead errors of ARX(na, nb), equations (7)-(13).

The noise passes through the process's own poles (``A v = e``), so that everything but the valve is
linear least squares. The valve is that of the likelihood, moved to the optimum of this criterion;
orders and dead time by BIC.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from estimator.algebra import dot, order_of, solve_spd
from estimator.arrays import Array
from estimator.estimate import Estimate
from estimator.hypotheses.hypothesis import Case, Hypothesis, Valve
from estimator.intervals.posterior import Posterior, gap_of_no_law
from estimator.result import Interval, Process
from estimator.search.descent import moved_valves
from estimator.search.one_step import OneStep
from estimator.search.processes import spread_points
from estimator.window import Window
from loop_model import ProcessModel

__all__ = ["ArxOrders", "arx_estimate", "choose_orders"]

_REACH = (0.02, 0.1, 0.1)
_ROUNDS, _LANES = 8, 96
_NARROWER = 0.5
_LONGEST = 6


@dataclass(frozen=True, slots=True)
class ArxOrders:
    """Orders of an ARX model: ``na``, ``nb``, dead time in samples (one or more)."""

    na: int
    nb: int
    dead_time: int

    @property
    def name(self) -> str:
        """``arx(na,nb)``."""
        return f"arx({self.na},{self.nb})"


@dataclass(frozen=True, slots=True)
class _Fit:
    a: Array
    b: Array
    offset: float
    squares: float
    covariance: Array


def _fit(case: Case, stem: Array, orders: ArxOrders) -> _Fit:
    rows = case.rows
    y = rows.y
    past = [np.concatenate([np.zeros(i), y[:-i]]) for i in range(1, orders.na + 1)]
    moved = [
        np.concatenate([np.full(d, stem[0]), stem[: stem.size - d]])
        for d in range(orders.dead_time, orders.dead_time + orders.nb)
    ]
    design = np.stack([*past, *moved, np.ones(y.size)]) * rows.weight
    target = y * rows.weight
    gram = np.array([[dot(p, q) for q in design] for p in design])
    right = np.array([dot(p, target) for p in design])
    solution = solve_spd(gram, right)
    left = target - solution @ design
    squares = float(dot(left, left))
    size = len(solution)
    inverse = np.stack([solve_spd(gram, np.eye(size)[i]) for i in range(size)])
    na, nb = orders.na, orders.nb
    return _Fit(
        -solution[:na],
        solution[na : na + nb],
        float(solution[-1]),
        squares,
        inverse * squares / rows.count,
    )


def choose_orders(case: Case, stem: Array) -> ArxOrders:
    """Orders and dead time of the least BIC for a stem ``(n,)``."""
    n = case.rows.count
    best, found = math.inf, ArxOrders(2, 2, 1)
    longest = max(1, min(_LONGEST, case.max_dead_time - 3))
    for na in (1, 2, 3):
        for nb in range(1, na + 1):
            for dead_time in range(1, longest + 1):
                orders = ArxOrders(na, nb, dead_time)
                squares = _fit(case, stem, orders).squares
                bic = n * math.log(squares / n + case.rows.floor) + (na + nb + 2) * math.log(n)
                if bic < best - 1e-6:
                    best, found = bic, orders
    return found


def arx_estimate(
    case: Case, window: Window, best: Hypothesis, confidence: float, reason: str
) -> Estimate:
    """Valve and process under one-step-ahead errors."""
    assert best.valve is not None
    start = best.valve
    columns = case.rows.columns(integrating=False)
    ranking = OneStep(case.rows, columns)
    longest = max(1, min(_LONGEST, case.max_dead_time - 3))
    centre = np.array([start.band, start.jump, start.start])
    tables, costs = [np.zeros((1, 3))], []
    middle, reach = np.zeros(3), np.array(_REACH)
    costs.append(ranking.costs(moved_valves(centre, tables[0]), 1, longest)[0][:, 0])
    for _ in range(_ROUNDS):
        table = middle + reach * spread_points(_LANES, 3)
        cost = ranking.costs(moved_valves(centre, table), 1, longest)[0][:, 0]
        tables.append(table)
        costs.append(cost)
        every, all_costs = np.vstack(tables), np.concatenate(costs)
        middle = every[int(order_of(all_costs)[0])]
        reach = reach * _NARROWER
    n = case.rows.count
    samples = moved_valves(centre, every)
    finite = np.isfinite(all_costs)
    # a record without noise leaves nothing
    costs_left = np.maximum(all_costs, 1e-300)
    least = costs_left[finite].min() if finite.any() else 1.0
    log_like = np.where(finite, -0.5 * n * np.log(costs_left / least), -np.inf)
    weights = np.exp(log_like * case.settings.spreading.temper)
    # denser rounds hold more samples of the same volume
    density = np.repeat(
        [1.0, *(_NARROWER ** (3.0 * i) for i in range(_ROUNDS))],
        [1, *([_LANES] * _ROUNDS)],
    )
    weights *= density
    top = samples[int(order_of(all_costs)[0])]
    valve = Valve(float(top[0]), float(top[1]), float(top[2]), "he")
    gap = gap_of_no_law(case.settings.spreading, valve.band, 0.0)
    posterior = Posterior(samples, weights / weights.sum(), (gap,))
    stem = case.stem(valve)
    orders = choose_orders(case, stem)
    fit = _fit(case, stem, orders)
    model = _model(window, fit, orders)

    def interval(of_band: float, of_jump: float) -> Interval:
        value = of_band * valve.band + of_jump * valve.jump
        return posterior.interval(of_band, of_jump, confidence).within(0.0).around(value)

    start_pv = np.full(len(model.a), window.pv_centre + window.pv_scale * case.rows.y[0])
    simulated = model.simulate(window.op_centre + window.op_span * stem, pv0=start_pv)
    scaled = (simulated - window.pv_centre) / window.pv_scale
    parameters = {f"a{i}": v for i, v in enumerate(model.a, start=1)}
    parameters |= {f"b{i}": v for i, v in enumerate(model.b, start=1)}
    parameters |= {"offset": model.offset, "dead_time": model.dead_time * window.period}
    gain = Interval(model.gain, math.nan, math.nan)
    return Estimate(
        criterion="arx",
        reason=reason,
        band=interval(1.0, 0.0),
        jump=interval(0.0, 1.0),
        static=interval(0.5, 0.5),
        dynamic=interval(0.5, -0.5),
        stem=stem,
        simulated=scaled + float((case.rows.y - scaled).mean()),
        process=Process(orders.name, MappingProxyType(parameters), model.dead_time, gain),
        model=model,
        peaks=posterior.peaks(),
    )


def _model(window: Window, fit: _Fit, orders: ArxOrders) -> ProcessModel:
    steep = window.pv_scale / window.op_span
    b = fit.b * steep
    level = (1.0 + float(fit.a.sum())) * window.pv_centre
    return ProcessModel(
        a=tuple(float(v) for v in fit.a),
        b=tuple(float(v) for v in b),
        dead_time=orders.dead_time,
        offset=level + window.pv_scale * fit.offset - float(b.sum()) * window.op_centre,
        period=window.period,
    )
