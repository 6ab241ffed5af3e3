"""Stop-watches of processor time around controllers."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from compensator import Action, Compensator, Controller

__all__ = ["Timing", "timed", "timed_compensator"]


@dataclass(slots=True)
class Timing:
    """Seconds of processor time of each scan: to take in PV, and to decide.

    Not of the clock, which also counts what other programs do meanwhile.
    """

    observe: list[float] = field(default_factory=list)
    decide: list[float] = field(default_factory=list)


class TimedController:
    """A controller with a stop-watch, from sample ``at`` on."""

    def __init__(self, controller: Controller, timing: Timing, at: int) -> None:
        self._controller, self._timing, self._left = controller, timing, at

    def observe(self, pv: float, op: float) -> None:
        """See `Controller.observe`."""
        begin = time.thread_time()
        self._controller.observe(pv, op)
        self._left -= 1
        if self._left < 0:
            self._timing.observe.append(time.thread_time() - begin)

    def decide(self, sp: float) -> Action:
        """See `Controller.decide`."""
        begin = time.thread_time()
        action = self._controller.decide(sp)
        if self._left < 0:
            self._timing.decide.append(time.thread_time() - begin)
        return action


def timed(controller: Controller, timing: Timing, at: int) -> Controller:
    """Return the controller with a stop-watch from sample ``at`` on."""
    return TimedController(controller, timing, at)


def timed_compensator(compensator: Compensator, timing: Timing) -> Compensator:
    """Put a stop-watch into a compensator; the rest of it stays what it is."""
    watch = TimedController(_Methods(compensator.observe, compensator.decide), timing, 0)
    compensator.observe = watch.observe  # type: ignore[method-assign]
    compensator.decide = watch.decide  # type: ignore[method-assign]
    return compensator


@dataclass(frozen=True, slots=True)
class _Methods:
    observe: Callable[[float, float], None]
    decide: Callable[[float], Action]
