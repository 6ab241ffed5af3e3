"""Healthy against sticky valve: both made as likely as they can be, with the same freedom.

What one hypothesis finds out about process, noise or disturbances is offered to the other, in turn,
until neither becomes likelier: otherwise the one that was searched last would win.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimator.evidence.effect import ANSWERED, loop_gain_of
from estimator.evidence.growing import add_best, fit_repeating, fit_waves
from estimator.evidence.periodic_loads import fit_entering_load, fit_periodic_load
from estimator.evidence.piecewise_loads import fit_piecewise_loads
from estimator.evidence.rival_waves import find_rival_wave
from estimator.evidence.slip_frictions import (
    VaryingFriction,
    find_varying_friction,
    is_beyond_slips,
    lead_of_slips,
)
from estimator.evidence.uneven_waves import refit_uneven_wave
from estimator.hypotheses.gain import gain_deviations
from estimator.hypotheses.hypothesis import Case, Hypothesis, likelier
from estimator.hypotheses.noise import DRIFT, WHITE
from estimator.hypotheses.periodic_load import PeriodicLoad
from estimator.processes.poles import COARSE
from estimator.search.all_laws import refine_all_laws
from estimator.search.descent import refine_valve
from estimator.search.effort import wider
from estimator.search.processes import polish, settle
from estimator.search.sweep import sweep_valves
from estimator.search.valves import find_valves

__all__ = ["Weighing", "fit_healthy", "weigh", "with_varying_friction"]

_PAYS = 0.5
"""Nats that a nuisance must gain beyond its price."""
_CLEAR = -8.0
"""Evidence (nats) below which a sticky valve is given up at once if nothing from outside pays."""
_BEYOND_DOUBT = 150.0
"""Evidence (nats) from which no rectangular load is looked for, nor one that enters elsewhere: it
saves their time. Simulated healthy valves under a rectangular one reach 63; of 410, most under an
uneven wave, four lie beyond, as 108 of 250 sticky ones of the tuning family."""
_BEYOND_ANY_LOAD = 250.0
"""The same for a load of steps and straight lines."""
_HOPE = 150.0
"""Nats that the process may still gain beside a wave of any shape: simulated healthy valves under
one gain up to 100."""
_NEAR = 50.0
"""Nats that process and corners may still gain, fitted in turn with a load of steps and lines:
simulated healthy valves under one gain up to 60, and the load is then far likelier anyway."""
_CLOSE = -2.0
"""Evidence (nats) from which a valve is swept for once more (tuning family: of 59 windows between
this and `_CLEAR` that were swept, none became a sticky valve)."""
_TRIED = 4
"""Valves weighed in a second search: which is the likeliest hangs on what else moves PV."""
_ANOTHER = 0.05
"""Stick bands that differ by more, as a share, are different valves."""


@dataclass(frozen=True, slots=True)
class Weighing:
    """The two hypotheses at their best."""

    healthy: Hypothesis
    sticky: Hypothesis | None
    """The likeliest valve of the laws that were searched."""
    laws: tuple[Hypothesis, ...] = ()
    """The sticky valve under every law that was tried, the likeliest first, then other valves of
    the search: for the estimate and its intervals."""
    over_waves: float = np.inf
    """By how many nats a valve whose slips vary is likelier than a load of any shape from outside,
    an uneven wave or steps and lines; infinite where none is a rival of the valve, or where one is
    taken up."""
    varying: VaryingFriction | None = None
    """The sticky valve whose friction is another one at every slip, where that explains more."""

    @property
    def best(self) -> Hypothesis:
        """What the valve is described by: the likeliest law, or friction that varies."""
        return self.laws[0] if self.varying is None else self.varying.hypothesis

    @property
    def evidence(self) -> float:
        """Log Bayes factor of the sticky over the healthy valve, in nats, penalties included."""
        if self.sticky is None:
            return -np.inf
        return float(self.sticky.likelihood - self.healthy.likelihood)


def weigh(case: Case) -> Weighing:
    """Fit both hypotheses of a window, each as likely as it can be."""
    plain = fit_healthy(case)
    valves = find_valves(case, plain)
    if not valves:
        return Weighing(plain, None)
    sticky = valves[0]
    hopeless = sticky.likelihood - plain.likelihood < _CLEAR
    if hopeless and _grown(case, plain, sticky, most=1) is plain:
        return Weighing(plain, sticky, (sticky,))
    healthy, sticky, over_waves = _weighed(case, plain, valves[0])
    if _is_doubtful(case, healthy, sticky):
        healthy, sticky = _looked_again(case, plain, valves[0], healthy, sticky)
    judging = case.settings.judging
    laws: tuple[Hypothesis, ...] = (sticky,)
    if sticky.likelihood - healthy.likelihood > judging.threshold - judging.close:
        laws = (*refine_all_laws(case, sticky), *_others(sticky, valves))
    return Weighing(healthy, sticky, laws, over_waves)


def with_varying_friction(case: Case, weighing: Weighing) -> Weighing:
    """The same, the valve described by friction that varies where it sticks and that explains more.

    The evidence stays that of the laws: a stem that may slip anywhere explains spikes as well.
    """
    if weighing.evidence < case.settings.judging.threshold:
        return weighing
    return replace(weighing, varying=find_varying_friction(case, weighing.laws[0]))


def _weighed(
    case: Case, healthy: Hypothesis, sticky: Hypothesis, *, waves: bool = True
) -> tuple[Hypothesis, Hypothesis, float]:
    """Both hypotheses with what pays of disturbances, exchanged until neither becomes likelier.

    Uneven waves are among them if asked for; the last is `Weighing.over_waves`.
    """
    over_waves = np.inf
    healthy, sticky = _settled(case, healthy, sticky)
    grown_healthy = _grown(case, healthy, sticky)
    if sticky.likelihood - grown_healthy.likelihood > _CLEAR:
        joint = fit_waves(case, healthy)
        if joint is not None:
            grown_healthy = likelier(grown_healthy, _grown(case, joint, sticky))
    grown_sticky = _grown(case, sticky, healthy)
    alone = sticky
    healthy, sticky = _exchanged(case, grown_healthy, sticky, grown_sticky)
    if sticky.likelihood - healthy.likelihood > _CLEAR:
        loaded = fit_periodic_load(case, (healthy, sticky, alone))
        healthy, sticky = _beside_load(case, healthy, sticky, loaded)
    for fit in (_rectangular, _repeating):
        if 0.0 < sticky.likelihood - healthy.likelihood < _BEYOND_DOUBT:
            loaded = fit(case, healthy, sticky)
            if loaded is not None and _rivals(case, loaded, sticky):
                healthy, sticky = _beside_load(case, healthy, sticky, loaded)
    if 0.0 < sticky.likelihood - healthy.likelihood < _BEYOND_ANY_LOAD:
        healthy, sticky, over_waves = _beside_lines(case, healthy, sticky)
    if waves and sticky.likelihood > healthy.likelihood:
        healthy, sticky, over_waves = _beside_wave(case, healthy, sticky, over_waves)
    if sticky.likelihood - healthy.likelihood > _CLOSE:
        sticky = _with_any_process(case, sweep_valves(case, sticky))
    return healthy, sticky, over_waves


def _rectangular(case: Case, healthy: Hypothesis, sticky: Hypothesis) -> Hypothesis | None:
    """The healthy valve with a rectangular load."""
    return fit_periodic_load(case, (healthy, sticky), square=True)


def _repeating(case: Case, healthy: Hypothesis, sticky: Hypothesis) -> Hypothesis | None:
    """The healthy valve with a load that repeats itself and may enter elsewhere than at the valve.

    A triangular one through its own lag, or one of any shape: where few harmonics tell it, the
    first is likelier, where it has another shape the second.
    """
    found = [
        fit_entering_load(case, healthy),
        fit_repeating(case, healthy, sticky.likelihood - _HOPE),
    ]
    loaded = [one for one in found if one is not None]
    return max(loaded, key=lambda one: one.likelihood, default=None)


def _beside_lines(
    case: Case, healthy: Hypothesis, sticky: Hypothesis
) -> tuple[Hypothesis, Hypothesis, float]:
    """Both hypotheses with a load of steps and lines, where one pays; `Weighing.over_waves`."""
    found = fit_piecewise_loads(case, (healthy, sticky), sticky.likelihood - _NEAR)
    # the likeliest alone: where OP does nothing beside it, a less likely one is no other load
    if not found or not _rivals(case, found[0], sticky) or not _is_answered(case, found[0]):
        return healthy, sticky, np.inf
    loaded = found[0]
    if loaded.likelihood <= healthy.likelihood + _PAYS:
        return healthy, sticky, np.inf
    if loaded.likelihood > sticky.likelihood:
        ahead = lead_of_slips(case, sticky, loaded)
        if not is_beyond_slips(case, ahead):
            return healthy, sticky, ahead
    sticky = _with_own_lines(case, sticky)
    healthy, sticky = _beside_load(case, healthy, sticky, loaded)
    return healthy, _with_own_lines(case, sticky), np.inf


def _with_own_lines(case: Case, sticky: Hypothesis) -> Hypothesis:
    """The sticky valve with a load of its own in place of what was found beside a healthy one."""
    for own in fit_piecewise_loads(case, (sticky,), sticky.likelihood - _NEAR, valve=True):
        sticky = likelier(sticky, refine_valve(case, own))
    return sticky


def _beside_wave(
    case: Case, healthy: Hypothesis, sticky: Hypothesis, over_lines: float
) -> tuple[Hypothesis, Hypothesis, float]:
    """Both hypotheses with a load that swings unevenly, where one pays; `Weighing.over_waves`."""
    loaded, over_waves = find_rival_wave(case, healthy, sticky)
    if loaded is None:
        return healthy, sticky, min(over_lines, over_waves)
    healthy, sticky = _beside_load(case, healthy, sticky, loaded)
    own = _with_own_wave(case, sticky, healthy)
    if own is sticky:
        return healthy, sticky, over_waves
    exchanged = polish(case, None, own, own.nuisances, own.taps, wide=False)
    again = refit_uneven_wave(case, exchanged, own, healthy.likelihood)
    return healthy if again is None else likelier(healthy, again), own, over_waves


def _with_own_wave(case: Case, sticky: Hypothesis, loaded: Hypothesis) -> Hypothesis:
    """The sticky valve with a wave of its own in place of what was found beside a healthy one."""
    own = refit_uneven_wave(case, sticky, loaded, sticky.likelihood)
    return sticky if own is None else likelier(sticky, refine_valve(case, own))


def _beside_load(
    case: Case, healthy: Hypothesis, sticky: Hypothesis, loaded: Hypothesis | None
) -> tuple[Hypothesis, Hypothesis]:
    """Both hypotheses, with a load that was found beside a healthy valve if it pays."""
    if loaded is None or loaded.likelihood <= healthy.likelihood + _PAYS:
        return healthy, sticky
    loaded = _grown(case, loaded, sticky)
    healthy, sticky = _exchanged(case, loaded, sticky, sticky, spare=True)
    if any(isinstance(one, PeriodicLoad) for one in sticky.nuisances):
        sticky = likelier(sticky, _grown_anew(case, sticky, healthy))
    return healthy, sticky


def _rivals(case: Case, loaded: Hypothesis, sticky: Hypothesis) -> bool:
    """Whether a load beside a healthy valve may be what a sticky valve looks like.

    The stem of a sticky valve is nearly such a load itself, beside which PV follows OP no more; and
    a load that leaves the sticky valve as clear as it was explains something else.
    """
    judging = case.settings.judging
    if loaded.likelihood <= sticky.likelihood - judging.threshold - judging.close:
        return False
    return 0.5 * gain_deviations(case, loaded) ** 2 >= judging.process


def _is_answered(case: Case, loaded: Hypothesis) -> bool:
    """Whether OP moves PV beside a load that stays: a controller answers until PV is back.

    Slips of a stem are steps too, and OP moves PV by nothing until the next one.
    """
    return loop_gain_of(case, loaded) >= ANSWERED


def _grown_anew(case: Case, sticky: Hypothesis, healthy: Hypothesis) -> Hypothesis:
    """The valve with what pays beside it, from nothing: it was found beside another's load."""
    alone = polish(case, sticky.valve, sticky, (), sticky.taps, wide=False)
    return _grown(case, refine_valve(case, alone), healthy)


