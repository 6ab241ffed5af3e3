"""Model exchange: the FMU gives derivatives and events, SUNDIALS' CVode (from FMPy) integrates.

Inputs change between steps, in event mode, so that discrete inputs and jumps are right; the solver
starts again then, as it does after every event. A snapshot does not hold CVode's memory: it starts
again when one is taken and when one is restored, so that a replay is exact.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any

from fmpy.fmi1 import FMICallException

from .clocks import InputClock
from .errors import PlantFileError
from .instances import EndedError, Instance, StoppedError

__all__ = ["ModelExchange"]

_CLOCK = struct.Struct("<dd")  # time and next time event, to the last bit
_TOLERANCE = 1e-6
"""Relative, where the FMU recommends none: a hundredth of what a comparison with another importer
allows, because errors of events add up."""
_MANY_EVENTS = 10_000
_LEAST_PROGRESS = 1e-3
"""Part of a step that so many events must get on by; less is taken for chattering. A step of days
may have more events than that in order."""
_MAX_EVENT_ITERATIONS = 1000


class _NoInput:
    """FMPy's solver wants an object that applies inputs; ours change between steps only."""

    def apply(self, _time: float) -> None: ...


class ModelExchange(Instance):
    """An FMU without a solver.

    Args:
        fmu: FMPy's object, instantiated.
        version: of FMI.
        description: FMPy's model description.
        max_step: the longest step of the solver in seconds, so that no short event is missed.
        clocks: that this program ticks (FMI 3).
    """

    def __init__(
        self,
        fmu: Any,
        version: int,
        description: Any,
        max_step: float,
        clocks: Sequence[InputClock] = (),
    ) -> None:
        super().__init__(fmu, version, clocks)
        experiment = description.defaultExperiment
        given = experiment.tolerance if experiment else None
        self._tolerance = float(given) if given else _TOLERANCE
        self._states = int(description.numberOfContinuousStates)
        self._indicators = int(description.numberOfEventIndicators)
        self._sized = any(v.causality == "structuralParameter" for v in description.modelVariables)
        exchange = description.modelExchange
        self._reports_steps = version == 1 or bool(exchange.needsCompletedIntegratorStep)
        self._max_step = max_step
        self._next_event = math.inf
        self._time = 0.0
        self._solver: Any = None
        self._error: FMICallException | None = None

    def _initialise(self, start_time: float) -> None:
        fmu = self.fmu
        self._time = start_time
        if self._sized:
            self._states = fmu.getNumberOfContinuousStates()
            self._indicators = fmu.getNumberOfEventIndicators()
        if self.version == 1:
            fmu.setTime(start_time)
            self._note(*fmu.initialize())
        else:
            if self.version == 2:
                fmu.setupExperiment(startTime=start_time)
                fmu.enterInitializationMode()
            else:
                fmu.enterInitializationMode(startTime=start_time)
            fmu.exitInitializationMode()
            self._update_discrete()
            self._clocks.begin(start_time)
            fmu.enterContinuousTimeMode()
        self._solver = self._make_solver(start_time)

    def _make_solver(self, start_time: float) -> Any:
        try:
            from fmpy.sundials import CVodeSolver
        except Exception as error:  # the library is missing, or of another version
            raise PlantFileError(
                f"model exchange needs SUNDIALS, which FMPy does not bring for this platform: "
                f"{error}; export the FMU for co-simulation"
            ) from error
        fmu = self.fmu
        nominals = "ContinuousStates" if self.version == 1 else "sOfContinuousStates"
        derivatives = "getContinuousStateDerivatives" if self.version == 3 else "getDerivatives"
        return CVodeSolver(
            nx=self._states,
            nz=self._indicators,
            get_x=fmu.getContinuousStates,
            set_x=self._guarded(fmu.setContinuousStates),
            get_dx=self._guarded(getattr(fmu, derivatives)),
            get_z=self._guarded(fmu.getEventIndicators),
            get_nominals=getattr(fmu, f"getNominal{nominals}"),
            set_time=self._guarded(fmu.setTime),
            input=_NoInput(),
            startTime=start_time,
            maxStep=self._max_step,
            relativeTolerance=self._tolerance,
            maxNumSteps=100_000,
        )

    def _guarded(self, function: Callable[..., Any]) -> Callable[..., None]:
        """Wrap a call-back so that its first error is kept: CVode itself would lose it."""

        def call(*arguments: Any) -> None:
            try:
                function(*arguments)
            except FMICallException as error:  # raised again after the step
                self._error = self._error or error

        return call

    def change(self, write: Callable[[], None]) -> None:
        """See `Instance.change`."""
        if self.version == 1:
            write()
            self._update_discrete()
        else:
            self.fmu.enterEventMode()
            try:
                write()
                self._update_discrete()
                self._clocks.look(self._time)
            finally:
                self.fmu.enterContinuousTimeMode()
        self._solver.reset(self._time)

    def advance(self, time: float, size: float) -> None:
        """See `Instance.advance`."""
        goal = time + size
        close = 1e-12 * max(abs(goal), size)
        mark, pieces = self._time, 0
        while self._time < goal - close:
            if self._clocks.is_due(self._time):
                self._tick()
            else:
                until = min(self._next_event, self._clocks.next_before(goal))
                self._piece(max(until, self._time), close)
            pieces += 1
            if pieces % _MANY_EVENTS == 0:
                if self._time - mark < _LEAST_PROGRESS * size:
                    raise StoppedError(
                        f"{_MANY_EVENTS} events within {self._time - mark:g} s at {self._time:g} s:"
                        " the model chatters"
                    )
                mark = self._time
        self._time = goal

    def _tick(self) -> None:
        self.fmu.enterEventMode()
        self._clocks.tick(self._time)
        self._update_discrete()
        self._clocks.look(self._time)
        self.fmu.enterContinuousTimeMode()
        self._solver.reset(self._time)

    def _piece(self, until: float, close: float) -> None:
        """Integrate up to ``until`` or an event."""
        event = False
        if until > self._time + close:
            event = self._integrate(until)
        event = event or self._time >= self._next_event - close
        if self._reports_steps:
            if self.version == 1:
                event = self.fmu.completedIntegratorStep() or event
            else:
                wanted, terminate = self.fmu.completedIntegratorStep()
                if terminate:
                    raise EndedError(self._time)
                event = event or wanted
        if not event:
            return
        if self.version > 1:
            self.fmu.enterEventMode()
        self._update_discrete()
        if self.version > 1:
            self.fmu.enterContinuousTimeMode()
        self._solver.reset(self._time)

    def _integrate(self, until: float) -> bool:
        """Return whether a state event ended it before ``until``."""
        self._error = None
        failure: Exception | None = None
        event, time = False, self._time
        try:
            event, _roots, time = self._solver.step(self._time, until)
        except (RuntimeError, TypeError) as error:  # TypeError: FMPy has no words for the failure
            failure = error
        if self._error is not None:
            raise self._error
        if failure is not None:
            raise StoppedError(
                f"the solver failed between {self._time:g} s and {until:g} s: {failure}; the model "
                "is unstable, or its inputs are outside of their range"
            ) from failure
        self._time = time
        self.fmu.setTime(time)
        return bool(event)

    def _update_discrete(self) -> None:
        self._next_event = math.inf
        for _ in range(_MAX_EVENT_ITERATIONS):
            if self.version == 1:
                if self._note(*self.fmu.eventUpdate()):
                    return
                continue
            update = self.fmu.newDiscreteStates if self.version == 2 else None
            again, terminate, _n, _v, defined, moment = (update or self.fmu.updateDiscreteStates)()
            self._next_event = moment if defined else math.inf
            if terminate:
                raise EndedError(self._time)
            if not again:
                return
        raise StoppedError(f"its events at {self._time:g} s do not come to an end")

    def _note(
        self, done: bool, _refs: bool, _values: bool, end: bool, timed: bool, moment: float
    ) -> bool:
        """Take FMI 1's event information; return whether the iteration is done."""
        self._next_event = moment if timed else math.inf
        if end:
            raise EndedError(self._time)
        return done

    def save(self) -> bytes:
        """See `Instance.save`."""
        content = super().save()
        self._solver = self._make_solver(self._time)
        return _CLOCK.pack(self._time, self._next_event) + content

    def restore(self, content: bytes) -> None:
        """See `Instance.restore`."""
        super().restore(content[_CLOCK.size :])
        self._time, self._next_event = _CLOCK.unpack(content[: _CLOCK.size])
        self.fmu.setTime(self._time)
        self._solver = self._make_solver(self._time)

    def close(self, *, healthy: bool) -> None:
        """See `Instance.close`; the solver goes first, it calls the FMU."""
        self._solver = None
        super().close(healthy=healthy)
