"""One FMU instance of any version: start, advance, save. Here: co-simulation.

`Instance` hides what differs between FMI 1, 2 and 3 and between co-simulation, where the solver is
inside (this module), and model exchange, where it is ours (`fmu_models.model_exchange`).

A step of co-simulation may come in parts: FMI 2 may discard the rest of a step, FMI 3 may return
early, at an event. The rest is computed from the time that was reached, after event mode where the
FMU has it.
"""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from ctypes import byref
from typing import Any

from fmpy import fmi1, fmi2, fmi3
from fmpy.fmi1 import FMICallException

from .clocks import InputClock, InputClocks
from .library import call_checked

__all__ = ["CoSimulation", "EndedError", "Instance", "StoppedError"]

_DISCARD = 2
_MAX_PARTS = 10_000
"""Parts of one step; an FMU that returns early more often than that makes no progress."""
_MAX_EVENT_ITERATIONS = 1000


class StoppedError(Exception):
    """The FMU did not do the step: it wants another step size, or does not come to an end."""


class EndedError(Exception):
    """The FMU ended the simulation in order.

    Attributes:
        reached: the second that it reached.
    """

    def __init__(self, reached: float) -> None:
        super().__init__(f"the FMU ended the simulation at {reached:g} s")
        self.reached = reached


class Instance(ABC):
    """A loaded FMU.

    Args:
        fmu: FMPy's object, instantiated.
        version: of FMI, 1, 2 or 3.
        clocks: of FMI 3, which tick in event mode.
    """

    def __init__(self, fmu: Any, version: int, clocks: Sequence[InputClock] = ()) -> None:
        self.fmu = fmu
        self.version = version
        self._clocks = InputClocks(fmu, clocks)
        self._started = False

    def configure(self, write: Callable[[], None]) -> None:
        """Let ``write`` set structural parameters, before anything else."""
        self.fmu.enterConfigurationMode()
        write()
        self.fmu.exitConfigurationMode()

    def start(self, write: Callable[[], None], start_time: float) -> None:
        """Let ``write`` set the start values, then initialise at ``start_time`` seconds."""
        write()
        self._initialise(start_time)
        self._started = True

    @abstractmethod
    def _initialise(self, start_time: float) -> None: ...

    def change(self, write: Callable[[], None]) -> None:
        """Let ``write`` set inputs between two steps."""
        write()

    @abstractmethod
    def advance(self, time: float, size: float) -> None:
        """Advance from ``time`` by ``size`` seconds.

        Raises:
            FMICallException: the FMU refused.
            StoppedError: it refused the step, with a reason.
            EndedError: it ended the simulation.
        """

    def save(self) -> bytes:
        """Return the serialised state."""
        state = self.fmu.getFMUState()
        try:
            content: bytes = self.fmu.serializeFMUState(state)
        finally:
            self.fmu.freeFMUState(state)
        return self._clocks.save() + content

    def restore(self, content: bytes) -> None:
        """Go back to a state that `save` returned."""
        content = self._clocks.restore(content)
        state = self.fmu.deserializeFMUState(content)
        try:
            self.fmu.setFMUState(state)
        finally:
            self.fmu.freeFMUState(state)

    def close(self, *, healthy: bool) -> None:
        """Free the instance and unload the library."""
        if self._started and healthy:
            # An FMU that refuses to terminate is freed all the same: nothing depends on it.
            with contextlib.suppress(FMICallException):
                self.fmu.terminate()
        self.fmu.freeInstance()


