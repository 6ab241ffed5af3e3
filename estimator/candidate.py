"""A valve and the process behind it: what a search hands on."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from estimator._kernels import Array
from estimator._slips import Op, slips
from estimator.structures import Structure

__all__ = ["Candidate", "first_apart", "stem_of"]

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Candidate:
    """A valve and a process, in units of OP's span and samples.

    Attributes:
        cost: residual sum of squares of the criterion that found it.
        band, jump: stick band S and slip jump J.
        lead: how far OP goes from its first sample until the first slip. It takes the place of the
            first stem position: at a fixed lead the slips of a cycling valve depend on S alone, so
            that the likelihood changes slowly with J, and at a fixed position in spikes.
        first: direction of the first slip, 1 upwards, -1 downwards.
        structure, dead_time: the process; its dead time in samples.
    """

    cost: float
    band: float
    jump: float
    lead: float
    first: float
    structure: Structure
    dead_time: int

    @classmethod
    def of_state(cls, state: Array) -> Candidate:
        """From the array that compiled searches work on."""
        cost, band, jump, lead, first, dead_time, slow, fast = (float(v) for v in state)
        return cls(cost, band, jump, lead, first, Structure(slow, fast), int(dead_time))

    def state(self, cost: float = np.inf) -> Array:
        """The array that compiled searches work on; ``cost`` is what is to be beaten."""
        poles = self.structure.slow, self.structure.fast
        valve = self.band, self.jump, self.lead, self.first
        return np.array([cost, *valve, float(self.dead_time), *poles])

    @property
    def valve(self) -> Array:
        """S, J, lead and first direction, shape ``(4,)``."""
        return np.array([self.band, self.jump, self.lead, self.first])

    def stem(self, op: Op) -> Array:
        """Its stem, shape ``(n,)``."""
        return stem_of(op, self.band, self.jump, self.lead, self.first)

    def anchored(self, op: Op) -> Candidate:
        """The same valve, its lead told by the slip that really comes first."""
        at, step = slips(op, self.band, self.jump, self.lead, self.first)
        if at.size == 0 or step[0] * self.first > 0.0:
            return self
        lead = self.band + self.jump - self.lead
        return Candidate(
            self.cost, self.band, self.jump, lead, -self.first, self.structure, self.dead_time
        )


def first_apart(ranked: Iterable[_T], count: int, apart: Callable[[_T, _T], bool]) -> list[_T]:
    """The first ones that are ``apart`` from all of those before them, at most ``count``."""
    found: list[_T] = []
    for one in ranked:
        if len(found) == count:
            break
        if all(apart(one, other) for other in found):
            found.append(one)
    return found


def stem_of(op: Op, band: float, jump: float, lead: float, first: float) -> Array:
    """Stem of one valve, shape ``(n,)``."""
    at, step = slips(op, band, jump, lead, first)
    moves = np.zeros(op.u.size)
    moves[at] = step
    start = op.u[0] - first * (0.5 * (band + jump) - lead)
    stem: Array = start + np.cumsum(moves)
    return stem
