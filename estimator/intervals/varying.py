"""The posterior of a valve whose friction is another one at every slip."""

from __future__ import annotations

import math

import numpy as np

from estimator.arrays import Array
from estimator.evidence.slip_frictions import LEAST_JUMP, VaryingFriction
from estimator.hypotheses.hypothesis import Case
from estimator.hypotheses.strokes import strokes_of
from estimator.intervals.posterior import Gap, Posterior
from estimator.search.descent import LEAST_BAND, turned_points

__all__ = ["gain_shares", "posterior_of_slips"]


def posterior_of_slips(case: Case, found: VaryingFriction) -> Posterior:
    """Means of static and dynamic friction, each known as well as its number of slips allows.

    Args:
        case: the window.
        found: the valve.
    """
    valve = found.hypothesis.valve
    assert valve is not None
    spreading = case.settings.spreading
    lanes = spreading.lanes
    slips = max(strokes_of(found.hypothesis.stem)[0].size, 1)
    static, dynamic = 0.5 * (valve.band + valve.jump), 0.5 * (valve.band - valve.jump)
    off = turned_points(lanes, 2, 0) / math.sqrt(slips)
    statics, dynamics = static + found.static * off[:, 0], dynamic + found.dynamic * off[:, 1]
    band = np.maximum(statics + dynamics, LEAST_BAND)
    jump = np.clip(statics - dynamics, LEAST_JUMP * band, band)
    samples = np.column_stack([band, jump, np.full(lanes, valve.start)])
    # what an early slip says of the mean is a law as well, and S may be off as where none holds
    off_band, off_jump = valve.band * spreading.law[1], valve.band * spreading.law_jump[1]
    gap = Gap(1.0, off_band, off_band, off_jump)
    return Posterior(samples, np.full(lanes, 1.0 / lanes), (gap,))


def gain_shares(found: VaryingFriction, posterior: Posterior) -> Array:
    """Gain beside each valve of a posterior over that of the likeliest, ``(m,)``.

    PV shows how large the slips are: the gain falls as J grows.
    """
    valve = found.hypothesis.valve
    assert valve is not None
    own = max(valve.jump, LEAST_JUMP * valve.band)
    shares: Array = own / posterior.samples[:, 1]
    return shares
