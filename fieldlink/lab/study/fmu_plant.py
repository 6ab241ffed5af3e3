"""A plant of `fmu_models` as the closed loop of a study takes it."""

from __future__ import annotations

import math
from types import TracebackType
from typing import Self

from fmu_models import Plant

__all__ = ["FmuPlant"]


class FmuPlant:
    """A plant of `fmu_models` for `fieldlink.lab.study.closed_loop`; it makes its own noise.

    Args:
        plant: open, with input ``op`` and outputs ``pv`` and, where it knows it, ``stem``.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._outputs = plant.outputs()

    @property
    def pv(self) -> float:
        """PV now."""
        return self._outputs["pv"]

    @property
    def stem(self) -> float:
        """Stem position; NaN if the plant does not tell."""
        return self._outputs.get("stem", math.nan)

    def step(self, op: float, noise: float = 0.0, load: float = 0.0) -> float:
        """Apply OP (and a load, in the plant's own units) for one period."""
        inputs = {"op": op}
        if load or "load" in self._plant.info.inputs:
            inputs["load"] = load
        self._outputs = self._plant.step(inputs)
        return self.pv + noise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._plant.close()
