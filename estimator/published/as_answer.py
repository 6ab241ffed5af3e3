"""The paper's own methods as the answer of `identify`: valve and process theirs, verdict ours.

Source: Bacci di Capaci, Vaccari, Pannocchia and Scali (2018), section 3. The paper takes orders and
dead time as given; here they are those that the search chose.
"""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np

from estimator.criteria.one_step import choose_orders
from estimator.estimate import Estimate
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.outcomes import EstimatorError
from estimator.published.grid import grid_search
from estimator.published.nlp import nlp_paper, nlp_polish
from estimator.published.paper_fit import PaperFit
from estimator.result import Interval, Process
from estimator.window import Window

__all__ = ["METHODS", "published_estimate"]

METHODS = ("search", "nlp", "nlp-polish", "grid")
"""``search`` is ours; ``nlp`` and ``grid`` are the paper's, ``nlp-polish`` starts from ours."""

_STEP = 0.04
"""Step of the grid and of the starts as a share of OP's span: 0.5 in the paper's examples."""


def published_estimate(case: Case, window: Window, found: Hypothesis, method: str) -> Estimate:
    """What a method of the paper finds; it gives no intervals, so that these are unknown.

    Raises:
        EstimatorError: bad samples in the window, or CasADi is not installed.
    """
    if not window.good.all():
        raise EstimatorError(
            f"method {method!r} needs every sample and {int((~window.good).sum())} are bad or "
            f"missing: use method 'search', which masks them"
        )
    u = window.op_centre + window.op_span * window.u
    y = window.pv_centre + window.pv_scale * window.y
    orders = choose_orders(case, found.stem)
    na, nb, dead_time = orders.na, orders.nb, orders.dead_time
    step, period = _STEP * window.op_span, window.period
    if method == "grid":
        fit = grid_search(u, y, na=na, nb=nb, dead_time=dead_time, step=step, period=period)
    elif method == "nlp":
        fit = nlp_paper(u, y, na=na, nb=nb, dead_time=dead_time, step=step, period=period).best
    else:
        best, span = found.valve, window.op_span
        assert best is not None
        first = window.op_centre + span * float(found.stem[0])
        fit = nlp_polish(
            u,
            y,
            best.band * span,
            best.jump * span,
            na=na,
            nb=nb,
            dead_time=dead_time,
            stem0=first,
            period=period,
        ).best
    return _estimate(window, fit, orders.name)


def _estimate(window: Window, fit: PaperFit, name: str) -> Estimate:
    static, dynamic = fit.static_friction / window.op_span, fit.dynamic_friction / window.op_span
    model = fit.process
    parameters = {f"a{i}": value for i, value in enumerate(model.a, start=1)}
    parameters |= {f"b{i}": value for i, value in enumerate(model.b, start=1)}
    parameters |= {"offset": model.offset, "dead_time": model.dead_time * window.period}
    start = np.full(len(model.a), window.pv_centre + window.pv_scale * window.y[0])
    simulated = model.simulate(fit.stem, pv0=start)
    scaled = (simulated - window.pv_centre) / window.pv_scale
    return Estimate(
        criterion="arx",
        reason="the method of the paper, as asked",
        band=_alone(static + dynamic),
        jump=_alone(static - dynamic),
        static=_alone(static),
        dynamic=_alone(dynamic),
        stem=(fit.stem - window.op_centre) / window.op_span,
        simulated=scaled + float((window.y - scaled).mean()),
        process=Process(name, MappingProxyType(parameters), model.dead_time, _alone(model.gain)),
        model=model,
    )


def _alone(value: float) -> Interval:
    return Interval(value, math.nan, math.nan)