class CoSimulation(Instance):
    """An FMU with its solver inside.

    Args:
        fmu: FMPy's object, instantiated.
        version: of FMI.
        event_mode: whether it was instantiated with event mode (FMI 3).
        clocks: that this program ticks; only with event mode.
        can_vary_step: whether it takes shorter steps, up to a tick.
    """

    def __init__(
        self,
        fmu: Any,
        version: int,
        *,
        event_mode: bool = False,
        clocks: Sequence[InputClock] = (),
        can_vary_step: bool = True,
    ) -> None:
        super().__init__(fmu, version, clocks if event_mode else ())
        self._event_mode = event_mode
        self._can_vary_step = can_vary_step
        self._now = 0.0
        self._event, self._terminate, self._early = (fmi3.fmi3Boolean() for _ in range(3))
        self._last = fmi3.fmi3Float64()
        self._answers = tuple(
            byref(answer) for answer in (self._event, self._terminate, self._early, self._last)
        )

    def _initialise(self, start_time: float) -> None:
        self._now = start_time
        if self.version == 1:
            self.fmu.initialize(tStart=start_time)
            return
        if self.version == 2:
            self.fmu.setupExperiment(startTime=start_time)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start_time)
        self.fmu.exitInitializationMode()
        if self._event_mode:  # FMI 3 stands in event mode now
            self._update_discrete(start_time)
            self._clocks.begin(start_time)
            self.fmu.enterStepMode()

    def change(self, write: Callable[[], None]) -> None:
        """See `Instance.change`; discrete inputs of FMI 3 change in event mode."""
        if not self._event_mode:
            write()
            return
        self.fmu.enterEventMode()
        try:
            write()
            self._update_discrete(self._now)
            self._clocks.look(self._now)
        finally:
            self.fmu.enterStepMode()

    def _update_discrete(self, time: float) -> None:
        for _ in range(_MAX_EVENT_ITERATIONS):
            again, terminate, *_rest = self.fmu.updateDiscreteStates()
            if terminate:
                raise EndedError(time)
            if not again:
                return
        raise StoppedError(f"its events at {time:g} s do not come to an end")

    def _tick(self, time: float) -> None:
        self.fmu.enterEventMode()
        self._clocks.tick(time)
        self._update_discrete(time)
        self._clocks.look(time)
        self.fmu.enterStepMode()

    def advance(self, time: float, size: float) -> None:
        """See `Instance.advance`."""
        goal = time + size
        reached = time
        for _ in range(_MAX_PARTS):
            if self._clocks.is_due(reached):
                self._tick(reached)
                continue
            until = self._clocks.next_before(goal)
            if until < goal and not self._can_vary_step:
                raise StoppedError(
                    f"one of its clocks ticks at {until:g} s, within the step, and it takes no "
                    "shorter one; take a period at whose end its clocks tick"
                )
            whole = reached == time and until == goal
            reached = self._part(reached, size if whole else until - reached, until)
            if reached >= goal - 1e-12 * max(abs(goal), size):
                self._now = goal
                return
        raise StoppedError(f"the FMU interrupts its step more than {_MAX_PARTS} times")

    def _part(self, time: float, size: float, goal: float) -> float:
        """Step on; return the second that was reached, ``goal`` as a rule."""
        try:
            self._do_step(time, size)
        except FMICallException as error:
            if error.status != _DISCARD:
                raise
            reached = self._reached_before_discard(time, size)
            if reached is None:
                raise StoppedError(
                    f"the FMU discarded the step of {size:g} s, it got to {time:g} s; try another "
                    "period"
                ) from error
            return reached
        if self.version < 3:
            return goal
        reached = goal
        if self._early and self._last.value < goal:
            reached = self._last.value
        if self._terminate:
            raise EndedError(reached)
        if self._event_mode and self._event:
            self.fmu.enterEventMode()
            self._update_discrete(reached)
            self.fmu.enterStepMode()
        return reached

    def _do_step(self, time: float, size: float) -> None:
        fmu = self.fmu
        if self.version == 3:
            call_checked(fmu, "fmi3DoStep", fmu.component, time, size, True, *self._answers)
        elif self.version == 2:
            call_checked(fmu, "fmi2DoStep", fmu.component, time, size, fmi2.fmi2True)
        else:
            fmu.doStep(time, size)

    def _reached_before_discard(self, time: float, size: float) -> float | None:
        """Return the second up to which a discarded step was computed; None for no progress.

        Raises:
            EndedError: it was discarded because the FMU has ended.
        """
        if self.version == 3:
            return None
        reached = time
        with contextlib.suppress(FMICallException):
            kind = fmi2.fmi2LastSuccessfulTime if self.version == 2 else fmi1.fmi1LastSuccessfulTime
            answer = self.fmu.getRealStatus(kind)
            reached = float(getattr(answer, "value", answer))
        if self.version == 2:
            ended = False
            with contextlib.suppress(FMICallException):
                ended = bool(self.fmu.getBooleanStatus(fmi2.fmi2Terminated))
            if ended:
                raise EndedError(max(time, reached))
        return reached if time + 1e-12 * max(abs(time), size) < reached < time + size else None
