"""PV and OP that were stored some samples apart, and noise hides the controller's law.

A controller lets the noise that it sees through to OP. Between OP's moves and the error's there is
therefore a sharp match where the two belong together, and none a sample beside; what the process
answers, and what slow motions share, matches broadly.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.arrays import Array
from estimator.controller.fits import TIE
from estimator.controller.settings import READING, Reading
from estimator.window import carry_on

__all__ = ["find_shift", "shifted", "tell_shift"]

_AROUND = 1
"""Samples beyond the largest shift that are tried as well: a match at the end of the range may have
its peak outside."""


def find_shift(
    op: Array, pv: Array, sp: Array | None, action: float = 0.0, settings: Reading = READING
) -> int:
    """Samples by which PV is stored later than the OP that answers it.

    Negative where OP is stored later; 0 where they belong together, or no shift is far better than
    all others.

    Args:
        op, pv, sp: ``(n,)`` each, NaN where bad.
        action: 1 for a controller that is known to be reverse acting, -1 for a direct one, 0 for
            one of which nothing is known: it must show integral action then, as PV that answers OP
            at once does not.
        settings: see `estimator.controller.settings`.
    """
    target = None if sp is None else carry_on(sp)
    target = np.zeros(pv.size) if target is None else target
    furthest = settings.shifts + _AROUND
    left = {
        by: _left_over(shifted(op, -by), target - shifted(pv, by), action, settings.integral)
        for by in range(-furthest, furthest + 1)
    }
    best = min(left, key=lambda by: left[by])
    second = min(value for by, value in left.items() if by != best)
    if abs(best) > settings.shifts or not second > settings.sharp * left[best]:
        return 0
    return best


def shifted(signal: Array, by: int) -> Array:
    """The signal ``(n,)`` moved forward by some samples, NaN where nothing is known."""
    return signal if by <= 0 else np.append(signal[by:], np.full(by, np.nan))


def tell_shift(late: int) -> tuple[str, ...]:
    """That PV was moved forward by ``late`` samples, or OP where that is negative; empty at 0."""
    if late == 0:
        return ()
    one, other = ("PV", "the OP that answers it") if late > 0 else ("OP", "the PV that it answers")
    by = "1 sample" if abs(late) == 1 else f"{abs(late)} samples"
    return (f"{one} is recorded {by} after {other}: it is judged as if {by} earlier",)


def _left_over(op: Array, error: Array, action: float, integral: float) -> float:
    """Share of OP's moves that proportional and integral action leave; 1 without a sensible one."""
    moves, steps, levels = np.diff(op), np.diff(error), error[1:]
    good = np.isfinite(moves) & np.isfinite(steps)
    if not good.any():
        return 1.0
    moves, steps, levels = (one[good] - one[good].mean() for one in (moves, steps, levels))
    whole = float(moves @ moves)
    gram = np.array([[steps @ steps, steps @ levels], [steps @ levels, levels @ levels]])
    if not whole > 0.0 or not np.linalg.det(gram) > 1e-12 * gram[0, 0] * gram[1, 1]:
        return 1.0
    towards = np.array([steps @ moves, levels @ moves])
    gains = np.linalg.solve(gram, towards)
    # PV that answers OP at once pulls them apart, or against what the controller does
    if gains[0] * gains[1] < 0.0 or gains[0] * action < 0.0:
        return 1.0
    rest = max(whole - float(gains @ towards), TIE * whole)
    alone = whole - towards[0] ** 2 / gram[0, 0]
    if action == 0.0 and 0.5 * moves.size * math.log(alone / rest) < integral:
        return 1.0
    return rest / whole
