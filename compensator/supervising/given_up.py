"""Models that made a loop worse, and when one may be tried again.

A model is the same as one that was given up while its parameters lie inside the interval of what
was given up: a model identified again from the same valve is its twin, not a new one.

One model that is given up was wrong. Two that differ say that no such model describes the loop: a
positioner with an integral of its own moves the stem while OP rests, and each identification finds
another valve there. Each of them costs the loop an episode, so that any model has to wait then, and
twice as long after each further one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from compensator.action import RefusalKind, require_not_negative, require_positive, require_whole
from compensator.stem_tracking.friction import FrictionPrior, Uncertainty
from loop_model import LoopModel

__all__ = ["GivenUp", "GivenUpModels", "RetrySettings"]


@dataclass(frozen=True, slots=True)
class RetrySettings:
    """When a model that was given up may be tried again.

    Attributes:
        after: scans; the valve may have been serviced, or the load be another one.
        within: deviations of fS and of fD that count as the same valve: those of a 90 % interval.
        widest: share of fS by which fS or fD may differ at most to count as the same valve, however
            wide the interval is.
        gain: relative change of the process gain that counts as the same process.
        pause: scans after the second model, of those remembered, was given up until any may be
            tried; twice as many after each further one, at most ``after``. It is ten windows of
            identification as long as what a compensator relives (`SupervisorSettings.history`).
        kept: models that are remembered.
    """

    after: int = 30_000
    within: float = 1.645
    widest: float = 0.25
    gain: float = 0.25
    pause: int = 3_000
    kept: int = 8

    def __post_init__(self) -> None:
        require_positive("RetrySettings", after=self.after, within=self.within, kept=self.kept)
        require_not_negative("RetrySettings", widest=self.widest)
        require_not_negative("RetrySettings", gain=self.gain)
        require_whole("RetrySettings", 0, pause=self.pause)


@dataclass(frozen=True, slots=True)
class GivenUp:
    """A model that was given up.

    Attributes:
        model: valve and process.
        prior: deviations of its friction.
        left: scans until it may be tried again.
        why: it was given up.
    """

    model: LoopModel
    prior: FrictionPrior = field(default_factory=FrictionPrior)
    left: int = 0
    why: RefusalKind = RefusalKind.OTHER


class GivenUpModels:
    """Remembers what was given up; `pass_scan` once a scan."""

    def __init__(self, settings: RetrySettings | None = None) -> None:
        self.settings = settings or RetrySettings()
        self._known: list[GivenUp] = []

    @property
    def known(self) -> tuple[GivenUp, ...]:
        """What is refused now, oldest first."""
        return tuple(self._known)

    def restore(self, known: tuple[GivenUp, ...]) -> None:
        """Go on with what was known before a restart."""
        self._known = list(known)[-self.settings.kept :]

    def add(self, model: LoopModel, uncertainty: Uncertainty, why: RefusalKind) -> None:
        """Remember a model."""
        prior = FrictionPrior(uncertainty=uncertainty)
        self._known = [known for known in self._known if not self._alike(known, model)]
        self._known.append(GivenUp(model, prior, self.settings.after, why))
        self._known = self._known[-self.settings.kept :]

    def pass_scan(self) -> None:
        """Count a scan."""
        if self._known:
            self._known = [
                GivenUp(known.model, known.prior, known.left - 1, known.why)
                for known in self._known
                if known.left > 1
            ]

    def find(self, model: LoopModel) -> GivenUp | None:
        """Return the given-up model that counts as the same as ``model``; None if none does."""
        return next((known for known in self._known if self._alike(known, model)), None)

    @property
    def pause(self) -> int:
        """Scans until any model may be tried; 0 where one was given up at most."""
        if len(self._known) < 2:
            return 0
        s = self.settings
        wait = min(s.pause << (len(self._known) - 2), s.after)
        passed = s.after - self._known[-1].left
        return max(0, wait - passed)

    def _alike(self, known: GivenUp, model: LoopModel) -> bool:
        s, old = self.settings, known.model.valve
        new = model.valve
        static = abs(new.static_friction - old.static_friction)
        dynamic = abs(new.dynamic_friction - old.dynamic_friction)
        widest = s.widest * old.static_friction
        return (
            static <= min(s.within * known.prior.static_deviation(old), widest)
            and dynamic <= min(s.within * known.prior.dynamic_deviation(old), widest)
            and _gains_alike(known.model, model, s.gain)
        )


def _gains_alike(one: LoopModel, other: LoopModel, within: float) -> bool:
    """Whether two processes answer alike: kind, sign and size of the gain."""
    a, b = one.process, other.process
    if a.is_integrating != b.is_integrating:
        return False
    gains = [math.fsum(p.b) if p.is_integrating else p.gain for p in (a, b)]
    return math.isclose(gains[0], gains[1], rel_tol=within)
