"""A plant in a process of its own: whatever the FMU does, this process lives on."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import select
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import errors
from .errors import PlantClosedError, PlantCrashError, PlantError, PlantTimeoutError
from .nursery import STATUS
from .nursery_client import nursery
from .plant import Plant, PlantInfo, split_columns

__all__ = ["IsolatedPlant"]

_STEPS_A_MESSAGE = 1000
_FIRST_ROWS_A_MESSAGE = 16
_ROWS_A_MESSAGE = 4096
_SECONDS_TO_END = 5.0


class IsolatedPlant(Plant):
    """An FMU instance in a process of its own, started and at rest.

    Args:
        file: the ``.fmu``.
        parameters: start values by name.
        period: seconds a step; None takes the FMU's default experiment.
        kind: "co-simulation" or "model exchange"; None takes the first that it offers.
        watch: names of further variables that come back with the outputs.
        timeout: seconds to wait for an answer before the process is ended.

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
    ) -> None:
        if os.name != "posix":
            raise PlantError(
                "plants of their own process need a POSIX system; open it with isolated=False"
            )
        self._name = file.name
        self._timeout = timeout
        self._failure: str | None = None
        self._time = 0.0
        self._tail = b""
        self._rows = _FIRST_ROWS_A_MESSAGE
        self._home = nursery()
        self._key, self._connection, self._status = self._home.bear()
        self._open = True
        self._step_begun: float | None = None
        request = {
            "file": str(file.resolve()),
            "parameters": _plain(parameters),
            "period": None if period is None else float(period),
            "kind": kind,
            "watch": list(watch),
        }
        try:
            answer = self._ask("open", request)
        except BaseException:
            self._release()
            raise
        lists = ("inputs", "tunable", "outputs", "parameters")
        self._info = PlantInfo(**(answer | {name: tuple(answer[name]) for name in lists}))

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
        """Return the outputs after a step that was begun; None when they are not there yet.

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
        """Return what `step` returns for each of ``inputs``; many go in one message."""
        results: list[dict[str, float]] = []
        for first, count in self._messages(len(inputs), _STEPS_A_MESSAGE):
            batch = [_plain(values) for values in inputs[first : first + count]]
            answer = self._ask("steps", batch)
            results += [dict(zip(answer["names"], row, strict=True)) for row in answer["rows"]]
        return results

    def run(self, count: int, inputs: Mapping[str, ArrayLike]) -> dict[str, NDArray[np.float64]]:
        """Step ``count`` times; see `Plant.run`. Up to some thousand steps go in one message."""
        held, columns = split_columns(count, inputs)
        names = tuple(columns)
        table = np.column_stack([columns[name] for name in names]) if names else None
        parts = []
        for first, rows in self._messages(count, _ROWS_A_MESSAGE):
            request = {"count": rows, "held": held if first == 0 else {}, "names": names}
            piece = b"" if table is None else table[first : first + rows].tobytes()
            self._ask("run", request, piece)
            parts.append(np.frombuffer(self._tail).reshape(rows, len(self._info.outputs)))
        result = np.concatenate(parts) if parts else np.empty((0, len(self._info.outputs)))
        return {name: result[:, i].copy() for i, name in enumerate(self._info.outputs)}

    def _messages(self, count: int, most: int) -> Iterator[tuple[int, int]]:
        """Share ``count`` steps out to messages: the first step and the number of each."""
        first = 0
        while first < count:
            rows = min(self._rows, most, count - first)
            begun = time.monotonic()
            yield first, rows
            first += rows
            self._rows = self._suitable_rows(rows, time.monotonic() - begun)

    def _suitable_rows(self, rows: int, seconds: float) -> int:
        """How many steps the next message takes, so that a slow FMU is not taken for a hung one."""
        if seconds > self._timeout / 8.0:
            return max(1, rows // 4)
        return min(4 * rows, _ROWS_A_MESSAGE) if seconds < self._timeout / 64.0 else rows

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
            if answer.get("numbers"):
                self._tail = self._connection.recv_bytes()
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
