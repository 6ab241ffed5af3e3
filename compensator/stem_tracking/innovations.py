"""What the innovations of PV tell: how much noise there is, how coloured, and lasting errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

from compensator.action import require_positive, require_whole

__all__ = ["InnovationSettings", "InnovationStatistics"]


@dataclass(frozen=True, slots=True)
class InnovationSettings:
    """Settings of `InnovationStatistics`.

    Attributes:
        rate: share of the newest innovation in the running mean that shows a bias.
        first: innovations that tell the size of the noise for the first time; better: after which
            it is known to 20 %; most: over which it is averaged at last.
        wild: squared deviations above which an innovation counts as wild.
    """

    rate: float = 0.05
    first: int = 20
    better: int = 60
    most: int = 80
    wild: float = 4.0

    def __post_init__(self) -> None:
        require_positive("InnovationSettings", rate=self.rate, wild=self.wild)
        require_whole("InnovationSettings", 1, first=self.first, better=self.better, most=self.most)


class InnovationStatistics:
    """Running figures of a filter's innovations.

    Attributes:
        variance: of the noise, in the filter's own scale.
        correlation: of successive innovations, 0 if the model is right.
        evidence: log-density that the last PV had.

    Args:
        variance: known from elsewhere; known_for: innovations that it is worth.
        settings: rates and numbers.
    """

    def __init__(
        self,
        variance: float = 0.0,
        known_for: int = 0,
        settings: InnovationSettings | None = None,
    ) -> None:
        self.settings = settings or InnovationSettings()
        self.variance = variance
        self.correlation = 0.0
        self.evidence = 0.0
        self._count = known_for
        self._trend = 0.0
        self._last = 0.0
        self._wild = 0.0
        rate = self.settings.rate
        self._spread = rate / (2.0 - rate)
        self._seldom = min(4.0 * math.sqrt(self._spread), 2.0)

    @property
    def colour(self) -> float:
        """Their correlation, 0 if it is below: what makes successive errors count for fewer."""
        correlation = self.correlation
        return correlation if correlation > 0.0 else 0.0

    @property
    def is_learning(self) -> bool:
        """Whether the noise is known for the first time, or a little better, only now."""
        return self._count in (self.settings.first, self.settings.better)

    @property
    def is_biased(self) -> bool:
        """Whether innovations have kept one sign for too long."""
        trend = abs(self._trend)
        if trend <= self._seldom:  # within the bound of innovations without colour, the narrowest
            return False
        colour = self.colour
        spread = self._spread * (1.0 + colour) / (1.0 - colour)
        return trend > min(4.0 * math.sqrt(spread), 2.0)

    def restart_trend(self, colour: float = 1.0) -> None:
        """Restart the search for a bias; ``colour`` scales the stored correlation."""
        self._trend = 0.0
        self.correlation *= colour

    def push(self, surprise: float, innovation: float, least: float) -> None:
        """Take in an innovation and its variance; ``least`` is a noise that counts as none."""
        # Of every tracker in every scan: names and comparisons instead of attributes and calls.
        s = self.settings
        self._count = count = self._count + 1
        known = count > s.first
        averaged = count if count < s.most else s.most
        variance = self.variance
        variance = variance if variance >= least else least
        bound = s.wild * variance
        square = surprise**2 / (innovation / variance)
        self._wild += s.rate * ((square > bound) - self._wild)
        # One wild PV is no noise; when every second one is, the noise is not what it was.
        if known and self._wild < 0.5 and square > bound:
            square = bound
        self.variance += (square - self.variance) / averaged
        normal = surprise / math.sqrt(innovation)
        power = normal**2
        self.evidence = -0.5 * ((power if power < 9.0 else 9.0) + math.log(innovation))
        if abs(normal) < 3.0:
            if known:
                product = (normal - self._trend) * (self._last - self._trend)
                moved = self.correlation + (product - self.correlation) / averaged
                self.correlation = min(max(moved, -0.9), 0.9)
        else:
            normal = math.copysign(3.0, normal)
        self._last = normal
        self._trend += s.rate * (normal - self._trend)
