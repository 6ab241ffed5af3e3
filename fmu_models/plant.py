"""What a running plant offers, wherever it runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import PlantInputError

__all__ = ["Piece", "Plant", "PlantInfo"]


@dataclass(frozen=True, slots=True)
class PlantInfo:
    """What a plant is, from its model description.

    Attributes:
        name: the model's name.
        fmi_version: such as "2.0" or "3.0".
        kind: "co-simulation" or "model exchange".
        period: seconds that one step advances.
        inputs: names that `Plant.step` takes.
        tunable: parameters that `Plant.step` takes too.
        outputs: names that come back; those that are watched stand last.
        parameters: names that can be given when the plant is opened (start values of inputs too).
        can_restore: whether the FMU offers snapshots.
        can_vary_step: whether one step may be shorter than the others.
    """

    name: str
    fmi_version: str
    kind: str
    period: float
    inputs: tuple[str, ...]
    tunable: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    can_restore: bool
    can_vary_step: bool = False


@dataclass(frozen=True, slots=True)
class Piece:
    """Steps of a run that are done.

    Attributes:
        time: simulated seconds at the end of each step, shape ``(n,)``.
        columns: every output by name, each ``(n,)``.
    """

    time: NDArray[np.float64]
    columns: dict[str, NDArray[np.float64]]


class Plant(ABC):
    """A plant that is stepped by hand: read PV, decide OP, `step`.

    After opening, `outputs` holds the values at the start (``pv_0``); ``step({"op": op_k})``
    applies OP, advances one period and returns ``pv_(k+1)``. An input that is not given keeps its
    value. A plant that failed stays failed; `close` it always, or use it in a ``with`` block.
    """

    @property
    @abstractmethod
    def info(self) -> PlantInfo:
        """What the plant is."""

    @property
    @abstractmethod
    def time(self) -> float:
        """Simulated seconds: start time plus steps times period."""

    @abstractmethod
    def outputs(self) -> dict[str, float]:
        """Return the outputs at the present time."""

    @abstractmethod
    def step(self, inputs: Mapping[str, float]) -> dict[str, float]:
        """Apply inputs (or tunable parameters), advance one period, return all outputs.

        Raises:
            PlantNameError: a name that is neither an input nor a tunable parameter.
            PlantInputError: a value that is not finite, or no whole number where one is needed.
            PlantStepError: the FMU refused, or put out NaN or infinity.
            PlantCrashError: its process died or did not answer.
        """

    @abstractmethod
    def steps(self, inputs: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
        """Return what `step` returns for each of ``inputs`` in turn; one message for many steps."""

    def run(self, count: int, inputs: Mapping[str, ArrayLike]) -> dict[str, NDArray[np.float64]]:
        """Step ``count`` times and return every output as an array of shape ``(count,)``.

        The same numbers as `steps`, several times as fast: arrays go in and come out.

        Args:
            count: of steps.
            inputs: by name, a number that holds from the first step on or an array ``(count,)``.

        Raises:
            PlantError: as `step` does; `run_pieces` keeps the steps before.
        """
        pieces = list(self.run_pieces(count, inputs))
        names = self.info.outputs
        if len(pieces) == 1:
            return pieces[0].columns
        empty = [np.empty(0)]
        return {
            name: np.concatenate([piece.columns[name] for piece in pieces] or empty)
            for name in names
        }

    @abstractmethod
    def run_pieces(
        self, count: int, inputs: Mapping[str, ArrayLike], *, last: float | None = None
    ) -> Iterator[Piece]:
        """Step ``count`` times and yield the steps as they are done, some at a time.

        What is done before a failure, or before Ctrl-C, is yielded before the error is raised. An
        FMU that ends its simulation between two steps yields a last row at that moment.

        Args:
            count: of steps.
            inputs: by name, a number that holds from the first step on or an array ``(count,)``.
            last: seconds of the last step, where it is shorter than the period.

        Raises:
            PlantEndedError: the FMU ended its simulation.
            PlantError: as `step` does.
        """

    def take_intermediate(self) -> Piece:
        """Return the outputs between the ends of steps since this was called last.

        Raises:
            PlantInputError: the plant was not opened with ``intermediate``.
        """
        raise PlantInputError(
            f"plant {self.info.name}: outputs between the ends of a step are not kept; open it "
            "with intermediate=True"
        )

    @abstractmethod
    def snapshot(self) -> bytes:
        """Return the plant's whole state, time included.

        Raises:
            PlantStepError: the FMU does not offer it.
        """

    @abstractmethod
    def restore(self, snapshot: bytes) -> None:
        """Go back to a state that `snapshot` returned, of this plant or of another of its model."""

    @abstractmethod
    def close(self) -> None:
        """End the plant and remove what it left on disk; more than once does no harm."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
