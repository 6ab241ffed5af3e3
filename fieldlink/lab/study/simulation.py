"""A closed-loop study as the command line asks for it: plant, set-points, mismatch, controllers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from compensator import ActionStatus, OpLimits
from estimator import identify
from fieldlink.errors import FieldlinkError
from fieldlink.lab.study.closed_loop import Performance, Study, Trace, assess, drive
from fieldlink.lab.study.controllers import Setup, mismatched, staged
from fieldlink.lab.study.fmu_plant import FmuPlant
from fmu_models import CatalogueModel, catalogue, open_plant
from loop_model import LoopModel

__all__ = ["Simulation", "SimulationError", "SimulationResult", "simulate"]


class SimulationError(FieldlinkError):
    """A study that cannot be run as asked."""


@dataclass(frozen=True, slots=True)
class Simulation:
    """What to simulate.

    Attributes:
        plant: name in the catalogue, of a plant with a linear model.
        controllers: names of `fieldlink.lab.study.controllers.CONTROLLERS`.
        take_over: sample at which the controller under study gets the loop.
        samples: length of the run.
        setpoint: ``((sample, value), ...)``; empty takes one step before and two after take-over.
        load: ``((sample, value), ...)`` in the plant's own units.
        parameters: of the plant, such as ``noise_std`` or ``valve``.
        seed: of the plant's noise.
        rate: largest change of OP per scan.
        valve_error, gain_error: factors on the frictions and the gain in the compensators' model.
        identified: whether they use the model that `estimator.identify` finds before the take-over.
    """

    plant: str
    controllers: tuple[str, ...] = ("unaware", "hybrid")
    take_over: int = 600
    samples: int = 1200
    setpoint: tuple[tuple[int, float], ...] = ()
    load: tuple[tuple[int, float], ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    seed: int = 1
    rate: float = float("inf")
    valve_error: float = 1.0
    gain_error: float = 1.0
    identified: bool = False


@dataclass(frozen=True, slots=True)
class SimulationResult:
    """One controller's run.

    Attributes:
        controller: its name.
        trace: the signals.
        before, after: figures of the samples before and after the take-over (a tenth of each part
            is left out at its beginning).
        model: the compensator's model; None for a controller without one.
        fell_back: why a supervised compensator lost the loop; empty if it did not.
        milliseconds: median and 99th percentile of processor time to decide; None where the
            controller decided nothing.
    """

    controller: str
    trace: Trace
    before: Performance
    after: Performance
    model: LoopModel | None
    fell_back: str
    milliseconds: tuple[float, float] | None

    def to_dict(self) -> dict[str, Any]:
        """Return the figures for JSON."""

        def part(p: Performance) -> dict[str, float]:
            return {name: float(getattr(p, name)) for name in Performance.__dataclass_fields__}

        valve = None if self.model is None else self.model.valve
        median, slowest = self.milliseconds or (None, None)
        counts = {s.name.lower(): self.trace.status.count(s) for s in ActionStatus}
        return {
            "controller": self.controller,
            "before": part(self.before),
            "after": part(self.after),
            "stick_band": None if valve is None else valve.stick_band,
            "slip_jump": None if valve is None else valve.slip_jump,
            "fell_back": self.fell_back,
            "decide_ms_median": median,
            "decide_ms_p99": slowest,
            "statuses": {name: count for name, count in counts.items() if count},
        }


def simulate(simulation: Simulation) -> list[SimulationResult]:
    """Run the study, one controller after the other under the same noise.

    Raises:
        SimulationError: the plant has no linear model, or numbers do not fit each other.
        PlantError: the plant refuses its parameters.
        CompensatorError: a controller cannot be built.
    """
    known = _known(simulation.plant)
    assert known.process is not None
    if not 100 <= simulation.take_over < simulation.samples - 50:
        raise SimulationError(
            f"the take-over at sample {simulation.take_over} must leave 100 samples before it and "
            f"50 after it of {simulation.samples}; change --take-over or --samples"
        )
    limits = OpLimits(*known.op_range, simulation.rate)
    truth = LoopModel(_valve(known, simulation.parameters), known.process)
    study = Study(_setpoint(simulation, known), simulation.samples, simulation.load)
    believed: LoopModel | None = mismatched(
        truth, valve=simulation.valve_error, gain=simulation.gain_error
    )
    if simulation.identified:
        plain = Setup(known.process, None, limits)
        believed = _identified(_run(simulation, "unaware", plain, study)[0], simulation, known)
    return [
        _result(simulation, name, Setup(known.process, believed, limits), study)
        for name in simulation.controllers
    ]


def _known(name: str) -> CatalogueModel:
    known = catalogue.get(name)
    if known is None or known.process is None:
        usable = ", ".join(m.name for m in catalogue.values() if m.process is not None)
        raise SimulationError(
            f"{name!r} is not a catalogue plant with a linear model, which the plant's own "
            f"controller needs; choose one of {usable}"
        )
    return known


def _valve(known: CatalogueModel, parameters: Mapping[str, float]) -> Any:
    valve = known.valve
    return type(valve)(
        parameters.get("stick_band", valve.stick_band), parameters.get("slip_jump", valve.slip_jump)
    )


def _opened(simulation: Simulation) -> FmuPlant:
    parameters = {"op_start": 50.0, "seed": float(simulation.seed), **simulation.parameters}
    return FmuPlant(open_plant(simulation.plant, parameters=parameters, isolated=False))


def _setpoint(simulation: Simulation, known: CatalogueModel) -> Sequence[tuple[int, float]]:
    with _opened(simulation) as plant:
        rest = round(plant.pv, 2)
    if simulation.setpoint:
        given = simulation.setpoint
        return given if given[0][0] == 0 else ((0, rest), *given)
    assert known.process is not None
    scale = 1.0 if known.process.is_integrating else abs(known.process.gain)
    after = simulation.samples - simulation.take_over
    first, step = rest + 2.5 * scale, 8.0 * scale
    third = simulation.take_over + after // 3
    return ((0, rest), (40, first), (third, first + step), (third + after // 3, first))


def _run(simulation: Simulation, name: str, setup: Setup, study: Study) -> tuple[Trace, Any]:
    made = staged(name, setup, simulation.take_over)
    with _opened(simulation) as plant:
        return drive(plant, made.controller, study), made


def _identified(trace: Trace, simulation: Simulation, known: CatalogueModel) -> LoopModel | None:
    part = slice(min(80, simulation.take_over // 4), simulation.take_over)
    found = identify(trace.op[part], trace.pv[part], sp=trace.sp[part], period=known.period)
    return found.model if found.verdict.value == "stiction" else None


def _result(simulation: Simulation, name: str, setup: Setup, study: Study) -> SimulationResult:
    trace, made = _run(simulation, name, setup, study)
    at = simulation.take_over
    ms = 1e3 * np.asarray(made.timing.decide)
    return SimulationResult(
        controller=name,
        trace=trace,
        before=assess(trace, at // 10, at),
        after=assess(trace, at + (simulation.samples - at) // 10),
        model=setup.model,
        fell_back=made.fell_back,
        milliseconds=(float(np.median(ms)), float(np.percentile(ms, 99))) if ms.size else None,
    )
