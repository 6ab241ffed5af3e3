"""One hypothesis on the stem and what it believes to be wrong in the parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compensator.kernels import weighted_moments
from compensator.stem_tracking.friction import FrictionPrior

__all__ = ["ERRORS", "FRICTION", "GAIN", "LOAD", "Belief", "chances_of", "merge_alike"]

Array = NDArray[np.float64]

LOAD, FRICTION, GAIN = 0, 1, 2
ERRORS = 3


@dataclass(slots=True)
class Belief:
    """One hypothesis.

    Attributes:
        stem: position by the model's equations; direction: of its last slip (0: unknown).
        state: of the process at this scan, shape ``(n,)``.
        errors: ``(m, w, g)``: load, error of fD, relative error of the gain (`StemTracker`).
        noise: equation noise seen in this scan's PV, on its way into the next state.
        score: log-likelihood of what was seen, forgetting, plus ``prior``.
        prior: log-probability of the friction that is claimed; it is never forgotten.
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
    prior: float = 0.0
    survived: float = -math.inf
    tested: float = -math.inf
    way: float = 0.0
    turn: float = 0.0

    def stay(self, z: float, log_chance: float, friction: FrictionPrior) -> Belief:
        """Return the hypothesis that a command at ``z`` did not move the stem."""
        near = z > friction.nearest
        return Belief(
            self.stem,
            self.direction,
            self.state,
            self.errors.copy(),
            score=self.score + log_chance,
            prior=self.prior,
            survived=max(self.survived, z) if near else self.survived,
            tested=max(self.tested, z) if near else self.tested,
        )._charge(friction)

    def slip(
        self, stem: float, direction: float, log_chance: float, friction: FrictionPrior
    ) -> Belief:
        """Return the hypothesis that the stem slipped to ``stem``: the load takes up what the
        errors of fD and of the gain make of it.
        """
        way, turn = stem - self.stem, direction - self.direction
        load, wrong, gain = self.errors.tolist()
        return Belief(
            stem,
            direction,
            self.state,
            np.array([load + wrong * turn + gain * way, wrong, gain]),
            score=self.score + log_chance,
            prior=self.prior,
            survived=friction.kept * self.survived if self.survived > 0.0 else -math.inf,
            way=way,
            turn=turn,
        )._charge(friction)

    def see(self, evidence: float, keep: float) -> None:
        """Take in the log-likelihood of a PV, over that of the hypothesis which expected it best;
        ``keep`` is the share of the older evidence.
        """
        self.score = self.prior + keep * (self.score - self.prior) + evidence

    def _charge(self, friction: FrictionPrior) -> Belief:
        """Charge what is unlikely of the friction claimed, once."""
        prior = friction.price(self.survived)
        self.score += prior - self.prior
        self.prior = prior
        return self


def chances_of(beliefs: list[Belief]) -> list[float]:
    """Return how likely each hypothesis is; they sum up to 1."""
    best = max(h.score for h in beliefs)
    odds = [math.exp(h.score - best) for h in beliefs]
    total = math.fsum(odds)
    return [o / total for o in odds]


def merge_alike(beliefs: list[Belief]) -> tuple[list[Belief], dict[float, Array]]:
    """Merge hypotheses with the same stem position into one of the same mean and covariance.

    After a certain slip several hypotheses stand at one position, each with its own load. The
    likeliest goes on with the mean of state and errors and the score of all of them.

    Returns:
        The hypotheses, one for each position, and by position the spread of those that were
        merged, shape ``(n + ERRORS, n + ERRORS)``: what it adds to the covariance.
    """
    groups: dict[float, list[Belief]] = {}
    for h in beliefs:
        groups.setdefault(h.stem, []).append(h)
    merged: list[Belief] = []
    spreads: dict[float, Array] = {}
    for stem, group in groups.items():
        top = max(group, key=lambda h: h.score)
        merged.append(top)
        if len(group) == 1:
            continue
        weights = np.array([math.exp(h.score - top.score) for h in group])
        points = np.array([np.concatenate([h.state, h.errors]) for h in group])
        total, mean, spread = weighted_moments(points, weights)
        n = top.state.size
        top.state, top.errors = mean[:n].copy(), mean[n:].copy()
        top.score += math.log(total)
        spreads[stem] = spread
    return merged, spreads
