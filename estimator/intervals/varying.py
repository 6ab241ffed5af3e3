"""The posterior of a valve whose friction is another one at every slip."""

from __future__ import annotations

import math

import numpy as np

from estimator.evidence.slip_frictions import VaryingFriction
from estimator.hypotheses.hypothesis import Case
from estimator.hypotheses.strokes import strokes_of
from estimator.intervals.posterior import Gap, Posterior
from estimator.search.descent import turned_points

__all__ = ["posterior_of_slips"]

_LANES = 128
"""Samples: as many as one round of the sampler of laws."""
_LEAST_JUMP = 0.03
"""J as a share of S below which PV does not tell it from none."""


def posterior_of_slips(case: Case, found: VaryingFriction) -> Posterior:
    """Means of static and dynamic friction, each known as well as its number of slips allows.

    Args:
        case: the window.
        found: the valve.
    """
    valve = found.hypothesis.valve
    assert valve is not None
    slips = max(strokes_of(found.hypothesis.stem)[0].size, 1)
    static, dynamic = 0.5 * (valve.band + valve.jump), 0.5 * (valve.band - valve.jump)
    off = turned_points(_LANES, 2, 0) / math.sqrt(slips)
    statics, dynamics = static + found.static * off[:, 0], dynamic + found.dynamic * off[:, 1]
    band = statics + dynamics
    jump = np.clip(statics - dynamics, _LEAST_JUMP * band, band)
    samples = np.column_stack([band, jump, np.full(_LANES, valve.start)])
    # what an early slip says of the mean is a law as well, and S may be off as where none holds
    spreading = case.settings.spreading
    off_band, off_jump = valve.band * spreading.law[1], valve.band * spreading.law_jump[1]
    gap = Gap(1.0, off_band, off_band, off_jump)
    return Posterior(samples, np.full(_LANES, 1.0 / _LANES), (gap,))
