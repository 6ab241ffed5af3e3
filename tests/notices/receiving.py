"""Real receivers for tests: an HTTP server that answers as told, and a mail server."""

from __future__ import annotations

import asyncio
import json
import ssl
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from aiosmtpd.smtp import SMTP, AuthResult, Envelope, LoginPassword, Session


class HookServer:
    """Keeps what is posted; ``status`` is what it answers, 0 for nothing at all."""

    def __init__(self) -> None:
        self.posts: list[tuple[dict[str, str], dict[str, Any]]] = []
        self.status = 200
        self.port = 0

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = (await reader.readuntil(b"\r\n\r\n")).decode().split("\r\n")
            headers = dict(line.lower().split(": ", 1) for line in head[1:] if ": " in line)
            if "content-length" in headers:
                body = await reader.readexactly(int(headers["content-length"]))
                original = {
                    line.split(": ", 1)[0].lower(): line.split(": ", 1)[1]
                    for line in head[1:]
                    if ": " in line
                }
                self.posts.append((original | {"": head[0]}, json.loads(body)))
            if self.status == 0:
                await reader.read()
                return
            writer.write(f"HTTP/1.1 {self.status} said\r\nContent-Length: 0\r\n\r\n".encode())
            await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError):
            return
        finally:
            writer.close()

    @asynccontextmanager
    async def running(self, tls: ssl.SSLContext | None = None) -> AsyncIterator[HookServer]:
        server = await asyncio.start_server(self._serve, "127.0.0.1", self.port, ssl=tls)
        self.port = server.sockets[0].getsockname()[1]
        try:
            yield self
        finally:
            server.close()


class Mails:
    """What a mail server took.

    ``refuse`` is its answer instead, where given; for ``unknown`` addresses it has no mailbox.
    """

    def __init__(self) -> None:
        self.taken: list[Envelope] = []
        self.logins: list[tuple[str, str]] = []
        self.refuse = ""
        self.unknown: set[str] = set()

    async def handle_RCPT(  # noqa: N802
        self, _server: SMTP, _session: Session, envelope: Envelope, address: str, _options: Any
    ) -> str:
        if address in self.unknown:
            return "550 no such mailbox"
        envelope.rcpt_tos.append(address)
        return "250 OK"

    async def handle_DATA(self, _server: SMTP, _session: Session, envelope: Envelope) -> str:  # noqa: N802
        if self.refuse:
            return self.refuse
        self.taken.append(envelope)
        return "250 OK"

    def authenticate(
        self, _server: SMTP, _session: Session, _envelope: Envelope, _way: str, data: Any
    ) -> AuthResult:
        assert isinstance(data, LoginPassword)
        self.logins.append((data.login.decode(), data.password.decode()))
        return AuthResult(success=data.password == b"open sesame", handled=False)


class MailServer:
    """A mail server on a free port of this machine, in a thread of its own."""

    def __init__(self, mails: Mails, tls: ssl.SSLContext | None = None) -> None:
        guarded: dict[str, Any] = {}
        if tls is not None:
            guarded = {
                "tls_context": tls,
                "require_starttls": True,
                "authenticator": mails.authenticate,
                "auth_required": True,
            }
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._connections: list[SMTP] = []

        async def begin() -> asyncio.Server:
            def protocol() -> SMTP:
                made = SMTP(mails, hostname="mill.example", loop=self._loop, **guarded)
                self._connections.append(made)
                return made

            return await self._loop.create_server(protocol, "127.0.0.1", 0)

        self._thread.start()
        self._server = asyncio.run_coroutine_threadsafe(begin(), self._loop).result()
        self.port = int(self._server.sockets[0].getsockname()[1])

    def stop(self) -> None:
        """End it and its connections."""

        async def end() -> None:
            self._server.close()
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)
            # a task that is cancelled before its first step leaves its connection open
            for one in self._connections:
                if one.transport is not None:
                    one.transport.abort()
            # the sockets are closed in the next turn of the loop
            await asyncio.sleep(0)
            await asyncio.sleep(0)

        asyncio.run_coroutine_threadsafe(end(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
