"""A system of FMUs as one plant: the master that steps its components and carries values between.

All components take the same step. Two masters:

- Gauss-Seidel: a component gets what those before it in `SystemStructure.order` have just computed,
  and what those after it computed in the step before. For a control loop that names the controller
  first, then the valve, then the process, this is a controller that reads PV, a valve that follows
  its OP and a process that moves on under the stem.
- Jacobi: every component gets what the others computed in the step before, so the order does not
  matter and isolated components step side by side. Each connection delays by one step.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .columns import split_columns
from .errors import (
    PlantClosedError,
    PlantEndedError,
    PlantError,
    PlantFileError,
    PlantInputError,
    PlantNameError,
    PlantStepError,
    nearest,
)
from .inprocess import InProcessPlant
from .isolated import IsolatedPlant
from .opening import OpenOptions
from .plant import Piece, Plant, PlantInfo
from .ssp_components import extract_components, name_component, summarise_components
from .ssp_file import read_system
from .ssp_starts import resolve_starts
from .ssp_structure import Master, SystemStructure
from .ssp_texts import leave_out_texts
from .start_values import StartValue
from .summary import FmuSummary
from .system_values import SystemValues

__all__ = ["SystemPlant", "system_info"]

_PIECE_SECONDS = 0.1
"""Of the wall clock, after which rows are yielded."""
_WAIT = 1.0
"""Seconds of one look at a component that steps; how long it may take is its own timeout."""


def system_info(
    structure: SystemStructure, infos: Mapping[str, PlantInfo], period: float
) -> PlantInfo:
    """Return what a system is, from what its components are."""
    outputs = [f"{c}.{n}" for c, info in infos.items() for n in info.outputs]
    return PlantInfo(
        name=structure.name,
        fmi_version="SSP 1.0",
        kind="system of FMUs",
        period=period,
        inputs=tuple(structure.inputs),
        tunable=tuple(f"{c}.{n}" for c, info in infos.items() for n in info.tunable),
        outputs=(*structure.outputs, *outputs),
        parameters=(
            *structure.parameters,
            *(f"{c}.{n}" for c, info in infos.items() for n in info.parameters),
        ),
        can_restore=False,
        can_vary_step=all(info.can_vary_step for info in infos.values()),
    )


class SystemPlant(Plant):
    """A system of FMUs, started and at rest.

    Args:
        file: the ``.ssp``.
        parameters: start values by ``component.variable``, or inputs of the system by name.
        period: seconds a step; None takes that of the recorded run that the archive is an export
            of, else the shortest that one of the FMUs recommends.
        master: "gauss-seidel" or "jacobi"; None takes that of the recorded run, else Gauss-Seidel.
        kind: of every FMU; None takes the first that each offers.
        watch: further variables, ``component.variable``.
        isolated: run each FMU in a process of its own.
        timeout: seconds that one step of one FMU may take.

    Raises:
        PlantError: what `open_plant` says.
    """

    def __init__(
        self,
        file: Path,
        *,
        parameters: Mapping[str, StartValue],
        period: float | None = None,
        kind: str | None = None,
        watch: Sequence[str] = (),
        isolated: bool = True,
        timeout: float = 30.0,
        master: Master | None = None,
    ) -> None:
        if master is not None and master not in get_args(Master):
            raise PlantInputError(
                f"{file}: there is no master {master!r}; choose {' or '.join(get_args(Master))}"
            )
        self._structure = read_system(file)
        self._master: Master = master or self._structure.master or "gauss-seidel"
        self._plants: dict[str, Plant] = {}
        self._failure: str | None = None
        self._ended = False
        self._folder = tempfile.TemporaryDirectory(
            prefix="fieldlink-ssp-", ignore_cleanup_errors=True
        )
        try:
            files = extract_components(file, self._structure.sources, Path(self._folder.name))
            parts = summarise_components(file, files)
            leave_out_texts(self._structure, parts)
            step = period or self._structure.step or _shortest_step(file, parts)
            names = (*self._structure.inputs, *self._structure.parameters)
            own = {name: parameters[name] for name in names if name in parameters}
            self._values = values = SystemValues(self._structure, own)
            given = values.split({n: v for n, v in parameters.items() if n not in own})
            inner = [name for name in watch if name not in self._structure.outputs]
            wanted = values.split(dict.fromkeys(inner, 0.0))
            for component in self._structure.order():
                starts, _ = resolve_starts(self._structure, component, parts[component])
                for links in (self._structure.parameter_links, self._structure.links):
                    starts |= values.given_by(links[component])
                    starts |= values.texts_by(links[component])
                starts |= given.get(component, {})
                options = OpenOptions(starts, step, kind, tuple(wanted.get(component, ())))
                try:
                    self._plants[component] = (
                        IsolatedPlant(files[component], options, timeout)
                        if isolated
                        else InProcessPlant(files[component], options)
                    )
                except PlantFileError as error:
                    raise name_component(file, component, files[component], error) from error
                values.latest[component] = self._plants[component].outputs()
        except BaseException:
            self.close()
            raise
        infos = {component: plant.info for component, plant in self._plants.items()}
        self._info = system_info(self._structure, infos, step)

    @property
    def info(self) -> PlantInfo:
        """What the system is; variables of a component are ``component.variable``."""
        return self._info

    @property
    def time(self) -> float:
        """Simulated seconds."""
        return next(iter(self._plants.values())).time

    def outputs(self) -> dict[str, float]:
        """Return the outputs of the system, and of every component."""
        self._alive()
        own = self._values.given_by(self._structure.outputs)
        return own | {
            f"{c}.{name}": value
            for c, values in self._values.latest.items()
            for name, value in values.items()
        }

    def step(self, inputs: Mapping[str, float]) -> dict[str, float]:
        """Apply inputs, step every component once, return all outputs."""
        self._advance(inputs, None)
        return self.outputs()

    def _advance(self, inputs: Mapping[str, float], last: float | None) -> None:
        self._alive()
        for name in inputs:
            if name not in self._info.inputs and name not in self._info.tunable:
                known = (*self._info.inputs, *self._info.tunable)
                raise PlantNameError(
                    f"system {self._structure.name} has no input or tunable parameter {name!r}; "
                    f"{nearest(name, known)}"
                )
        self._values.inputs |= {
            n: float(v) for n, v in inputs.items() if n in self._structure.inputs
        }
        tuned = self._values.split({n: v for n, v in inputs.items() if n in self._info.tunable})
        try:
            if self._master == "jacobi":
                self._step_side_by_side(tuned, last)
            else:
                self._step_in_turn(tuned, last)
        except PlantError as error:
            self._failure = f"system {self._structure.name}: {error}"
            self._ended = isinstance(error, PlantEndedError)
            raise type(error)(self._failure) from error

    def _step_in_turn(self, tuned: Mapping[str, Mapping[str, float]], last: float | None) -> None:
        for component, plant in self._plants.items():
            fed = {
                **tuned.get(component, {}),
                **self._values.given_by(self._structure.links[component]),
            }
            self._values.latest[component] = _step_once(plant, fed, last)

    def _step_side_by_side(
        self, tuned: Mapping[str, Mapping[str, float]], last: float | None
    ) -> None:
        fed = {
            component: {**tuned.get(component, {}), **self._values.given_by(links)}
            for component, links in self._structure.links.items()
        }
        at_work: dict[str, IsolatedPlant] = {}
        after: dict[str, dict[str, float]] = {}
        for component, plant in self._plants.items():
            if isinstance(plant, IsolatedPlant) and last is None:
                plant.begin_step(fed[component])
                at_work[component] = plant
            else:
                after[component] = _step_once(plant, fed[component], last)
        for component, isolated in at_work.items():
            found = None
            while found is None:  # an overdue step raises
                found = isolated.finish_step(_WAIT)
            after[component] = found
        self._values.latest = {component: after[component] for component in self._plants}

    def steps(self, inputs: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
        """Return what `step` returns for each of ``inputs``."""
        return [self.step(values) for values in inputs]

    def run_pieces(
        self, count: int, inputs: Mapping[str, ArrayLike], *, last: float | None = None
    ) -> Iterator[Piece]:
        """Step ``count`` times; see `Plant.run_pieces`."""
        held, columns = split_columns(count, inputs)
        moments: list[float] = []
        rows: list[list[float]] = []
        begun = perf_counter()
        for k in range(count):
            given = (held if k == 0 else {}) | {n: float(v[k]) for n, v in columns.items()}
            try:
                self._advance(given, last if k == count - 1 else None)
                found = self.outputs()
            except (PlantError, KeyboardInterrupt):
                if rows:
                    yield self._piece(moments, rows)
                raise
            moments.append(self.time)
            rows.append([found[name] for name in self._info.outputs])
            if perf_counter() - begun > _PIECE_SECONDS:
                yield self._piece(moments, rows)
                moments, rows, begun = [], [], perf_counter()
        if rows:
            yield self._piece(moments, rows)

    def _piece(self, moments: list[float], rows: list[list[float]]) -> Piece:
        table: NDArray[np.float64] = np.array(rows)
        columns = {name: table[:, i].copy() for i, name in enumerate(self._info.outputs)}
        return Piece(np.array(moments), columns)

    def snapshot(self) -> bytes:
        """A system has no snapshot."""
        raise PlantStepError(f"system {self._structure.name}: a system of FMUs has no snapshot")

    def restore(self, snapshot: bytes) -> None:  # noqa: ARG002
        """A system has no snapshot."""
        raise PlantStepError(f"system {self._structure.name}: a system of FMUs has no snapshot")

    def _alive(self) -> None:
        if self._failure is not None:
            how = "has ended" if self._ended else "failed before"
            raise PlantClosedError(f"the plant {how}: {self._failure}")
        if not self._plants:
            raise PlantClosedError(f"system {self._structure.name} is closed; open it again")

    def close(self) -> None:
        """End every FMU and remove the temporary folder."""
        plants, self._plants = self._plants, {}
        for plant in plants.values():
            plant.close()
        self._folder.cleanup()


def _shortest_step(file: Path, parts: Mapping[str, FmuSummary]) -> float:
    steps = [part.step_size for part in parts.values() if part.step_size]
    if not steps:
        raise PlantError(f"{file}: none of its FMUs names a step size; give the period in seconds")
    return min(steps)


def _step_once(plant: Plant, inputs: Mapping[str, float], last: float | None) -> dict[str, float]:
    if last is None:
        return plant.step(inputs)
    (piece,) = plant.run_pieces(1, inputs, last=last)
    return {name: float(column[-1]) for name, column in piece.columns.items()}
