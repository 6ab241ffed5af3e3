"""The FMUs behind the simulated PLC: each steps once a scan, and none keeps another waiting.

A scan begins the steps of all its plants before it waits for the first. When a
clock paces the scans, a scan waits only briefly: a plant that does not answer in time goes on in
the background and its loops stand still until it does; the other loops are scanned as before.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from time import monotonic
from typing import Protocol, runtime_checkable

from fmu_models import PlantError, PlantInfo

__all__ = ["BackgroundPlant", "HostedPlant", "SteppedPlant", "step_all"]


class SteppedPlant(Protocol):
    """What the PLC needs of a plant; `fmu_models.Plant` has it."""

    @property
    def info(self) -> PlantInfo:
        """What the plant is."""
        ...

    def outputs(self) -> dict[str, float]:
        """Return the outputs at the present time."""
        ...

    def step(self, inputs: Mapping[str, float]) -> dict[str, float]:
        """Apply inputs, advance one period, return all outputs."""
        ...

    def close(self) -> None:
        """End the plant; more than once does no harm."""
        ...


@runtime_checkable
class BackgroundPlant(SteppedPlant, Protocol):
    """A plant that computes elsewhere; `fmu_models.isolated.IsolatedPlant` is one."""

    def begin_step(self, inputs: Mapping[str, float]) -> None:
        """Begin a step."""
        ...

    def finish_step(self, wait: float) -> dict[str, float] | None:
        """Return its outputs; None when they are not there after ``wait`` seconds."""
        ...


class HostedPlant:
    """One plant for one or more loops of the PLC.

    Attributes:
        values: the newest outputs by name.
        failure: why it will never step again; None while it may.
    """

    def __init__(self, plant: SteppedPlant) -> None:
        self.values: Mapping[str, float] = plant.outputs()
        self.failure: PlantError | None = None
        self._plant = plant
        self._background = plant if isinstance(plant, BackgroundPlant) else None
        self._inputs: dict[str, float] = {}
        self._at_work = False
        self._closed = False

    @property
    def info(self) -> PlantInfo:
        """What the plant is."""
        return self._plant.info

    @property
    def is_at_work(self) -> bool:
        """Whether a step was begun that is not done."""
        return self._at_work

    @property
    def is_fresh(self) -> bool:
        """Whether `values` are those after the step that was begun last."""
        return not self._at_work and self.failure is None and not self._closed

    def apply(self, inputs: Mapping[str, float]) -> None:
        """Set inputs for the next step; the others keep their values."""
        self._inputs.update(inputs)

    def begin(self) -> None:
        """Begin a step, unless the one before is not done."""
        if self._at_work or self.failure is not None:
            return
        try:
            if self._background is None:
                self.values = self._plant.step(self._inputs)
            else:
                self._background.begin_step(self._inputs)
                self._at_work = True
        except PlantError as error:
            self.failure = error

    def finish(self, wait: float) -> None:
        """Take the outputs over when they are there within ``wait`` seconds."""
        if not self._at_work or self._background is None:
            return
        try:
            answer = self._background.finish_step(wait)
        except PlantError as error:
            self.failure, self._at_work = error, False
            return
        if answer is not None:
            self.values, self._at_work = answer, False

    def close(self) -> None:
        """End the plant, what it is at included; more than once does no harm."""
        self._at_work, self._closed = False, True
        self._plant.close()


def step_all(plants: Iterable[HostedPlant], patience: float) -> None:
    """Step plants side by side.

    Args:
        plants: may name a plant more than once; it steps once.
        patience: seconds to wait for all of them together. One that was late before is not
            waited for again.
    """
    distinct = list(dict.fromkeys(plants))
    waited_for = [plant for plant in distinct if plant.is_fresh]
    for plant in distinct:
        plant.begin()
    until = monotonic() + patience
    for plant in waited_for:
        plant.finish(max(0.0, until - monotonic()))
