"""A plant in a process of its own: whatever the FMU does, this process lives on."""

from __future__ import annotations

import base64
import contextlib
import itertools
import json
import os
import select
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import errors
from .errors import PlantClosedError, PlantCrashError, PlantError, PlantTimeoutError
from .nursery import STATUS
from .nursery_client import nursery
from .plant import Piece, Plant, PlantInfo, count_finite_rows, split_columns
from .shared_rows import SharedRows, create_memory

__all__ = ["IsolatedPlant"]

_SECONDS_TO_END = 5.0
_GLANCE = 0.1
"""Seconds between two looks at the rows of a run: how often progress is seen and rows are yielded;
a look costs microseconds."""


class IsolatedPlant(Plant):
    """An FMU instance in a process of its own, started and at rest.

    Args:
        file: the ``.fmu``.
        parameters: start values by name.
        period: seconds a step; None takes the FMU's default experiment.
        kind: "co-simulation" or "model exchange"; None takes the first that it offers.
        watch: names of further variables that come back with the outputs.
        timeout: seconds that one step may take, or the answer to another request, before the
            process is ended.
        intermediate: keep the outputs between the ends of a step, for `take_intermediate`.

    Raises:
        PlantError: what `open_plant` says.
    """

    def __init__(
        self,
        file: Path,
        *,
        parameters: Mapping[str, float],
        period: float | None = None,
        kind: str | None = None,
        watch: Sequence[str] = (),
        timeout: float = 30.0,
        intermediate: bool = False,
    ) -> None:
        if os.name != "posix":
            raise PlantError(
                "plants of their own process need a POSIX system; open it with isolated=False"
            )
        self._name = file.name
        self._timeout = timeout
        self._failure: str | None = None
        self._time = 0.0
        self._home = nursery()
        memory = create_memory()
        try:
            self._key, self._connection, self._status = self._home.bear(memory)
        except BaseException:
            os.close(memory)
            raise
        self._open = True
        self._step_begun: float | None = None
        request = {
            "file": str(file.resolve()),
            "parameters": _plain(parameters),
            "period": None if period is None else float(period),
            "kind": kind,
            "watch": list(watch),
            "intermediate": intermediate,
        }
        try:
            answer = self._ask("open", request)
            lists = ("inputs", "tunable", "outputs", "parameters")
            self._info = PlantInfo(**(answer | {name: tuple(answer[name]) for name in lists}))
            self._shared = SharedRows(memory, len(self._info.outputs))
        except BaseException:
            self._release()
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
        return self._time

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
        left = self._step_begun + self._timeout - time.monotonic()
        try:
            answered = self._connection.poll(max(0.0, min(wait, left)))
        except OSError as error:
            raise self._crashed("step") from error
        if not answered:
            if left > wait:
                return None
            raise self._overdue("step")
        self._step_begun = None
        answer: dict[str, float] = self._receive("step")
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
                answered = self._connection.poll(_GLANCE)
                if answered:
                    self._receive("run")
            except OSError as error:
                failure = self._crashed("run")
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
                except BaseException:  # nobody takes the rest
                    if not answered:
                        self._abandon()
                    raise
                moved = time.monotonic()  # the caller's own time is not the plant's
            if failure is None and not answered and time.monotonic() - moved > self._timeout:
                failure = self._overdue("run")
            if failure is not None:
                if not isinstance(failure, PlantError):
                    self._abandon()
                raise failure

    def _piece(self, first: int, end: int) -> Piece:
        moments = self._shared.moments[first:end].copy()
        self._time = float(moments[-1])
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
        if not self._open:
            return
        if self._step_begun is not None:
            self._home.kill(self._key)  # it may be in a step that never ends
        elif self._failure is None:
            with contextlib.suppress(PlantCrashError):  # it ends either way
                self._ask("close")
        self._release()

    def _ask(self, action: str, argument: Any = None, numbers: bytes | None = None) -> Any:
        """Send a request and return the answer; numbers go and come as bytes of a message more."""
        self._send(action, argument, numbers)
        try:
            if not self._connection.poll(self._timeout):
                raise self._overdue(action)
        except OSError as error:
            raise self._crashed(action) from error
        except BaseException:
            self._abandon()
            raise
        return self._receive(action)

    def _send(self, action: str, argument: Any = None, numbers: bytes | None = None) -> None:
        if self._failure is not None:
            raise PlantClosedError(f"the plant failed before: {self._failure}")
        if not self._open:
            raise PlantClosedError(f"plant {self._name} is closed; open it again")
        if self._step_begun is not None:
            raise PlantError(f"plant {self._name} is at a step; call finish_step() first")
        try:
            self._connection.send_bytes(json.dumps([action, argument]).encode())
            if numbers is not None:
                self._connection.send_bytes(numbers)
        except (OSError, ValueError) as error:
            raise self._crashed(action) from error
        except BaseException:
            self._abandon()
            raise

    def _receive(self, action: str) -> Any:
        """Return the answer that is there; raise the error that it brings."""
        try:
            answer = json.loads(self._connection.recv_bytes())
        except (EOFError, OSError, ValueError) as error:
            raise self._crashed(action) from error
        except BaseException:
            self._abandon()
            raise
        self._time = answer.get("time", self._time)
        if "error" in answer:
            kind = getattr(errors, answer["error"], PlantError)
            raise kind(answer["text"])
        return answer["ok"]

    def _abandon(self) -> None:
        """The answer is still to come (Ctrl-C, for one): the connection cannot be used again."""
        if self._failure is None:
            self._failure = f"plant {self._name} was interrupted while it worked"
            self._home.kill(self._key)

    def _overdue(self, action: str) -> PlantTimeoutError:
        self._home.kill(self._key)
        self._failure = (
            f"plant {self._name} at {self._time:g} s did not answer to {action!r} within "
            f"{self._timeout:g} s and was ended; is the FMU in an endless loop? Otherwise open it "
            "with a longer timeout"
        )
        return PlantTimeoutError(self._failure)

    def _crashed(self, action: str) -> PlantCrashError:
        code = self._exit_code()
        if code is None:
            what = "its process cannot be reached any more"
        elif code < 0:
            what = f"its process died of {_signal_name(-code)}"
        else:
            what = f"its process ended with exit status {code}"
        hint = (
            "is the FMU truncated or damaged?"
            if action == "open"
            else "the fault is in the FMU or in the values it was given; open it again to go on"
        )
        self._failure = f"plant {self._name} at {self._time:g} s: {what}, at {action!r}; {hint}"
        return PlantCrashError(self._failure)

    def _exit_code(self) -> int | None:
        """Wait until the worker has ended; return its exit status, negative for a signal."""
        ready, _, _ = select.select([self._status], [], [], _SECONDS_TO_END)
        content = os.read(self._status, STATUS.size) if ready else b""
        return int(STATUS.unpack(content)[0]) if len(content) == STATUS.size else None

    def _release(self) -> None:
        """Let go of the worker and wait until it and its folder are gone."""
        self._open = False
        self._connection.close()
        ready, _, _ = select.select([self._status], [], [], _SECONDS_TO_END)
        if not ready:
            self._home.kill(self._key)
            select.select([self._status], [], [], _SECONDS_TO_END)
        os.close(self._status)


def _signal_name(number: int) -> str:
    try:
        return f"{signal.Signals(number).name} ({signal.strsignal(number)})"
    except ValueError:
        return f"signal {number}"  # real-time signals have no name


def _plain(values: Mapping[str, float]) -> dict[str, float]:
    return {str(name): float(value) for name, value in values.items()}