def _exchanged(
    case: Case,
    grown_healthy: Hypothesis,
    sticky: Hypothesis,
    grown_sticky: Hypothesis,
    *,
    spare: bool = False,
) -> tuple[Hypothesis, Hypothesis]:
    """Both hypotheses, each with what the other has found, if that makes it likelier.

    With ``spare`` no other valve is looked for where the sticky one is clear.
    """
    known = grown_healthy.nuisances
    if known:
        clear = grown_sticky.likelihood > grown_healthy.likelihood + case.settings.searching.ahead
        if not (clear and spare):
            again = find_valves(case, grown_healthy, known, by_simulation=not clear)
            grown_sticky = likelier(grown_sticky, again[0]) if again else grown_sticky
        exchanged = polish(case, sticky.valve, sticky, known, grown_healthy.taps, wide=False)
        grown_sticky = likelier(grown_sticky, refine_valve(case, exchanged))
    exchanged = polish(
        case, None, grown_sticky, grown_sticky.nuisances, grown_sticky.taps, passes=3, wide=True
    )
    grown_healthy = likelier(grown_healthy, exchanged)
    healthy, sticky = grown_healthy, grown_sticky
    if healthy.nuisances or sticky.nuisances:
        healthy, sticky = _settled(case, healthy, sticky)
    return healthy, sticky


