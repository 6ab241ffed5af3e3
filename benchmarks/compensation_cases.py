"""The loops of the compensation benchmark, how each is run, and the figures taken of a run.

A run has three parts: the stiction-unaware MPC until the limit cycle stands (`WARM` samples), then
the controller under study, with one set-point step up and one back. Figures of the steady state are
taken from each step once the loop had time to settle, and put together as root mean squares.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from compensator import OpLimits
from compensator.prediction import Prediction, settling_samples
from estimator import identify
from fieldlink.lab.study.closed_loop import Performance, Study, Trace, assess, drive
from fieldlink.lab.study.controllers import Setup, StagedRun, mismatched, staged
from fieldlink.lab.study.fmu_plant import FmuPlant
from fmu_models import catalogue, open_plant
from loop_model import LoopModel

__all__ = [
    "CASES",
    "MISMATCHES",
    "WARM",
    "Case",
    "Figures",
    "figures_of",
    "held",
    "model_of",
    "play",
]

WARM = 1080
SEGMENT = 600
_FIRST = 40


@dataclass(frozen=True, slots=True)
class Case:
    """A loop.

    Attributes:
        name: for the table.
        plant: of the catalogue.
        parameters: of the plant, beside its seed and first OP.
        step: of the set-point, in PV.
        nudge: set-point step that starts the limit cycle.
    """

    name: str
    plant: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    step: float = 10.0
    nudge: float = 2.5

    @property
    def model(self) -> LoopModel:
        """The true valve (of its equivalent, for other physics) and process."""
        known = catalogue[self.plant]
        assert known.process is not None
        return LoopModel(known.valve, known.process)

    @property
    def settling(self) -> int:
        """Samples that a step is given to settle."""
        return min(150, 40 + 2 * settling_samples(Prediction.of(self.model.process, "input")))


CASES = (
    Case("Example 1, He", "example1"),
    Case("Example 2, He", "example2"),
    Case("Example 1, Kano", "example1", {"valve": 2.0}),
    Case("physical, Karnopp", "physical", {"valve": 4.0}),
    Case("physical, LuGre", "physical", {"valve": 5.0}),
    Case("level, integrating", "level", step=5.0, nudge=2.0),
    Case("heat exchanger, dead time", "heat", step=5.0, nudge=1.5),
)

MISMATCHES: Mapping[str, Mapping[str, float]] = {
    "exact": {},
    "valve -20 %": {"valve": 0.8},
    "valve -10 %": {"valve": 0.9},
    "valve +10 %": {"valve": 1.1},
    "valve +20 %": {"valve": 1.2},
    "gain -20 %": {"gain": 0.8},
    "gain -10 %": {"gain": 0.9},
    "gain +10 %": {"gain": 1.1},
    "gain +20 %": {"gain": 1.2},
    "all -20 %": {"valve": 0.8, "gain": 0.8},
    "all +20 %": {"valve": 1.2, "gain": 1.2},
}


@dataclass(frozen=True, slots=True)
class Figures:
    """What a run is judged by; the steady state is what follows each step's settling time.

    Attributes:
        pv_std: PV's standard deviation (its own mean in each segment taken away).
        pv_rms: root mean square of PV minus SP.
        offset: mean over the steps of the size of PV's mean distance from SP, less the mean that
            the same noise has with the stem held (NaN where that is not known).
        raw_offset: the same with the noise's mean in it.
        iae: sum of ``|SP - PV|`` over both steps, per sample.
        travel, reversals: of the stem in the steady state, per 100 samples.
        op_travel: of OP in the steady state, per 100 samples.
        settling: samples after a step until PV stays near SP (within a tenth of the step or four
            deviations of the held stem's noise), the segment's length if never.
    """

    pv_std: float
    pv_rms: float
    offset: float
    raw_offset: float
    iae: float
    travel: float
    reversals: float
    op_travel: float
    settling: float


def rest_of(case: Case) -> float:
    """PV at which the plant rests at the start."""
    known = catalogue[case.plant]
    assert known.process is not None
    if known.process.is_integrating:
        return 50.0
    return known.process.gain * 50.0 + known.process.offset / (1.0 + sum(known.process.a))


def study_of(case: Case, samples: int | None = None) -> Study:
    """Return the set-points of a run."""
    first = rest_of(case) + case.nudge
    changes = [(0, rest_of(case)), (_FIRST, first), (WARM + 60, first + case.step)]
    changes.append((WARM + 60 + SEGMENT, first))
    return Study(changes, samples or WARM + 60 + 2 * SEGMENT)


def opened(case: Case, seed: int, *, healthy: bool = False) -> FmuPlant:
    """The plant of a case at rest."""
    parameters = {"op_start": 50.0, "seed": float(seed), **case.parameters}
    if healthy:
        parameters["valve"] = 0.0
    return FmuPlant(open_plant(case.plant, parameters=parameters, isolated=False))


def play(
    case: Case,
    controller: str,
    setup: Setup,
    seed: int,
    *,
    healthy: bool = False,
    watched: bool = True,
) -> tuple[Trace, StagedRun]:
    """Run a case; deterministic for its seed. Unless ``watched`` the loop is not given back for
    being worse: what a method does by itself.
    """
    made = staged(controller, setup, WARM, watched=watched)
    with opened(case, seed, healthy=healthy) as plant:
        return drive(plant, made.controller, study_of(case)), made


def segments(case: Case) -> list[tuple[int, int]]:
    """Begin and end of each set-point's steady state."""
    first = WARM + 60
    return [
        (first + case.settling, first + SEGMENT),
        (first + SEGMENT + case.settling, first + 2 * SEGMENT),
    ]


def figures_of(case: Case, trace: Trace, seed: int) -> Figures:
    """Take the figures of a run with the noise of ``seed``."""
    parts: list[Performance] = []
    offsets, raw, settled = [], [], []
    noise, alone = held(case, seed), _noise_alone(case.name, seed)
    for begin, end in segments(case):
        part = assess(trace, begin, end)
        parts.append(part)
        raw.append(abs(part.offset))
        offsets.append(abs(part.offset - float(np.mean(alone[begin:end]))))
        stepped = begin - case.settling
        band = max(0.1 * case.step, 4.0 * noise if math.isfinite(noise) else 0.0)
        outside = np.flatnonzero(np.abs(trace.pv - trace.sp)[stepped:end] > band)
        settled.append(float(outside[-1]) + 1.0 if outside.size else 0.0)
    samples = sum(part.samples for part in parts)

    def per_100(name: str) -> float:
        return 100.0 * sum(float(getattr(part, name)) for part in parts) / samples

    return Figures(
        pv_std=float(np.sqrt(np.mean([p.pv_std**2 for p in parts]))),
        pv_rms=float(np.sqrt(np.mean([p.rms**2 for p in parts]))),
        offset=float(np.mean(offsets)),
        raw_offset=float(np.mean(raw)),
        iae=assess(trace, WARM + 60).iae / (2 * SEGMENT),
        travel=per_100("travel"),
        reversals=per_100("reversals"),
        op_travel=per_100("op_travel"),
        settling=float(np.mean(settled)),
    )


@lru_cache(maxsize=64)
def _noise_alone(name: str, seed: int) -> NDArray[np.float64]:
    """PV less its rest with the stem held; NaN where an integrating process drifts away."""
    case = next(c for c in CASES if c.name == name)
    samples = WARM + 60 + 2 * SEGMENT
    if case.model.process.is_integrating:
        return np.full(samples, np.nan)
    with opened(case, seed) as plant:
        return np.array([plant.step(50.0) for _ in range(samples)]) - rest_of(case)


def held(case: Case, seed: int) -> float:
    """PV's deviation in the steady-state samples with the stem held: noise alone; NaN where an
    integrating process drifts away.
    """
    alone = _noise_alone(case.name, seed)
    return float(np.sqrt(np.mean([np.var(alone[begin:end]) for begin, end in segments(case)])))


def model_of(case: Case, trace: Trace, mismatch: str) -> tuple[LoopModel | None, str]:
    """The model that compensators get, and words on it; ``identified`` looks at the limit cycle
    of ``trace`` before the take-over, all else is the truth made wrong.
    """
    if mismatch != "identified":
        return mismatched(case.model, **MISMATCHES[mismatch]), ""
    part = slice(_FIRST + 40, WARM)
    period = case.model.process.period
    result = identify(trace.op[part], trace.pv[part], sp=trace.sp[part], period=period)
    if result.model is None or result.verdict.value != "stiction":
        return None, result.verdict.value
    valve = result.model.valve
    words = f"S {valve.stick_band:.3g}, J {valve.slip_jump:.3g}, {result.process.structure}"
    return result.model, words


def limits_of(case: Case) -> OpLimits:
    """The range of OP."""
    return OpLimits(*catalogue[case.plant].op_range)
