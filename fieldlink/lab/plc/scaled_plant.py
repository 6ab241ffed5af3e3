"""A plant whose inputs take OP in other units than percent, such as an opening from 0 to 1."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmu_models import Piece, Plant, PlantInfo

__all__ = ["ScaledPlant"]


class ScaledPlant(Plant):
    """A plant behind factors of its inputs; everything else is the plant's own.

    Args:
        plant: the plant.
        scales: by input, what the plant takes for one unit of what `step` is given.
    """

    def __init__(self, plant: Plant, scales: Mapping[str, float]) -> None:
        self._plant = plant
        self._scales = dict(scales)

    @property
    def info(self) -> PlantInfo:
        """What the plant is."""
        return self._plant.info

    @property
    def time(self) -> float:
        """Simulated seconds."""
        return self._plant.time

    def outputs(self) -> dict[str, float]:
        """Return the outputs at the present time."""
        return self._plant.outputs()

    def step(self, inputs: Mapping[str, float]) -> dict[str, float]:
        """Apply scaled inputs, advance one period, return all outputs."""
        return self._plant.step(self._scaled(inputs))

    def steps(self, inputs: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
        """Return what `step` returns for each of ``inputs`` in turn."""
        return self._plant.steps([self._scaled(one) for one in inputs])

    def run_pieces(
        self, count: int, inputs: Mapping[str, ArrayLike], *, last: float | None = None
    ) -> Iterator[Piece]:
        """Step ``count`` times with scaled inputs and yield the steps as they are done."""
        scaled: dict[str, NDArray[np.float64]] = {
            name: np.asarray(value, dtype=np.float64) * self._scales.get(name, 1.0)
            for name, value in inputs.items()
        }
        return self._plant.run_pieces(count, scaled, last=last)

    def take_intermediate(self) -> Piece:
        """Return the outputs between the ends of steps since this was called last."""
        return self._plant.take_intermediate()

    def snapshot(self) -> bytes:
        """Return the plant's whole state."""
        return self._plant.snapshot()

    def restore(self, snapshot: bytes) -> None:
        """Go back to a state that `snapshot` returned."""
        self._plant.restore(snapshot)

    def close(self) -> None:
        """End the plant."""
        self._plant.close()

    def _scaled(self, inputs: Mapping[str, float]) -> dict[str, float]:
        return {name: value * self._scales.get(name, 1.0) for name, value in inputs.items()}