def _is_doubtful(case: Case, healthy: Hypothesis, sticky: Hypothesis) -> bool:
    """Whether a valve that the search may have missed would change the answer.

    Where none is as likely as a healthy one there is hardly ever one (tuning family).
    """
    judging = case.settings.judging
    evidence = sticky.likelihood - healthy.likelihood
    return 0.0 < evidence < judging.threshold + judging.close


def _looked_again(
    case: Case, plain: Hypothesis, known: Hypothesis, healthy: Hypothesis, sticky: Hypothesis
) -> tuple[Hypothesis, Hypothesis]:
    """Both hypotheses after a second search for valves with more effort.

    Most windows are clear without it: it is spent where the answer hangs on it. The valve that is
    ``known`` was weighed already.
    """
    settings = replace(case.settings, searching=wider(case.settings.searching))
    again = replace(case, settings=settings)
    valves = find_valves(again, plain)
    if not valves:
        return healthy, sticky
    for valve in (valves[0], *_others(valves[0], valves))[:_TRIED]:
        if not _others(known, (valve,)) and valve.likelihood < known.likelihood + _PAYS:
            continue
        other, better, _ = _weighed(again, plain, valve, waves=False)
        healthy, sticky = likelier(healthy, other), likelier(sticky, better)
        if not _is_doubtful(case, healthy, sticky):
            break
    return healthy, sticky


