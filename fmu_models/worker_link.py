"""The connection to the process of an isolated plant: requests, answers, and how it ended."""

from __future__ import annotations

import json
import os
import select
import signal
from typing import Any

from . import errors
from .errors import PlantClosedError, PlantCrashError, PlantError, PlantTimeoutError
from .nursery import STATUS
from .nursery_client import nursery

__all__ = ["WorkerLink"]

_SECONDS_TO_END = 5.0
_DOING = {
    "open": "while it started",
    "step": "in a step",
    "run": "in a step",
    "outputs": "when its outputs were asked for",
    "intermediate": "when its outputs were asked for",
    "snapshot": "when its state was saved",
    "restore": "when a state was restored",
    "close": "while it was closed",
}
"""What the plant was doing, by request."""


class WorkerLink:
    """A new process for one plant, and the connection to it.

    Args:
        name: of the plant, for messages.
        memory: descriptor of the file for the rows of a run.
        timeout: seconds that an answer may take.

    Attributes:
        timeout: as given.
        failure: why the process is gone; None while it lives.
        time: simulated seconds, as of the last answer.
    """

    def __init__(self, name: str, memory: int, timeout: float) -> None:
        self._name = name
        self.timeout = timeout
        self.failure: str | None = None
        self.time = 0.0
        self._home = nursery()
        self._key, self._connection, self._status = self._home.start_worker(memory)
        self._open = True

    @property
    def is_open(self) -> bool:
        """Whether it was not released."""
        return self._open

    def has_answer(self, wait: float) -> bool:
        """Wait for an answer, for ``wait`` seconds at most."""
        return self._connection.poll(wait)

    def kill(self) -> None:
        """End the process, whatever it does."""
        self._home.kill(self._key)

    def ask(self, action: str, argument: Any = None, numbers: bytes | None = None) -> Any:
        """Send a request and return the answer; numbers go and come as bytes of a message more."""
        self.send(action, argument, numbers)
        try:
            if not self._connection.poll(self.timeout):
                raise self.overdue(action)
        except OSError as error:
            raise self.crashed(action) from error
        except BaseException:
            self.abandon()
            raise
        return self.receive(action)

    def check_open(self) -> None:
        """Raise PlantClosedError where the process is gone."""
        if self.failure is not None:
            raise PlantClosedError(f"the plant failed before: {self.failure}")
        if not self._open:
            raise PlantClosedError(f"plant {self._name} is closed; open it again")

    def send(self, action: str, argument: Any = None, numbers: bytes | None = None) -> None:
        """Send a request; ``numbers`` go as bytes in a message of their own."""
        self.check_open()
        try:
            self._connection.send_bytes(json.dumps([action, argument]).encode())
            if numbers is not None:
                self._connection.send_bytes(numbers)
        except (OSError, ValueError) as error:
            raise self.crashed(action) from error
        except BaseException:
            self.abandon()
            raise

    def receive(self, action: str) -> Any:
        """Return the waiting answer, or raise the error that it reports."""
        try:
            answer = json.loads(self._connection.recv_bytes())
        except (EOFError, OSError, ValueError) as error:
            raise self.crashed(action) from error
        except BaseException:
            self.abandon()
            raise
        self.time = answer.get("time", self.time)
        if "error" in answer:
            kind = getattr(errors, answer["error"], PlantError)
            raise kind(answer["text"])
        return answer["ok"]

    def abandon(self) -> None:
        """The answer is still to come (Ctrl-C, for one): the connection cannot be used again."""
        if self.failure is None:
            self.failure = f"plant {self._name} was interrupted while it worked"
            self.kill()

    def overdue(self, action: str) -> PlantTimeoutError:
        """End the process, which has not answered in time; return the error."""
        self.kill()
        self.failure = (
            f"plant {self._name} at {self.time:g} s was ended: {_DOING[action]} it did not answer "
            f"for {self.timeout:g} s; is the FMU in an endless loop? Otherwise open it with a "
            "longer timeout"
        )
        return PlantTimeoutError(self.failure)

    def crashed(self, action: str) -> PlantCrashError:
        """Return the error of a process that has ended by itself, with how it ended."""
        code = self._exit_code()
        if code is None:
            what = "its process cannot be reached any more"
        elif code < 0:
            what = f"its process died of {_signal_name(-code)}"
        else:
            what = f"its process ended itself with exit status {code}"
        hint = (
            "is the FMU truncated or damaged?"
            if action == "open"
            else "the fault is in the FMU or in the values it was given; open it again to go on"
        )
        self.failure = f"plant {self._name} at {self.time:g} s: {_DOING[action]} {what}; {hint}"
        return PlantCrashError(self.failure)

    def _exit_code(self) -> int | None:
        """Wait until the worker has ended; return its exit status, negative for a signal."""
        ready, _, _ = select.select([self._status], [], [], _SECONDS_TO_END)
        content = os.read(self._status, STATUS.size) if ready else b""
        return int(STATUS.unpack(content)[0]) if len(content) == STATUS.size else None

    def release(self) -> None:
        """Let go of the worker and wait until it and its folder are gone."""
        self._open = False
        self._connection.close()
        ready, _, _ = select.select([self._status], [], [], _SECONDS_TO_END)
        if not ready:
            self.kill()
            select.select([self._status], [], [], _SECONDS_TO_END)
        os.close(self._status)


def _signal_name(number: int) -> str:
    try:
        return f"{signal.Signals(number).name} ({signal.strsignal(number)})"
    except ValueError:
        return f"signal {number}"  # real-time signals have no name
