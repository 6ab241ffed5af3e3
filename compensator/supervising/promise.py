"""Does compensation keep its promise: half of PV's deviation, and no more travel than before?

A loop that is merely no worse than before is not worth another controller. So the figures of a long
stretch are asked for more than the watch asks for at first. What noise alone makes of PV is taken
off: a loop that is held as still as its noise allows has nothing left to gain.

How much that is depends on the stem. While it travels, a wrong model passes its own mistakes for
noise, so only the least noise ever seen is taken off. While it rests, PV deviates by noise and load
alone, and the loop's own controller would only set the stem in motion again: what the noise of this
window makes is taken off, with the margin that so short a look at a slow noise needs.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

from compensator.action import require_not_negative, require_positive, require_whole

__all__ = ["PromiseSettings", "PromiseWatch"]


@dataclass(frozen=True, slots=True)
class PromiseSettings:
    """Settings of `PromiseWatch`.

    Attributes:
        deviation: share of PV's deviation before that is too much, noise taken off: a tenth above
            the half that is promised, because two stretches of one loop differ by as much.
        travel: factor of the stem's travel before that is too much, with the same tenth.
        strokes: stick bands of travel in the window that are too much for no loop.
        renewal: scans in which that many stick bands are granted again, once they were travelled:
            granted anew in each window, they let the stem of a slow loop travel three times as far
            as before for good.
        learning: stick bands beside those of ``strokes``, once: what finding the stem, J and the
            gain takes. Without it 4 instead of 2 of 650 simulated loops were given back that would
            have halved PV's deviation and travelled less than before.
        gainless: share of all those stick bands that is too much already where PV deviates too much
            as well since the stem began to spend them. Of 650 simulated loops no good one is given
            back for it, and 18 instead of 13 others sooner than the window alone does.
        resting: share of the travel before up to which the stem rests, beside one correction of two
            stick bands.
        noise: multiple of the variance that noise makes which is taken off while the stem rests: a
            window holds some ten values of a noise as slow as the loop, and the variance of ten
            values is known to a factor of two.
        shortest: scans that are averaged at least: four corrections of a slow loop.
        persist: share of the window for which the promise must have been broken.
    """

    deviation: float = 0.55
    travel: float = 1.1
    strokes: float = 4.0
    resting: float = 0.1
    noise: float = 2.0
    renewal: int = 2000
    learning: float = 1.0
    gainless: float = 0.5
    shortest: int = 240
    persist: float = 0.125

    def __post_init__(self) -> None:
        require_positive(
            "PromiseSettings",
            deviation=self.deviation,
            travel=self.travel,
            strokes=self.strokes,
            gainless=self.gainless,
            resting=self.resting,
            noise=self.noise,
            persist=self.persist,
        )
        require_not_negative("PromiseSettings", learning=self.learning)
        require_whole("PromiseSettings", 1, renewal=self.renewal, shortest=self.shortest)

    def rests(self, travel: float, usual: float, scans: int, stroke: float) -> bool:
        """Whether a stem rests that travels so much a scan, ``usual`` before, over so many scans.

        ``stroke`` is of one correction, in per cent of OP.
        """
        return (travel - self.resting * usual) * scans <= 2.0 * stroke


class PromiseWatch:
    """Follows error and travel of settled scans under the compensator; `push` once for each.

    Args:
        mean_square: of the error that is usual.
        travel: of the stem per scan that is usual.
        stroke: way of a correction, a stick band.
        window: scans to average over, if more than the settings' least.
        settings: shares.
    """

    def __init__(
        self,
        mean_square: float,
        travel: float,
        stroke: float,
        window: int,
        settings: PromiseSettings | None = None,
    ) -> None:
        self.settings = s = settings or PromiseSettings()
        length = max(window, s.shortest)
        self._square = s.deviation**2 * mean_square
        self._usual, self._stroke = travel, stroke
        self._lasting = math.ceil(s.persist * length)
        self._squares, self._ways, self._noises = (_RunningMean(length) for _ in range(3))
        self._length, self._least = length, math.inf
        self._run = self._travel_run = self._spent_run = 0
        granted = s.strokes * stroke
        self._allowed = s.travel * travel + granted / s.renewal
        # Of a stem that travels far in any case, a window's travel differs by more.
        self._most, self._spent = max(granted, travel * s.shortest), -s.learning * stroke
        self._spending, self._errors = 0, 0.0
        self._from, self._since = math.nan, 0

    def push(
        self, error: float, way: float, noise: float, stem: float = math.nan
    ) -> Literal["", "deviation", "travel"]:
        """Take in a scan; return which part of the promise has been broken for too long.

        Args:
            error: PV minus SP.
            way: of the stem, less what the set-point asks for.
            noise: variance that noise alone makes, by what is known of it now.
            stem: where it is, NaN if not known.
        """
        self._squares.push(error**2)
        self._ways.push(way)
        self._noises.push(noise)
        self._least = min(self._least, noise)
        overspent = self._overspends(error, way, self._taken_along(stem))
        if self._travels() or overspent:
            return "travel"
        return "deviation" if self._deviates() else ""

    @property
    def judged(self) -> bool:
        """Whether a window is full, and the promise kept in it."""
        return self._squares.is_full and not self._run and not self._travel_run

    def _travels(self) -> bool:
        """Whether the stem has travelled too much for too long.

        The strokes that no loop is refused make up for a window that is not full: a slow loop is
        judged by what its stem has done since the take-over.
        """
        s, count = self.settings, self._ways.count
        if count < s.shortest:
            return False
        much = s.travel * self._usual * count + s.strokes * self._stroke
        travels = self._ways.mean * count > much
        self._travel_run = self._travel_run + 1 if travels else 0
        return self._travel_run >= s.persist * s.shortest

    def _taken_along(self, stem: float) -> float:
        """Return how far the stem has come: a load that goes asks for that of any controller.

        What a window has brought is taken off at its end, so that a load may come back as well.
        """
        if not math.isfinite(self._from):
            self._from = stem
        come = abs(stem - self._from)
        self._since += 1
        if self._since >= self.settings.shortest and math.isfinite(come):
            self._spend(-come)
            self._from, self._since, come = stem, 0, 0.0
        return come if math.isfinite(come) else 0.0

    def _overspends(self, error: float, way: float, come: float) -> bool:
        """Whether the stem has travelled, beyond what is granted, all that no loop is refused."""
        s = self.settings
        self._spend(way - self._allowed)
        if self._spent <= 0.0:
            self._spending, self._errors = 0, 0.0
        else:
            self._spending, self._errors = self._spending + 1, self._errors + error**2
        gains = self._errors - self._spending * self._least <= self._spending * self._square
        much = self._spent - come > (1.0 if gains else s.gainless) * self._most
        self._spent_run = self._spent_run + 1 if much else 0
        return self._spent_run >= s.persist * s.shortest

    def _spend(self, way: float) -> None:
        """Add to what the stem has travelled beyond what is granted.

        What it saves is not kept: a loop at rest for a day has no right to wear the valve.
        """
        self._spent = max(min(self._spent, 0.0), self._spent + way)

    def _deviates(self) -> bool:
        """Whether PV has deviated too much for too long."""
        s, length = self.settings, self._length
        if not self._squares.is_full:
            return False
        rests = s.rests(self._ways.mean, self._usual, length, self._stroke)
        noise = s.noise * self._noises.mean if rests else self._least
        deviates = self._squares.mean - noise > self._square
        self._run = self._run + 1 if deviates else 0
        return self._run >= self._lasting


class _RunningMean:
    """Mean of the latest values, at most ``length`` of them."""

    def __init__(self, length: int) -> None:
        self._values: deque[float] = deque(maxlen=length)
        self._sum = 0.0

    @property
    def is_full(self) -> bool:
        """Whether there are as many values as are kept."""
        return len(self._values) == self._values.maxlen

    @property
    def count(self) -> int:
        """Number of the values."""
        return len(self._values)

    @property
    def mean(self) -> float:
        """Mean of the values."""
        return self._sum / len(self._values)

    def push(self, value: float) -> None:
        """Take in a value; the oldest one goes."""
        if self.is_full:
            self._sum -= self._values[0]
        self._values.append(value)
        self._sum += value
