"""Travel is worth a price while PV is good enough: what the loop travelled before is known.

PV and travel can be bought with each other. A level has to go to and fro between two positions for
ever, a wrong model corrects again and again: there the price of a move decides on both. It rises as
long as the stem travels more than its share of before with PV well below what it was, and falls as
soon as PV is not. It falls below what noise makes it while PV is above the half that is promised
and the stem rests most of the time: there is travel to spend.
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
        promised: that half; PV above it, noise taken off, is worth travel that is left.
        noise: multiple of the variance that noise makes of PV which is taken off: a memory holds
            some ten values of a slow noise, and their variance is known to a factor of two.
        left: share of the travel before below which travel is left to spend: half of what needs no
            thrift.
        memory: scans at least over which travel and deviation are averaged, otherwise the
            planner's horizon.
        rise: growth of the price in one memory, as a natural logarithm: fourfold.
        most: factor of the price at most. The square root of it is the factor of the error that is
            worth a move.
        least: the same at least: half of the error that is otherwise worth a move.
        stepped: change of the set-point, in PV's deviations before, that counts as a step: the way
            to the new set-point is no error, and what it takes of travel none to save.
    """

    travel: float = 0.6
    deviation: float = 0.4
    promised: float = 0.5
    noise: float = 2.0
    left: float = 0.3
    memory: int = 100
    rise: float = 1.4
    most: float = 10.0
    least: float = 0.25
    stepped: float = 0.5

    def __post_init__(self) -> None:
        require_positive(
            "ThriftSettings",
            travel=self.travel,
            deviation=self.deviation,
            promised=self.promised,
            noise=self.noise,
            left=self.left,
            memory=self.memory,
            rise=self.rise,
            stepped=self.stepped,
        )
        if not self.most >= 1.0:
            raise CompensatorError(
                f"ThriftSettings: most is a factor of at least 1; got {self.most!r}"
            )
        if not 0.0 < self.least <= 1.0:
            raise CompensatorError(
                f"ThriftSettings: least is a factor above 0 and at most 1; got {self.least!r}"
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
        self._promised = (self.settings.promised * deviation) ** 2
        self._budget, self._left = self.settings.travel * travel, self.settings.left * travel
        self._rate = 1.0 / max(self.settings.memory, horizon)
        self._step, self._settling = self.settings.stepped * deviation, horizon // 2
        self._sp, self._pause = math.nan, 0
        self.restart()

    def restart(self) -> None:
        """Forget what was seen: the first moves, to the set-point, are none to save."""
        self.price = 1.0
        self._square, self._travel = 0.5 * self._enough, 0.5 * self._budget

    def push(self, pv: float, sp: float, way: float, noise: float = 0.0) -> None:
        """Take in a scan.

        Args:
            pv: believed, without the measurement's noise.
            sp: set-point.
            way: of the stem.
            noise: variance that noise alone makes of ``pv``.
        """
        s = self.settings
        if abs(sp - self._sp) > self._step:
            self._pause = self._settling
        self._sp = sp
        if self._pause:
            self._pause -= 1
            return
        error = pv - sp
        self._square += self._rate * (error**2 - self._square)
        self._travel += self._rate * (way - self._travel)
        # PV has precedence; where nothing is wrong the price goes back at leisure.
        least, most, speed = min(1.0, self.price), max(1.0, self.price), 2.0
        if self._square - s.noise * noise > self._promised and self._travel < self._left:
            least, direction = s.least, -speed
        elif self.price < 1.0:
            most, direction = 1.0, speed
        elif self._square > self._enough:
            direction = -speed
        elif self._travel > self._budget:
            most, direction = s.most, 1.0
        else:
            direction = -0.25
        price = self.price * math.exp(direction * s.rise * self._rate)
        self.price = min(max(price, least), most)
