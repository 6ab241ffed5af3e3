"""Valve stiction from OP and PV: arrays in, result out.

    from estimator import identify
    result = identify(op, pv, period=1.0)
    result.verdict, result.stick_band, result.reasons

A valve over many windows is followed by `track`. The paper's own methods stand beside the search:
its grid (`grid_search`), its optimisation as published (`nlp_paper`) and as a last polish
(`nlp_polish`); the last two need CasADi when they are called, ``pip install "fieldlink[nlp]"``.
`armax` fits a process with coloured noise to a stem that is known.
"""

from estimator.identify import identify
from estimator.monitoring.tracking import Track, track
from estimator.outcomes import EstimatorError, Reason, ReasonCode, Verdict
from estimator.processes.armax import ArmaxFit, ArmaxOrders, armax
from estimator.published.grid import grid_search
from estimator.published.nlp import nlp_paper, nlp_polish
from estimator.result import CostSurface, Identification, Interval
from estimator.warming import warm_up

__all__ = [
    "ArmaxFit",
    "ArmaxOrders",
    "CostSurface",
    "EstimatorError",
    "Identification",
    "Interval",
    "Reason",
    "ReasonCode",
    "Track",
    "Verdict",
    "armax",
    "grid_search",
    "identify",
    "nlp_paper",
    "nlp_polish",
    "track",
    "warm_up",
]
