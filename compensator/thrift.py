"""Travel is worth a price while PV is good enough: what the loop travelled before is known.

PV and travel can be bought with each other. A level has to go to and fro between two positions for
ever, a wrong model corrects again and again: there the price of a move decides on both. It rises as
long as the stem travels more than its share of before with PV well below what it was, and falls as
soon as PV is not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from compensator.action import CompensatorError, require_positive

__all__ = ["Thrift", "ThriftSettings"]


@dataclass(frozen=True, slots=True)
class ThriftSettings:
    """Settings of `Thrift`.

    Attributes:
        travel: share of the travel before compensation that needs no thrift.
        deviation: share of PV's deviation before above which PV has precedence: below the half
            that compensation promises.
        memory: scans at least over which travel and deviation are averaged, otherwise the
            planner's horizon.
        rise: growth of the price in one memory, as a natural logarithm: fourfold.
        most: factor of the price at most. The square root of it is the factor of the error that is
            worth a move.
        stepped: change of the set-point, in PV's deviations before, that counts as a step: the way
            to the new set-point is no error, and what it takes of travel none to save.
    """

    travel: float = 0.6
    deviation: float = 0.4
    memory: int = 100
    rise: float = 1.4
    most: float = 10.0
    stepped: float = 0.5

    def __post_init__(self) -> None:
        require_positive(
            "ThriftSettings",
            travel=self.travel,
            deviation=self.deviation,
            memory=self.memory,
            rise=self.rise,
            stepped=self.stepped,
        )
        if not self.most >= 1.0:
            raise CompensatorError(
                f"ThriftSettings: most is a factor of at least 1; got {self.most!r}"
            )


class Thrift:
    """Follows deviation and travel under the compensator; `push` once a scan.

    Args:
        deviation: of PV before compensation.
        travel: of the stem before, per scan.
        horizon: scans that a plan looks ahead; half of it is the way to a new set-point.
        settings: shares and rates.

    Attributes:
        price: factor of a move's price now.
    """

    def __init__(
        self, deviation: float, travel: float, horizon: int, settings: ThriftSettings | None = None
    ) -> None:
        self.settings = settings or ThriftSettings()
        self._enough = (self.settings.deviation * deviation) ** 2
        self._budget = self.settings.travel * travel
        self._rate = 1.0 / max(self.settings.memory, horizon)
        self._step, self._settling = self.settings.stepped * deviation, horizon // 2
        self._sp, self._pause = math.nan, 0
        self.price = 1.0
        # The first moves, to the set-point, are none to save.
        self._square, self._travel = 0.5 * self._enough, 0.5 * self._budget

    def push(self, pv: float, sp: float, way: float) -> None:
        """Take in PV, the set-point and the way of the stem in this scan."""
        if abs(sp - self._sp) > self._step:
            self._pause = self._settling
        self._sp = sp
        if self._pause:
            self._pause -= 1
            return
        error = pv - sp
        self._square += self._rate * (error**2 - self._square)
        self._travel += self._rate * (way - self._travel)
        # PV has precedence; where nothing is wrong the price comes down at leisure.
        if self._square > self._enough:
            direction = -2.0
        else:
            direction = 1.0 if self._travel > self._budget else -0.25
        price = self.price * math.exp(direction * self.settings.rise * self._rate)
        self.price = min(max(price, 1.0), self.settings.most)