def fit_healthy(case: Case) -> Hypothesis:
    """The healthy valve with the likelier of two kinds of noise, nothing from outside."""
    first, second = (
        polish(case, None, (COARSE[3], 1), (), taps, passes=2) for taps in (WHITE, DRIFT)
    )
    return likelier(first, second)


def _settled(case: Case, healthy: Hypothesis, sticky: Hypothesis) -> tuple[Hypothesis, Hypothesis]:
    """Free the poles, then try the healthy valve with the sticky one's process and noise."""
    sticky = refine_valve(case, settle(case, sticky), 0.02)
    healthy = settle(case, healthy)
    exchanged = polish(case, None, sticky, sticky.nuisances, sticky.taps, passes=2, wide=False)
    return likelier(healthy, exchanged), sticky


def _with_any_process(case: Case, sticky: Hypothesis) -> Hypothesis:
    """The valve with the likeliest of all starting processes, swept again where one is likelier."""
    other = settle(case, polish(case, sticky.valve, sticky, sticky.nuisances, sticky.taps))
    if other.likelihood < sticky.likelihood + _PAYS:
        return sticky
    return sweep_valves(case, refine_valve(case, other))


def _grown(case: Case, start: Hypothesis, other: Hypothesis, most: int | None = None) -> Hypothesis:
    """The hypothesis with nuisances as long as they pay, at most so many: all, unless given."""
    best = start
    for _ in range(most or case.settings.modelling.max_sinusoids + 1):
        more = add_best(case, best, other)
        if more is None or more.likelihood <= best.likelihood + _PAYS:
            break
        more = polish(case, more.valve, more, more.nuisances, more.taps, passes=1, wide=False)
        if more.valve is not None:
            more = refine_valve(case, more, 0.03)
        if more.likelihood <= best.likelihood:
            break
        best = more
    return best


def _others(sticky: Hypothesis, valves: tuple[Hypothesis, ...]) -> tuple[Hypothesis, ...]:
    """Valves of the search with another stick band: S trades against the dead time."""
    assert sticky.valve is not None
    band = sticky.valve.band
    return tuple(
        one
        for one in valves
        if one.valve is not None
        and abs(one.valve.band - band) > _ANOTHER * max(one.valve.band, band)
    )
