"""The plants of the random loops: linear processes and FMUs of the catalogue behind one face."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from typing import Protocol

from benchmarks.examples import sampled
from benchmarks.loops import FMU_PLANTS, Loop
from estimator.valves import ChoudhuryValve, HeValve, KanoValve, SlipStickValve
from fieldlink.lab.study.closed_loop import Plant as LinearPlant
from fieldlink.lab.study.closed_loop import StemLaw
from fmu_models import Plant, open_plant
from loop_model import ProcessModel

__all__ = ["REST", "LoopPlant", "open_loop_plant", "process_of", "valve_law"]

REST = 50.0
"""OP at which every plant rests at the start."""

_SAMPLED: dict[str, type[SlipStickValve]] = {
    "He": HeValve,
    "Kano": KanoValve,
    "Choudhury": ChoudhuryValve,
}
_CODES = {"healthy": 0, "He": 1, "Kano": 2, "Choudhury": 3, "Karnopp": 4, "LuGre": 5}


class LoopPlant(Protocol):
    """What a loop needs of its plant; ``load`` is given in percent of OP."""

    pv: float
    stem: float

    def step(self, op: float, noise: float = 0.0, load: float = 0.0) -> float:
        """Apply OP and load for one period; return PV at its end."""


def process_of(loop: Loop) -> ProcessModel:
    """The plant's linear process around OP 50, period 1; the FMUs' is their linearisation."""
    constant = loop.time_constant
    if loop.plant in ("integrating", "level"):
        slope = 0.2 * loop.sampling
        return ProcessModel((-1.0,), (slope,), 1, -slope * REST, 1.0)
    gain = _GAIN.get(loop.plant, 1.0)
    lags = (constant, _SECOND[loop.plant] * constant) if loop.plant in _SECOND else (constant,)
    model = sampled(*lags, gain=gain)
    return replace(
        model, dead_time=1 + loop.dead_time, offset=-REST * model.gain * (1.0 + sum(model.a))
    )


_SECOND = {"second order": 0.5, "heat": 0.25}
"""Second lag over the first."""

_GAIN = {"flow": 1.012, "pressure": 0.0967, "heat": 0.8}
"""PV per OP at OP 50 with the parameters below: derivative of the models' steady state."""

_LOAD = {"flow": 3.2, "pressure": -2.0}
"""Load in the FMU's units that does to PV what one percent of OP does."""

_PRESSURE_CONSTANT = 3.98
"""Time constant over ``volume`` of the gas vessel at OP 50 (linearised)."""


def _fmu_parameters(loop: Loop) -> dict[str, float]:
    constant = loop.time_constant
    own: dict[str, dict[str, float]] = {
        "flow": {"time_constant": constant},
        "pressure": {"volume": constant / _PRESSURE_CONSTANT},
        "heat": {
            "time_constant1": constant,
            "time_constant2": 0.25 * constant,
            "dead_time": loop.dead_time,
        },
        "level": {"fill_time": 5.0 * constant},
        "physical": {"time_constant": constant},
    }
    return {
        "op": REST,
        "op_start": REST,
        "valve": _CODES[loop.physics],
        "stick_band": loop.stick_band,
        "slip_jump": loop.slip_jump,
        "noise_std": 0.0,
        **own[loop.plant],
    }


class _FmuPlant:
    """An FMU as a `LoopPlant`: PV is the change from its start, noise-free."""

    def __init__(self, plant: Plant, load: float) -> None:
        self._plant, self._load = plant, load
        first = plant.outputs()
        self._zero = first["pv"]
        self.pv, self.stem = 0.0, first["stem"]

    def step(self, op: float, noise: float = 0.0, load: float = 0.0) -> float:
        """See `LoopPlant`; the FMU has no equation noise."""
        if noise != 0.0:
            raise ValueError("the FMU plants take measurement noise only")
        out = self._plant.step({"op": op, "load": load * self._load})
        self.pv, self.stem = out["pv"] - self._zero, out["stem"]
        return self.pv


class _Memory:
    """A valve model with memory as a law of ``(stem, op)``."""

    def __init__(self, valve: SlipStickValve) -> None:
        self._valve = valve
        self._state = valve.start(REST, REST)

    def __call__(self, _stem: float, op: float) -> float:
        self._state = self._valve.step(self._state, op)
        return self._state.stem


def _pneumatic(plant: Plant) -> StemLaw:
    """The stem of the catalogue's actuator at the end of every period, as a law."""

    def law(_stem: float, op: float) -> float:
        return plant.step({"op": op})["stem"]

    return law


def valve_law(physics: str, stick_band: float, slip_jump: float, keep: ExitStack) -> StemLaw | None:
    """A valve as ``(stem, op) -> stem``, None when healthy; ``keep`` closes what it opens."""
    if physics == "healthy":
        return None
    if physics in _SAMPLED:
        return _Memory(_SAMPLED[physics](stick_band, slip_jump))
    parameters: dict[str, float] = {
        "op": REST,
        "op_start": REST,
        "valve": _CODES[physics],
        "stick_band": stick_band,
        "slip_jump": slip_jump,
    }
    return _pneumatic(keep.enter_context(_open("physical", parameters)))


def open_loop_plant(loop: Loop, keep: ExitStack) -> LoopPlant:
    """The loop's plant, at rest; ``keep`` closes it."""
    if loop.plant in FMU_PLANTS:
        plant = keep.enter_context(_open(loop.plant, _fmu_parameters(loop)))
        return _FmuPlant(plant, _LOAD.get(loop.plant, 1.0))
    law = valve_law(loop.physics, loop.stick_band, loop.slip_jump, keep)
    return LinearPlant(process_of(loop), law, REST)


def _open(name: str, parameters: dict[str, float]) -> Plant:
    return open_plant(name, parameters=parameters, period=1.0, isolated=False)
