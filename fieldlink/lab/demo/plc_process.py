"""The simulated PLC in a process of its own, as a real one would be: its only way out is Modbus.

What really happened inside comes back through a pipe when it ends, for judging.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import signal
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import structlog

from fieldlink.daemon import configure_logging
from fieldlink.errors import FieldlinkError
from fieldlink.lab.demo.site_files import DEVICE, DemoError
from fieldlink.lab.plc import PlcServer, Truth, serve
from fieldlink.site import load_site

__all__ = ["PlcCourse", "PlcProcess"]

START_TIMEOUT = 60.0
STOP_TIMEOUT = 20.0

_LOOK, _STOP = "look", "stop"

_log = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class PlcCourse:
    """The true signals of the loop so far, and how many scans of the PLC were late."""

    truth: Truth
    late_scans: int


@dataclass(frozen=True, slots=True)
class _Failed:
    message: str


class PlcProcess:
    """Starts ``fieldlink plant`` on a free port in a child process; a context manager."""

    def __init__(self, site_file: Path, loop: str) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_run, args=(theirs, site_file, loop), name="fieldlink-demo-plc", daemon=False
        )
        self._theirs = theirs

    def start(self) -> int:
        """Start it and return the port that it listens on.

        Raises:
            DemoError: it does not start.
        """
        self._process.start()
        self._theirs.close()
        answer = self._receive(START_TIMEOUT, "start")
        assert isinstance(answer, int)
        return answer

    def look(self) -> PlcCourse:
        """Return what has happened in it so far; it goes on.

        Raises:
            DemoError: it ended before or does not answer.
        """
        return self._ask(_LOOK)

    def stop(self) -> PlcCourse:
        """End it and return what happened in it.

        Raises:
            DemoError: it ended before or does not answer.
        """
        answer = self._ask(_STOP)
        self._process.join(STOP_TIMEOUT)
        return answer

    def _ask(self, request: str) -> PlcCourse:
        try:
            self._pipe.send(request)
        except OSError as error:
            raise DemoError(f"the simulated PLC has gone away: {error}") from error
        answer = self._receive(STOP_TIMEOUT, request)
        assert isinstance(answer, PlcCourse)
        return answer

    def close(self) -> None:
        """End the process, by force if it does not end by itself."""
        self._pipe.close()
        if self._process.pid is None:
            return
        self._process.join(2.0)
        if self._process.is_alive():
            _log.warning("the simulated PLC did not end by itself", pid=self._process.pid)
            self._process.kill()
            self._process.join()

    def _receive(self, timeout: float, step: str) -> object:
        try:
            if not self._pipe.poll(timeout):
                raise DemoError(f"the simulated PLC did not {step} within {timeout:g} s")
            answer = self._pipe.recv()
        except EOFError as error:
            self._process.join(2.0)
            raise DemoError(
                f"the simulated PLC ended with status {self._process.exitcode}; its "
                "message is above"
            ) from error
        if isinstance(answer, _Failed):
            raise DemoError(answer.message)
        return answer


def _run(pipe: Connection, site_file: Path, loop: str) -> None:
    """Serve until told to stop, or until the process that started this is gone."""
    # Without it pymodbus prints the frames of a dropped connection among the demo's lines.
    configure_logging(logging.WARNING)
    # Ctrl-C reaches every process of the terminal; the program that started this one ends it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        asyncio.run(_serve(pipe, site_file, loop))
    except FieldlinkError as error:
        pipe.send(_Failed(str(error)))


async def _serve(pipe: Connection, site_file: Path, loop: str) -> None:
    stop = asyncio.Event()
    served: list[PlcServer] = []
    wanted: list[object] = []

    def hear() -> None:
        """Answer a question, or end: at the word to stop, or when the other end is closed."""
        try:
            asked = pipe.recv()
        except EOFError:
            asked = None
        if asked == _LOOK:
            pipe.send(course())
            return
        asyncio.get_running_loop().remove_reader(pipe.fileno())
        wanted.append(asked)
        stop.set()

    def course() -> PlcCourse:
        unit = served[0].units[0]
        return PlcCourse(unit.plc.truth(loop), unit.late)

    def ready(servers: Sequence[PlcServer]) -> None:
        served.extend(servers)
        pipe.send(servers[0].port)
        asyncio.get_running_loop().add_reader(pipe.fileno(), hear)

    await serve(load_site(site_file), port=0, ready=ready, stop=stop)
    assert served[0].units[0].plc.device == DEVICE
    if wanted == [_STOP]:
        pipe.send(course())
    # Otherwise the process that started this has ended, and there is no answer to give.
