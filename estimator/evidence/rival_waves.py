"""An uneven wave beside a healthy valve that is likelier than a sticky one, however that slips.

A sticky valve moves its stem like a wave, and a wave whose turns are free explains much. So it
counts only where PV follows OP beside it as surely as a sticky valve is asked for before it is
believed in, and where the valve explains less even if its slips are of chance as the turns of the
wave are: late and off, or with a friction of their own each. Where it is likelier than the valve,
but not than the valve whose slips vary, either is possible.
"""

from __future__ import annotations

import math
from functools import cache

from estimator.evidence.effect import ANSWERED, loop_gain_of
from estimator.evidence.slip_frictions import is_beyond_slips, lead_of_slips
from estimator.evidence.uneven_waves import find_uneven_wave, find_wave_in_cycles
from estimator.evidence.varying_slips import likelihood_of_varying_slips
from estimator.hypotheses.gain import gain_deviations
from estimator.hypotheses.hypothesis import Case, Hypothesis
from estimator.search.all_laws import refine_all_laws

__all__ = ["find_rival_wave"]

_BEYOND_OUTLINED = 150.0
"""Evidence (nats) from which no wave is looked for that a load of steps and lines tells: it saves
time."""
_BEYOND_CYCLES = 600.0
"""The same of a wave that the cycles of OP and PV tell: of 34 simulated healthy valves under a
triangular load whose period wanders, or that enters at PV, the evidence reaches 573."""
_MOVED = 0.27
"""What `ANSWERED` is for a load of steps and lines, for a wave along cycles: beside a healthy valve
of those 34 the gain is 0.30 and more; beside sticky ones 0.02 to 0.25 but for one in forty."""
_WHOLE = 0.95
"""Share of good, measured samples of a record whose cycles tell: the tuning family's others have
0.9 at most."""


def find_rival_wave(
    case: Case, healthy: Hypothesis, sticky: Hypothesis
) -> tuple[Hypothesis | None, float]:
    """The healthy valve with the likeliest uneven wave that is a rival; None where there is none.

    And, where none is, by how many nats a valve whose slips vary is likelier than the likeliest
    wave that might be one; infinite where none might.

    Args:
        case: the window.
        healthy: the likeliest healthy valve so far.
        sticky: the likeliest sticky one.
    """
    ahead = math.inf
    # both kinds of waves ask for it, and it takes long
    varied = cache(lambda: likelihood_of_varying_slips(case, refine_all_laws(case, sticky)))
    evidence, threshold = sticky.likelihood - healthy.likelihood, case.settings.judging.threshold
    enough = sticky.likelihood + threshold
    for find, answered, beyond in (
        (find_wave_in_cycles, _MOVED, _BEYOND_CYCLES if _is_whole(case) else -math.inf),
        (find_uneven_wave, ANSWERED, _BEYOND_OUTLINED),
    ):
        if evidence >= beyond:
            continue
        loaded = find(case, sticky, enough)
        if loaded is None or not _may_rival(case, loaded, sticky, answered):
            continue
        lead = varied() - loaded.likelihood
        if lead < threshold:
            lead = max(lead, lead_of_slips(case, sticky, loaded))
        ahead = min(ahead, lead)
        if is_beyond_slips(case, ahead):
            return loaded, math.inf
    return None, ahead


def _is_whole(case: Case) -> bool:
    """Whether nearly all samples were measured and are good.

    Where OP is a guess between them so is the stem, and a free wave is always likelier.
    """
    rows = case.rows
    return min(rows.informed, rows.count / (rows.size - rows.first)) >= _WHOLE


def _may_rival(case: Case, loaded: Hypothesis, sticky: Hypothesis, answered: float) -> bool:
    """Whether a wave beside a healthy valve is likelier, and OP moves PV beside it."""
    if loaded.likelihood <= sticky.likelihood:
        return False
    if 0.5 * gain_deviations(case, loaded) ** 2 < case.settings.judging.threshold:
        return False
    return loop_gain_of(case, loaded) >= answered
