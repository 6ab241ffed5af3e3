"""Published methods to detect or size valve stiction, written from their papers to compare with.

    finding = fit_curve(op, pv)          # He, Wang, Pottmann and Qin: triangle or sine?
    finding = judge_bicoherence(op, pv)  # Choudhury, Shah and Thornhill: nonlinear? ellipse's width
    finding = count_shapes(op, pv)       # Yamashita: how long does PV rest while OP moves?
    finding = find_stuck_intervals(op, pv)  # Kano et al., method A

All take samples of shape ``(n,)`` without gaps and return a `Finding`.
"""

from benchmarks.published.bicoherence import judge_bicoherence
from benchmarks.published.curve_fit import fit_curve
from benchmarks.published.finding import Finding
from benchmarks.published.shapes import count_shapes
from benchmarks.published.stuck_intervals import find_stuck_intervals

__all__ = ["Finding", "count_shapes", "find_stuck_intervals", "fit_curve", "judge_bicoherence"]
