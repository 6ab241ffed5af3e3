"""Example 1 under a supervisor, with everything it did on record."""

from __future__ import annotations

import math

import numpy as np

from compensator import Action, Supervisor, SupervisorSettings, SupervisorState, UnawareMpc
from compensator.supervising.record_check import RecordCheckSettings
from fieldlink.lab.study.closed_loop import EXAMPLE_1, Plant
from loop_model import LoopModel, ProcessModel

REST = EXAMPLE_1.process.gain * 50.0
"""PV at which the plant rests at the start."""
UNCHECKED = SupervisorSettings(check=RecordCheckSettings(shortest=10**6))
"""For tests of the watch: the record refuses no model beforehand."""


def wrong_sign() -> LoopModel:
    """Return the model of Example 1 with the gain's sign turned."""
    p = EXAMPLE_1.process
    return LoopModel(EXAMPLE_1.valve, ProcessModel(p.a, tuple(-b for b in p.b), 1, 0.0, 1.0))


class Loop:
    """A run; `run` adds scans to it."""

    def __init__(self, seed: int = 4, settings: SupervisorSettings | None = None) -> None:
        self.supervisor = Supervisor(UnawareMpc(EXAMPLE_1.process), settings)
        self.plant = Plant(EXAMPLE_1.process, EXAMPLE_1.valve, 50.0, 48.0)
        self.noise = np.random.default_rng(seed).normal(0.0, 0.01, 5000)
        self.pv: list[float] = []
        self.op: list[float] = [50.0]
        self.stem: list[float] = [48.0]
        self.states: list[SupervisorState] = []
        self.frictions: list[tuple[float, float]] = []
        self.actions: list[Action] = []

    def run(
        self,
        samples: int,
        sp: float = REST + 2.5,
        *,
        bad: bool = False,
        manual: float | None = None,
    ) -> None:
        for _ in range(samples):
            pv = self.plant.pv
            action = self.supervisor.step(
                math.nan if bad else pv, sp, self.op[-1], automatic=manual is None
            )
            op = action.op if manual is None else manual
            self.plant.step(op, float(self.noise[len(self.pv)]))
            self.pv.append(pv)
            self.op.append(op)
            self.stem.append(self.plant.stem)
            self.states.append(self.supervisor.state)
            self.actions.append(action)
            model = self.supervisor.model
            if model is not None:
                valve = model.valve
                self.frictions.append((valve.static_friction, valve.dynamic_friction))

    def std(self, start: int, stop: int | None = None) -> float:
        return float(np.std(self.pv[start:stop]))
