"""A plant in a process of its own: whatever the FMU does, this process lives on."""

from __future__ import annotations

import base64
import contextlib
import itertools
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .columns import count_finite_rows, split_columns
from .errors import PlantCrashError, PlantError
from .opening import OpenOptions
from .plant import Piece, Plant, PlantInfo
from .shared_rows import SharedRows, create_memory
from .start_values import StartValue
from .worker_link import WorkerLink

__all__ = ["IsolatedPlant"]

_GLANCE = 0.1
"""Seconds between two looks at the rows of a run: how often progress is seen and rows are yielded;
a look costs microseconds."""


class IsolatedPlant(Plant):
    """An FMU instance in a process of its own, started and at rest.

    Args:
        file: the ``.fmu``.
        options: how to open it.
        timeout: seconds that one step may take, or the answer to another request, before the
            process is ended.

    Raises:
        PlantError: what `open_plant` says.
    """

    def __init__(self, file: Path, options: OpenOptions, timeout: float = 30.0) -> None:
        if os.name != "posix":
            raise PlantError(
                "plants of their own process need a POSIX system; open it with isolated=False"
            )
        self._name = file.name
        self._step_begun: float | None = None
        memory = create_memory()
        try:
            self._link = WorkerLink(self._name, memory, timeout)
        except BaseException:
            os.close(memory)
            raise
        period = None if options.period is None else float(options.period)
        given = replace(options, parameters=_plain_starts(options.parameters), period=period)
        request = {"file": str(file.resolve()), "options": asdict(given)}
        try:
            answer = self._ask("open", request)
            lists = ("inputs", "tunable", "outputs", "parameters")
            self._info = PlantInfo(**(answer | {name: tuple(answer[name]) for name in lists}))
            self._shared = SharedRows(memory, len(self._info.outputs))
        except BaseException:
            self._link.release()
            raise
        finally:
            os.close(memory)

    @property
    def info(self) -> PlantInfo:
        """What the plant is."""
        return self._info

    @property
    def time(self) -> float:
        """Simulated seconds."""
        return self._link.time

    def outputs(self) -> dict[str, float]:
        """Return the outputs at the present time."""
        answer: dict[str, float] = self._ask("outputs")
        return answer

    def step(self, inputs: Mapping[str, float]) -> dict[str, float]:
        """Apply inputs, advance one period, return all outputs."""
        answer: dict[str, float] = self._ask("step", _plain(inputs))
        return answer

    def begin_step(self, inputs: Mapping[str, float]) -> None:
        """Begin what `step` does without waiting for it; `finish_step` brings the outputs."""
        self._send("step", _plain(inputs))
        self._step_begun = time.monotonic()

    def finish_step(self, wait: float) -> dict[str, float] | None:
        """Return the outputs after a step that was begun; None while it is not finished.

        Args:
            wait: seconds to wait for them at most.

        Raises:
            PlantTimeoutError: the step takes longer than the plant may take to answer.
            PlantStepError, PlantCrashError: as `step` does.
        """
        if self._step_begun is None:
            raise PlantError(f"plant {self._name}: no step was begun; call begin_step() first")
        left = self._step_begun + self._link.timeout - time.monotonic()
        try:
            answered = self._link.has_answer(max(0.0, min(wait, left)))
        except OSError as error:
            raise self._link.crashed("step") from error
        if not answered:
            if left > wait:
                return None
            raise self._link.overdue("step")
        self._step_begun = None
        answer: dict[str, float] = self._link.receive("step")
        return answer

    def steps(self, inputs: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
        """Return what `step` returns for each of ``inputs``; equal names go in one message."""
        results: list[dict[str, float]] = []
        for _, group in itertools.groupby(inputs, key=lambda row: tuple(sorted(row))):
            rows = [_plain(row) for row in group]
            columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
            for piece in self.run_pieces(len(rows), columns):
                values = np.column_stack([piece.columns[name] for name in self._info.outputs])
                results += [
                    dict(zip(self._info.outputs, row, strict=True)) for row in values.tolist()
                ]
        return results

    def run_pieces(
        self, count: int, inputs: Mapping[str, ArrayLike], *, last: float | None = None
    ) -> Iterator[Piece]:
        """Step ``count`` times; see `Plant.run_pieces`. Thousands of steps go in one message."""
        held, columns = split_columns(count, inputs)
        names = tuple(columns)
        table = np.column_stack([columns[name] for name in names]) if names else None
        most = len(self._shared.table)
        for first in range(0, count, most):
            rows = min(most, count - first)
            request = {
                "count": rows,
                "held": held if first == 0 else {},
                "names": names,
                "last": last if first + rows == count else None,
            }
            self._shared.progress[0] = 0
            piece = b"" if table is None else table[first : first + rows].tobytes()
            self._send("run", request, piece)
            yield from self._rows_of_a_message()

    def _rows_of_a_message(self) -> Iterator[Piece]:
        """Yield rows as they are done, until the plant has answered."""
        taken, moved = 0, time.monotonic()
        answered = False
        while not answered:
            failure: BaseException | None = None
            try:
                answered = self._link.has_answer(_GLANCE)
                if answered:
                    self._note_progress()
                    self._link.receive("run")
            except OSError as error:
                failure = self._link.crashed("run")
                failure.__cause__ = error
            except (PlantError, KeyboardInterrupt) as error:
                failure = error
            done = int(self._shared.progress[0])
            finite = taken + count_finite_rows(self._shared.table[taken:done])
            if done > taken:
                moved = time.monotonic()
            if finite > taken:
                piece = self._piece(taken, finite)
                taken = finite
                try:
                    yield piece
                except BaseException:  # no process takes the rest
                    if not answered:
                        self._link.abandon()
                    raise
                moved = time.monotonic()  # the caller's own time is not the plant's
            if failure is None and not answered and time.monotonic() - moved > self._link.timeout:
                failure = self._link.overdue("run")
            if failure is not None:
                if not isinstance(failure, PlantError):
                    self._link.abandon()
                raise failure

    def _note_progress(self) -> None:
        """Take the time of the last row, which a crash leaves without an answer."""
        done = int(self._shared.progress[0])
        if done:
            self._link.time = float(self._shared.moments[done - 1])

    def _piece(self, first: int, end: int) -> Piece:
        moments = self._shared.moments[first:end].copy()
        self._link.time = float(moments[-1])
        table = self._shared.table[first:end]
        return Piece(
            moments, {name: table[:, i].copy() for i, name in enumerate(self._info.outputs)}
        )

    def take_intermediate(self) -> Piece:
        """Return the outputs between the ends of steps since this was called last."""
        moments, columns = self._ask("intermediate")
        return Piece(
            np.array(moments, dtype=np.float64),
            {name: np.array(values, dtype=np.float64) for name, values in columns.items()},
        )

    def snapshot(self) -> bytes:
        """Return the plant's whole state."""
        return base64.b64decode(self._ask("snapshot"))

    def restore(self, snapshot: bytes) -> None:
        """Go back to a state that `snapshot` returned."""
        self._ask("restore", base64.b64encode(snapshot).decode("ascii"))

    def close(self) -> None:
        """End the process; its folder is removed."""
        if not self._link.is_open:
            return
        if self._step_begun is not None:
            self._link.kill()  # it may be in a step that never ends
        elif self._link.failure is None:
            with contextlib.suppress(PlantCrashError):  # it ends either way
                self._link.ask("close")
        self._link.release()

    def _ask(self, action: str, argument: Any = None) -> Any:
        self._check_idle()
        return self._link.ask(action, argument)

    def _send(self, action: str, argument: Any, numbers: bytes | None = None) -> None:
        self._check_idle()
        self._link.send(action, argument, numbers)

    def _check_idle(self) -> None:
        self._link.check_open()
        if self._step_begun is not None:
            raise PlantError(f"plant {self._name} is at a step; call finish_step() first")


def _plain_starts(values: Mapping[str, StartValue]) -> dict[str, StartValue]:
    return {
        str(name): str(value) if isinstance(value, str) else float(value)
        for name, value in values.items()
    }


def _plain(values: Mapping[str, float]) -> dict[str, float]:
    return {str(name): float(value) for name, value in values.items()}
