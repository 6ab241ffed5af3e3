"""Runs the server's process beside the daemon and gives it what to show.

asyncua answers clients in pure Python: in a process of its own, with a low priority and a bound on
memory, neither a screen that reads everything nor a flood of connections delays a poll. A process
that ends is replaced after a growing pause, and a port that is in use is tried again: the daemon
goes on meanwhile.
"""

from __future__ import annotations

import asyncio
import json
import socket
import sys
import time
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, suppress
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import structlog

from fieldlink.daemon import Daemon
from fieldlink.daemon.reporting.defects import describe_defect
from fieldlink.errors import FieldlinkError, MissingExtraError
from fieldlink.links.backoff import Backoff, BackoffSettings
from fieldlink.opcua_server.document import device_values, loop_values
from fieldlink.site import Site
from fieldlink.store import StoreError
from fieldlink.web.source import Source

__all__ = ["OpcuaServing", "opcua_server"]

EVERY = 2.0
"""Seconds between two looks at the fleet, as on the pages; verdicts change every few minutes."""

PATIENCE = BackoffSettings(first=1.0, cap=60.0)
"""Pauses until the next attempt: a port that becomes free is used within a minute."""

ANSWER_WITHIN = 120.0
"""Seconds without an answer after which the process is replaced: many times what a document takes
on a slow machine."""

AT_ONCE = 200
"""Loops and devices that a document changes: some seconds of work. asyncua compares a new object
with all that are there, so thousands in one document would take longer than an answer may."""

END_WITHIN = 5.0
"""Seconds for the process to say goodbye to its clients; then it is killed."""

SHORTEST_PASSWORD = 12
"""Characters; less can be guessed."""

_PROCESS = (sys.executable, "-P", "-m", "fieldlink.opcua_server.process")
"""Without the folder where the daemon was started: no file there becomes a module."""

_log = structlog.get_logger(__name__)


class _EndedError(Exception):
    """The server's process has ended or cannot listen; the text says why."""


class OpcuaServing:
    """The server of a running daemon.

    Args:
        settings: what the process needs, see `fieldlink.opcua_server.process`.
        source: what the operators' pages show.
        daemon: the daemon.

    Attributes:
        port: where the server listens, None while it does not.
        listening: set while it does.
        clients: connections at the last look.
        attempts: times that the server was started; process: the newest, None before the first.
    """

    def __init__(self, settings: Mapping[str, Any], source: Source, daemon: Daemon) -> None:
        self._settings, self._source, self._daemon = settings, source, daemon
        self._said = ""
        self.port: int | None = None
        self.listening = asyncio.Event()
        self.clients = 0
        self.attempts = 0
        self.process: asyncio.subprocess.Process | None = None

    async def run(self) -> None:
        """Serve until cancelled."""
        backoff = Backoff(PATIENCE)
        while True:
            try:
                await self._serve(backoff)
            except _EndedError as error:
                self._tell_end(str(error))
            except OSError as error:
                self._tell_end(error.strerror or str(error))
            except Exception as error:  # noqa: BLE001  (told with its place; the daemon goes on)
                self._tell_end(describe_defect(error))
            backoff.failed(time.monotonic())
            await asyncio.sleep(backoff.remaining(time.monotonic()))

    async def _serve(self, backoff: Backoff) -> None:
        """Run one process until it ends."""
        self.attempts += 1
        # A process that cannot listen would take two seconds of processor time to find that out.
        _check_port(self._settings["host"], self._settings["port"])
        process = self.process = await asyncio.create_subprocess_exec(
            *_PROCESS, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
        )
        try:
            answer = await _exchange(process, self._settings)
            if "failed" in answer:
                raise _EndedError(answer["failed"])
            self.port = int(answer["port"])
            self._said = ""
            _log.info(
                "opcua_server.listening",
                address=f"{self._settings['host']}:{self.port}",
                encrypted=self._settings["cert"] is not None,
                user=self._settings["username"],
                trusted=len(self._settings["trusted"]),
            )
            shown: dict[str, dict[str, Any]] = {"loops": {}, "devices": {}}
            while True:
                document = await self._look(shown)
                if document is not None:
                    for part in parts_of(document):
                        self.clients = (await _exchange(process, part))["clients"]
                    self.listening.set()
                    backoff.succeeded()
                await asyncio.sleep(EVERY)
        finally:
            self.port = None
            self.listening.clear()
            await _end(process)

    async def _look(self, shown: dict[str, dict[str, Any]]) -> dict[str, Any] | None:
        """Return what has changed; None while the store cannot be read."""
        status = self._daemon.status()
        try:
            # In a thread, as for the pages: thousands of rows must not hold up the polls.
            found = await asyncio.to_thread(
                lambda: {
                    "loops": loop_values(self._source.fleet(status)[1]),
                    "devices": device_values(status, self._daemon.site),
                }
            )
        except StoreError as error:
            self._tell_end(str(error))
            return None
        document: dict[str, Any] = {"time": time.time()}
        for part, values in found.items():
            before = shown[part]
            document[part] = {
                "names": list(values),
                "changed": {name: one for name, one in values.items() if before.get(name) != one},
            }
            shown[part] = values
        return document

    def _tell_end(self, why: str) -> None:
        """Log once why nothing is served; it is tried again and again."""
        if why != self._said:
            _log.error(
                "opcua_server.not_serving",
                address=f"{self._settings['host']}:{self._settings['port']}",
                error=why,
                advice="it is tried again at least once a minute; the daemon goes on without it",
            )
        self._said = why


