"""What a sweep runs: values to combine, values to draw, and the parameters of each run.

Every run is decided by the plan and its number alone, so that it is the same in any order and after
a restart.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import scipy

from .catalogue import CatalogueModel, LoopVariables, catalogue
from .errors import PlantInputError, PlantNameError, nearest
from .start_values import StartValue

__all__ = ["Design", "Sweep"]

Design = Literal["random", "latin"]
_OP_START = 40.0
"""Percent, where a plant of the catalogue rests at the start: off the set-point of its controller,
so that a valve that sticks shows it soon."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """What to run.

    Attributes:
        model: a plant of the catalogue, with its controller inside, or the path of any FMU, which
            ends in ``.fmu``.
        steps: of each run.
        grid: values to combine, by parameter; of string variables texts.
        random: low and high of values drawn again for each run, by parameter.
        fixed: parameters of every run. For a plant of the catalogue ``controller`` is 1 and the
            plant rests at OP 40 % at the start unless they say otherwise.
        runs: for each point of the grid; for a plant of the catalogue each with a noise of its own.
        seed: of the whole sweep.
        loop: number of the loop that is recorded, from 0, where a plant of the catalogue has
            several.
        design: how values are drawn: "random", evenly and independent, or "latin", a Latin
            hypercube over the runs of each point of the grid, which covers every range evenly.
        period: seconds a step; None takes the FMU's default experiment.
        kind: "co-simulation" or "model exchange"; None takes the first that it offers.
        timeout: seconds that one step of an FMU that is not of the catalogue may take.
        whole: parameters that take whole numbers; `run_sweep` reads them from the FMU.
    """

    model: str
    steps: int
    grid: Mapping[str, tuple[StartValue, ...]] = field(default_factory=dict)
    random: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    fixed: Mapping[str, StartValue] = field(default_factory=dict)
    runs: int = 1
    seed: int = 1
    loop: int = 0
    design: Design = "random"
    period: float | None = None
    kind: str | None = None
    timeout: float = 30.0
    whole: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.plant is None and not self.model.endswith((".fmu", ".ssp")):
            raise PlantNameError(
                f"the catalogue has no plant {self.model!r}; {nearest(self.model, catalogue)}; the "
                "path of an FMU ends in .fmu"
            )
        if self.steps < 1 or self.runs < 1:
            raise PlantInputError(
                f"a sweep needs at least one step and one run; got {self.steps}, {self.runs}"
            )
        loops = len(self.plant.loops) if self.plant is not None else 1
        if not 0 <= self.loop < loops:
            raise PlantInputError(
                f"{self.model} has {loops} loops; loop {self.loop} is none of them (the first is 0)"
            )
        for name, values in self.grid.items():
            if not values or not all(isinstance(v, str) or math.isfinite(v) for v in values):
                shown = ", ".join(map(str, values)) or "none"
                raise PlantInputError(f"{name}: give at least one finite value; got {shown}")
        for name, (low, high) in self.random.items():
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise PlantInputError(f"{name}: give low <= high, finite; got {low:g}, {high:g}")
        twice = [n for n in (*self.random, *self.fixed) if n in self.grid]
        twice += [n for n in self.random if n in self.fixed]
        if twice:
            raise PlantInputError(f"{', '.join(twice)}: given more than once in the sweep")

    @property
    def plant(self) -> CatalogueModel | None:
        """The plant of the catalogue; None for an FMU by its path."""
        return catalogue.get(self.model)

    @property
    def file(self) -> Path:
        """The path of an FMU that is not of the catalogue."""
        return Path(self.model)

    @property
    def count(self) -> int:
        """How many runs it has."""
        return math.prod(len(values) for values in self.grid.values()) * self.runs

    @property
    def names(self) -> LoopVariables:
        """The variables of the loop that is recorded, of a plant of the catalogue."""
        return catalogue[self.model].loops[self.loop]

    def parameters(self, number: int) -> dict[str, StartValue]:
        """Return the parameters of run ``number``, from 0."""
        point, place = divmod(number, self.runs)
        values = next(itertools.islice(itertools.product(*self.grid.values()), point, None))
        chosen: dict[str, StartValue] = {}
        if self.plant is not None:
            chosen["seed"] = float(1 + (self.seed * 1_000_003 + number) % 2**31)
            for loop in self.plant.loops:
                chosen |= {loop.controller: 1.0, f"{loop.op}_start": _OP_START}
        chosen |= self.fixed
        for name, value in zip(self.grid, values, strict=True):
            chosen[name] = value if isinstance(value, str) else float(value)
        return chosen | self._drawn(number, point, place)

    def _drawn(self, number: int, point: int, place: int) -> dict[str, float]:
        if not self.random:
            return {}
        if self.design == "latin":
            cube = scipy.stats.qmc.LatinHypercube(
                len(self.random), rng=np.random.default_rng([self.seed, point])
            )
            parts = cube.random(self.runs)[place]
        else:
            parts = np.random.default_rng([self.seed, number]).random(len(self.random))
        drawn = {}
        for (name, (low, high)), part in zip(self.random.items(), parts, strict=True):
            if name in self.whole:
                drawn[name] = float(min(math.floor(low + part * (high - low + 1.0)), high))
            else:
                drawn[name] = float(low + part * (high - low))
        return drawn
