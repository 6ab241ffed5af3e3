"""A socket in the data directory through which commands reach the running daemon.

One line of JSON asks, one line answers. Who may write the data directory may ask: the folder's and
the socket's permissions are the only guard, and nothing of it is reachable from a network.
"""

from __future__ import annotations

import asyncio
import json
import os
import socket
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

from fieldlink.errors import FieldlinkError

__all__ = ["ControlError", "ask_daemon", "control_socket"]

SOCKET = "control.sock"
SOCKET_MODE = 0o660
LONGEST = 65536
"""Bytes of a request: a loop's name and a sentence are a few hundred."""

PATIENCE = 10.0
"""Seconds for a request to come whole, and for its answer."""

Document = Mapping[str, object]
Answer = Callable[[Document], Document]


class ControlError(FieldlinkError):
    """The running daemon does not answer, or refuses what it was asked."""


@asynccontextmanager
async def control_socket(data_dir: Path, answer: Answer) -> AsyncIterator[None]:
    """Answer requests while the block runs.

    Args:
        data_dir: the daemon's data directory, which it holds.
        answer: gives the answer to a request; a `FieldlinkError` becomes its message.

    Raises:
        ControlError: the socket cannot be made.
    """

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            async with asyncio.timeout(PATIENCE):
                line = await reader.readline()
                writer.write(json.dumps(_answer(line, answer)).encode() + b"\n")
                await writer.drain()
        except (TimeoutError, ValueError, ConnectionError):
            # Too slow, too long or gone: the asker learns it from the closed connection.
            pass
        finally:
            writer.close()

    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    try:
        with _short_path(data_dir) as path:
            (data_dir / SOCKET).unlink(missing_ok=True)
            listener.bind(path)
            (data_dir / SOCKET).chmod(SOCKET_MODE)
    except OSError as error:
        listener.close()
        raise ControlError(
            f"the socket {data_dir / SOCKET} cannot be made: {error.strerror or error}; free space "
            "there, or set data_dir to a folder that this user may write"
        ) from error
    server = await asyncio.start_unix_server(serve, sock=listener, limit=LONGEST)
    try:
        yield
    finally:
        server.close()
        await server.wait_closed()
        (data_dir / SOCKET).unlink(missing_ok=True)


def ask_daemon(data_dir: Path, request: Document) -> dict[str, object]:
    """Return the running daemon's answer.

    Raises:
        ControlError: no daemon answers, or it refuses.
    """
    try:
        with (
            _short_path(data_dir) as path,
            socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking,
        ):
            asking.settimeout(PATIENCE)
            asking.connect(path)
            asking.sendall(json.dumps(request).encode() + b"\n")
            with asking.makefile("rb") as answers:
                line = answers.readline()
    except OSError as error:
        raise ControlError(
            f"the daemon in {data_dir} does not answer: {error.strerror or error}; check that it "
            "runs and that this user may write its data directory"
        ) from error
    if not line:
        raise ControlError(f"the daemon in {data_dir} closed the connection; see its log")
    found = json.loads(line)
    if isinstance(found, dict) and "error" in found:
        raise ControlError(str(found["error"]))
    if not isinstance(found, dict):
        raise ControlError(f"the daemon in {data_dir} answered something unknown; see its log")
    return found


def _answer(line: bytes, answer: Answer) -> Document:
    try:
        request = json.loads(line)
        if not isinstance(request, dict):
            return {"error": "a request is a JSON object"}
        return answer(request)
    except ValueError:
        return {"error": "a request is one line of JSON"}
    except FieldlinkError as error:
        return {"error": str(error)}


@contextmanager
def _short_path(data_dir: Path) -> Iterator[str]:
    """Give the socket's path; a Unix address holds 107 bytes, so it goes by the open folder."""
    folder = os.open(data_dir, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{SOCKET}"
    finally:
        os.close(folder)
