"""Travel and PV can be bought with each other: what both were before tells which to save.

A level has to go to and fro between two positions for ever, a wrong model corrects again and again:
there the price of a move decides on both. Where PV or travel is above its share of before, the one
that is farther above has its way: the price rises as long as that is travel, and falls, also below
1, as long as it is PV. Where both are below their shares, the price goes back to 1. A level's PV
drifts away from every position: there PV has precedence, and no price is below 1, because each move
for a little of PV is followed by one back.
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
        deviation: share of PV's deviation before that needs no effort: below the half that
            compensation promises.
        memory: scans at least over which travel and deviation are averaged, otherwise the
            planner's horizon.
        rise: growth of the price in one memory at most, as a natural logarithm: fourfold; it falls
            up to twice as fast, because PV that is off is the worse of the two.
        ease: part of that rate at which it goes back to 1.
        most, least: factors of the price at most and at least. The square root of each is the
            factor of the error that is worth a move.
        stepped: change of the set-point, in PV's deviations before, that counts as a step: the way
            to the new set-point is no error, and what it takes of travel none to save.
    """

    travel: float = 0.6
    deviation: float = 0.4
    memory: int = 100
    rise: float = 1.4
    ease: float = 0.25
    most: float = 10.0
    least: float = 0.1
    stepped: float = 0.5

    def __post_init__(self) -> None:
        require_positive(
            "ThriftSettings",
            travel=self.travel,
            deviation=self.deviation,
            memory=self.memory,
            rise=self.rise,
            ease=self.ease,
            least=self.least,
            stepped=self.stepped,
        )
        if not self.least <= 1.0 <= self.most:
            raise CompensatorError(
                "ThriftSettings: least is a factor of at most 1 and most one of at least 1; got "
                f"{self.least!r} and {self.most!r}"
            )


class Thrift:
    """Follows deviation and travel under the compensator; `push` once a scan.

    Args:
        deviation: of PV before compensation.
        travel: of the stem before, per scan.
        horizon: scans that a plan looks ahead; half of it is the way to a new set-point.
        settings: shares and rates.
        is_level: whether the process integrates.

    Attributes:
        price: factor of a move's price now.
    """

    def __init__(
        self,
        deviation: float,
        travel: float,
        horizon: int,
        settings: ThriftSettings | None = None,
        *,
        is_level: bool = False,
    ) -> None:
        self.settings = settings or ThriftSettings()
        self._enough = (self.settings.deviation * deviation) ** 2
        self._budget = self.settings.travel * travel
        self._rate = 1.0 / max(self.settings.memory, horizon)
        self._step, self._settling = self.settings.stepped * deviation, horizon // 2
        self._sp, self._pause = math.nan, 0
        self._is_level = is_level
        self._least = 1.0 if is_level else self.settings.least
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
        error, s = pv - sp, self.settings
        self._square += self._rate * (error**2 - self._square)
        self._travel += self._rate * (way - self._travel)
        if self._square <= self._enough and self._travel <= self._budget:
            ease = s.ease * s.rise * self._rate
            self.price *= math.exp(min(max(-math.log(self.price), -ease), ease))
            return
        if self._is_level:
            self._change(-2.0 if self._square > self._enough else 1.0)
            return
        # Twice the logarithm of how much farther travel is above its share than PV.
        travel, square = self._travel**2 * self._enough, self._square * self._budget**2
        direction = 1.0 if square == 0.0 else -2.0
        if travel > 0.0 and square > 0.0:
            direction = min(max(math.log(travel / square), -2.0), 1.0)
        self._change(direction)

    def _change(self, direction: float) -> None:
        """Change the price by ``direction`` times the settings' rate."""
        price = self.price * math.exp(direction * self.settings.rise * self._rate)
        self.price = min(max(price, self._least), self.settings.most)