@asynccontextmanager
async def opcua_server(
    site: Site, daemon: Daemon, source: Source
) -> AsyncIterator[OpcuaServing | None]:
    """Serve OPC UA clients while the block runs; gives None where the site asks for no server.

    Raises:
        MissingExtraError: asyncua is not installed.
        FieldlinkError: the password cannot be used.
    """
    settings = site.file.opcua_server
    if settings is None:
        yield None
        return
    if find_spec("asyncua") is None:
        raise MissingExtraError(f"{site.path}: the table [opcua_server]", "asyncua", "opcua")
    password = None
    if settings.password_file is not None:
        password = read_password(site.resolve(settings.password_file))

    def resolved(path: Path | None) -> str | None:
        return None if path is None else str(site.resolve(path))

    serving = OpcuaServing(
        {
            "site": site.name,
            "version": metadata.version("fieldlink"),
            "host": settings.host,
            "port": settings.port,
            "application_uri": settings.application_uri,
            "cert": resolved(settings.cert),
            "key": resolved(settings.key),
            "trusted": [resolved(path) for path in settings.trusted],
            "username": settings.username,
            "password": password,
            "max_clients": settings.max_clients,
        },
        source,
        daemon,
    )
    task = asyncio.create_task(serving.run(), name="opcua server")
    try:
        yield serving
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def parts_of(document: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield documents of at most `AT_ONCE` changes that say together what one says."""
    kinds = ("loops", "devices")
    changed = [(kind, *found) for kind in kinds for found in document[kind]["changed"].items()]
    for begin in range(0, max(1, len(changed)), AT_ONCE):
        now: dict[str, dict[str, Any]] = {kind: {} for kind in kinds}
        for kind, name, values in changed[begin : begin + AT_ONCE]:
            now[kind][name] = values
        yield {
            **document,
            **{kind: {"names": document[kind]["names"], "changed": now[kind]} for kind in kinds},
        }


def _check_port(host: str, port: int) -> None:
    """Raise an OSError where nothing can listen on a port."""
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    family, kind, protocol, _, address = found[0]
    with socket.socket(family, kind, protocol) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(address)


def read_password(file: Path) -> str:
    """Return the password in a file.

    Raises:
        FieldlinkError: it cannot be read, or is too short.
    """
    try:
        password = file.read_text(encoding="utf-8").strip("\r\n")
    except (OSError, UnicodeDecodeError) as error:
        raise FieldlinkError(
            f"opcua_server.password_file {file} cannot be read; check its permissions, and that it "
            "holds the password as plain text"
        ) from error
    if len(password) < SHORTEST_PASSWORD:
        raise FieldlinkError(
            f"opcua_server.password_file {file} holds {len(password)} characters; give at least "
            f"{SHORTEST_PASSWORD}, for instance from: openssl rand -hex 16"
        )
    return password


async def _exchange(
    process: asyncio.subprocess.Process, message: Mapping[str, Any]
) -> dict[str, Any]:
    """Send the process a line and return its answer.

    Raises:
        _EndedError: it has ended or does not answer.
    """
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        async with asyncio.timeout(ANSWER_WITHIN):
            process.stdin.write(json.dumps(message).encode() + b"\n")
            await process.stdin.drain()
            line = await process.stdout.readline()
    except TimeoutError as error:
        raise _EndedError(f"the server's process did not answer in {ANSWER_WITHIN:g} s") from error
    except ConnectionError as error:
        raise _EndedError("the server's process has ended") from error
    if not line:
        raise _EndedError("the server's process has ended")
    return dict(json.loads(line))


async def _end(process: asyncio.subprocess.Process) -> None:
    """End a process, by the end of its input, else by force; wait until its pipes are closed."""
    assert process.stdin is not None
    process.stdin.close()
    try:
        async with asyncio.timeout(END_WITHIN):
            await process.communicate()
    except TimeoutError:
        with suppress(ProcessLookupError):
            process.kill()
        await process.communicate()
    with suppress(ConnectionError):
        await process.stdin.wait_closed()
