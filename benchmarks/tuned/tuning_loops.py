"""Loops of the tuning family, run and judged as those of `benchmarks.apart` are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.apart.loops import Loop, Plant
from benchmarks.tuned.linear_plants import PROCESSES, VALVES, LinearPlant
from compensator import Controller, MpcSettings, NoiseModel, PiController, PiSettings, UnawareMpc
from loop_model import LoopModel, ProcessModel, ValveModel

__all__ = ["TunedLoop"]


@dataclass(frozen=True, slots=True)
class TunedLoop(Loop):
    """A loop of the tuning family; see `Loop`."""

    @classmethod
    def of(cls, process: str, valve: str, own: str, *, driven: bool = False) -> TunedLoop:
        """Return the loop of a process with the valve that belongs to it."""
        p = PROCESSES[process]
        return cls(
            process, valve, own, p.band, p.jump, noise=0.02 if driven else 0.04, driven=driven
        )

    @property
    def scale(self) -> float:
        """See `Loop.scale`."""
        p = PROCESSES[self.process]
        return p.gain * (20.0 if p.integrating else 1.0)

    def make_plant(self, seed: int) -> Plant:
        """See `Loop.make_plant`."""
        rng = np.random.default_rng((seed, 77))
        valve = VALVES[self.valve](self.band, self.jump, 49.0, rng)
        return LinearPlant(PROCESSES[self.process], valve)

    def make_controller(self) -> Controller:
        """See `Loop.make_controller`."""
        model = PROCESSES[self.process].model()
        if self.own == "pi":
            return PiController(_brisk(model))
        if self.own == "calm":  # it travels so little that each needless move shows
            return PiController(PiSettings.simc(model))
        if self.own == "restless":
            return UnawareMpc(model, MpcSettings(op_weight=0.15))
        if model.is_integrating:  # tuned to leave its measurement's noise alone
            return UnawareMpc(model, MpcSettings(op_weight=0.1, noise=NoiseModel(0.1, 1.0, 0.02)))
        return UnawareMpc(model)

    def true_model(self) -> LoopModel:
        """See `Loop.true_model`."""
        return LoopModel(ValveModel(self.band, self.jump), PROCESSES[self.process].model())


def _brisk(process: ProcessModel) -> PiSettings:
    """Return a PI tuned twice as fast as Skogestad advises: such loops show their valve."""
    settings = PiSettings.simc(process)
    return replace(settings, gain=1.3 * settings.gain, integral_time=0.6 * settings.integral_time)
