"""The simulated PLC in a process of its own, scanned thousands of times a message.

    with BatchedPlc(site, "plc") as plc:
        table = plc.record(10_000, ["FC101.OP", "FC101.PV"])   # read after every scan

Controllers, registers and FMUs sit in that one process, so no message stands between a controller
and its plant. What comes back is what a client with the same scan would read, rounded and in the
ranges of the wire. A client that writes does so
between two batches. A crash or an endless step of an FMU ends that process, not this one.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from fieldlink.errors import FieldlinkError
from fieldlink.lab.plc.build import ANSWER_WITHIN, PlcError
from fieldlink.lab.plc.image import RequestRefusedError
from fieldlink.lab.plc.readings import ScanReader
from fieldlink.lab.plc.virtual import VirtualPlc
from fieldlink.registers import Table
from fieldlink.site import Site

__all__ = ["BatchedPlc", "main"]

Array = NDArray[np.float64]

_PROGRAM = "from fieldlink.lab.plc.batched import main; main({})"
_PIECE_SECONDS = 0.1
"""Of the wall clock between two messages of a batch: how soon a scan that hangs is noticed."""
_START_WITHIN = 60.0
"""Seconds for Python, NumPy and the plants to start; on a loaded machine it takes some."""


class BatchedPlc:
    """One device of a site, as `VirtualPlc` runs it, behind a pipe.

    Args:
        site: the site.
        device: the device's name.

    Raises:
        PlcError: as `VirtualPlc` does, or the process died.
    """

    def __init__(self, site: Site, device: str) -> None:
        self._device = device
        ours, theirs = socket.socketpair()
        root = str(Path(__file__).parents[3])
        path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM.format(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=2,  # what an FMU prints must not mix with what this process prints
                env={**os.environ, "PYTHONPATH": path},
            )
        self._connection = Connection(ours.detach())
        try:
            self._connection.send_bytes(pickle.dumps((site, device)))
            self.scan_period = float(self._answer(_START_WITHIN)["scan_period"])
        except BaseException:
            self.close()
            raise

    def record(self, count: int, tags: Sequence[str]) -> dict[str, Array]:
        """Scan ``count`` times and return what the registers of ``tags`` held after each scan.

        Args:
            count: of scans.
            tags: of the device's register map.

        Returns:
            By tag, values in engineering units, shape ``(count,)``; NaN where there is none.

        Raises:
            PlcError: an unknown tag, a process that died, or a scan that took too long.
        """
        self._send("record", count, list(tags))
        table = np.empty((count, len(tags)))
        done = 0
        while done < count:
            rows = int(self._answer(ANSWER_WITHIN)["rows"])
            content = np.frombuffer(self._connection.recv_bytes())
            table[done : done + rows] = content.reshape(rows, len(tags))
            done += rows
        return {tag: table[:, i].copy() for i, tag in enumerate(tags)}

    def read(self, table: Table, address: int, count: int) -> list[int]:
        """Read registers, as a client would.

        Raises:
            PlcError: the request is refused.
        """
        self._send("read", table.value, address, count)
        words: list[int] = self._answer(ANSWER_WITHIN)["words"]
        return words

    def write(self, table: Table, address: int, words: Sequence[int]) -> None:
        """Write registers, as a client would.

        Raises:
            PlcError: the request is refused.
        """
        self._send("write", table.value, address, list(words))
        self._answer(ANSWER_WITHIN)

    def failures(self) -> Mapping[str, str]:
        """Return the loops that stand still, and why."""
        self._send("failures")
        found: dict[str, str] = self._answer(ANSWER_WITHIN)["failures"]
        return found

    def close(self) -> None:
        """End the process; more than once does no harm."""
        self._connection.close()
        try:
            self._process.wait(ANSWER_WITHIN)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _send(self, action: str, *arguments: Any) -> None:
        try:
            self._connection.send_bytes(json.dumps([action, *arguments]).encode())
        except OSError as error:
            raise self._died() from error

    def _answer(self, within: float) -> dict[str, Any]:
        try:
            if not self._connection.poll(within):
                self._process.kill()
                raise PlcError(
                    f"device {self._device}: its process did not answer within {within:g} s and "
                    "was ended; is an FMU in an endless loop?"
                )
            answer: dict[str, Any] = json.loads(self._connection.recv_bytes())
        except (EOFError, OSError, ValueError) as error:
            raise self._died() from error
        if "error" in answer:
            raise PlcError(answer["error"])
        return answer

    def _died(self) -> PlcError:
        code = self._process.wait(ANSWER_WITHIN)
        how = f"of {signal.Signals(-code).name}" if code < 0 else f"with exit status {code}"
        return PlcError(
            f"device {self._device}: the process of the PLC and its plants died {how}; the fault "
            "is in an FMU, run it isolated to see which"
        )


def main(descriptor: int) -> None:
    """Serve the process at the other end of the socket ``descriptor`` until it goes away."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's Ctrl-C goes to the whole group
    connection = Connection(descriptor)
    site, device = pickle.loads(connection.recv_bytes())  # our own parent's
    try:
        plc = VirtualPlc(site, device, isolated=False)
    except FieldlinkError as error:
        _tell(connection, {"error": str(error)})
        return
    with plc:
        _tell(connection, {"scan_period": plc.scan_period})
        while True:
            try:
                action, *arguments = json.loads(connection.recv_bytes())
            except (EOFError, ConnectionError):
                return
            try:
                _obey(connection, plc, site, action, arguments)
            except (FieldlinkError, RequestRefusedError) as error:
                _tell(connection, {"error": str(error)})


def _tell(connection: Connection, answer: Mapping[str, Any]) -> None:
    connection.send_bytes(json.dumps(answer).encode())


def _obey(
    connection: Connection, plc: VirtualPlc, site: Site, action: str, arguments: list[Any]
) -> None:
    match action:
        case "record":
            _record(connection, plc, site, *arguments)
        case "read":
            table, address, count = arguments
            _tell(connection, {"words": plc.image.read(Table(table), address, count)})
        case "write":
            table, address, words = arguments
            plc.image.write(Table(table), address, words)
            _tell(connection, {})
        case "failures":
            _tell(connection, {"failures": dict(plc.failures)})


def _record(
    connection: Connection, plc: VirtualPlc, site: Site, count: int, names: list[str]
) -> None:
    tags = site.maps[plc.device]
    for name in names:
        if name not in tags:
            raise PlcError(
                f"device {plc.device}: its register map has no tag {name!r}, it has "
                f"{', '.join(tags)}"
            )
    reader = ScanReader(plc, site, [tags[name] for name in names])
    done = 0
    while done < count:
        table = reader.scan(count - done, _PIECE_SECONDS)
        _tell(connection, {"rows": len(table)})
        connection.send_bytes(table.tobytes())
        done += len(table)
