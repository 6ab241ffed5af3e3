"""One hypothesis on the stem and what it believes to be wrong in the parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ERRORS", "FRICTION", "GAIN", "LOAD", "Belief", "chance_of_rest"]

Array = NDArray[np.float64]

LOAD, FRICTION, GAIN = 0, 1, 2
ERRORS = 3

_DOUBT = 0.05
_DOUBTFUL = 4.0
_KEPT_TESTS = 0.95


@dataclass(slots=True)
class Belief:
    """One hypothesis.

    Attributes:
        stem: position by the model's equations; direction: of its last slip (0: unknown).
        state: of the process at this scan, shape ``(n,)``.
        errors: ``(m, w, g)``: load, error of fD, relative error of the gain (`StemTracker`).
        noise: equation noise seen in this scan's PV, on its way into the next state.
        score: log-likelihood, forgetting.
        survived: largest command withstood, in deviations of the static friction around fS (minus
            infinity: none near it); a slip lets it fade, because friction varies.
        tested: the same since the last slip.
        way, turn: of this scan's slip, in position and in direction.
    """

    stem: float
    direction: float
    state: Array
    errors: Array
    noise: float = 0.0
    score: float = 0.0
    survived: float = -math.inf
    tested: float = -math.inf
    way: float = 0.0
    turn: float = 0.0

    def stay(self, z: float, log_chance: float) -> Belief:
        """Return the hypothesis that a command at ``z`` did not move the stem."""
        near = z > -4.0
        return Belief(
            self.stem,
            self.direction,
            self.state,
            self.errors.copy(),
            score=self.score + log_chance,
            survived=max(self.survived, z) if near else self.survived,
            tested=max(self.tested, z) if near else self.tested,
        )

    def slip(self, stem: float, direction: float, log_chance: float) -> Belief:
        """Return the hypothesis that the stem slipped to ``stem``: the load takes up what the
        errors of fD and of the gain make of it.
        """
        way, turn = stem - self.stem, direction - self.direction
        load, friction, gain = self.errors.tolist()
        return Belief(
            stem,
            direction,
            self.state,
            np.array([load + friction * turn + gain * way, friction, gain]),
            score=self.score + log_chance,
            survived=_KEPT_TESTS * self.survived if self.survived > 0.0 else -math.inf,
            way=way,
            turn=turn,
        )


def _tail(z: float) -> float:
    """Return the probability that the static friction lies more than ``z`` deviations above fS.

    Normal, but one time in twenty the parameters are worse than they say: a command well above fS
    may have missed.
    """

    def normal(at: float) -> float:
        return 0.5 * math.erfc(at / math.sqrt(2.0))

    return (1.0 - _DOUBT) * normal(z) + _DOUBT * normal(z / _DOUBTFUL)


def chance_of_rest(z: float, tested: float) -> float:
    """Return the probability that the stem withstands a command at ``z``, having withstood
    ``tested`` since it slipped last.
    """
    if z <= tested:
        return 1.0
    withstood = _tail(tested)
    return min(1.0, _tail(z) / withstood) if withstood > 0.0 else 1.0
