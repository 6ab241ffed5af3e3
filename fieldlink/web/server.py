"""The HTTP server beside the daemon, in its event loop: bound to loopback unless told otherwise."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import stat
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import structlog
import uvicorn

from fieldlink.daemon import Daemon
from fieldlink.errors import FieldlinkError
from fieldlink.site import Site
from fieldlink.web.app import make_app
from fieldlink.web.limits import MOST_CONNECTIONS, BoundedListener, QuietLog, TimedProtocol

__all__ = ["WebError", "read_token", "web_server"]

SHORTEST_TOKEN = 20
"""Characters; less can be guessed."""

_log = structlog.get_logger(__name__)


class WebError(FieldlinkError):
    """The endpoints cannot be guarded as the site file asks."""


class _Server(uvicorn.Server):
    """Signals are the daemon's, not the server's."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


@asynccontextmanager
async def web_server(site: Site, daemon: Daemon) -> AsyncIterator[int | None]:
    """Answer HTTP while the block runs; gives the port, None when there is no server.

    A port that cannot be had is said and costs the endpoints only: the plant's data matter more
    than those who watch.

    Raises:
        WebError: the token or the certificate cannot be used.
    """
    settings = site.web
    if not settings.enabled:
        yield None
        return
    token = None if settings.token_file is None else read_token(site.resolve(settings.token_file))
    config = uvicorn.Config(
        make_app(daemon, token),
        log_config=None,
        access_log=False,
        lifespan="off",
        server_header=False,
        http=TimedProtocol,
        timeout_graceful_shutdown=2,
    )
    if settings.tls_certificate is not None and settings.tls_key is not None:
        config.ssl_certfile = str(site.resolve(settings.tls_certificate))
        config.ssl_keyfile = str(site.resolve(settings.tls_key))
    try:
        config.load()
    except OSError as error:
        raise WebError(
            f"web.tls_certificate and web.tls_key cannot be used: {error}; both are PEM files that "
            "this user can read"
        ) from error
    try:
        listener = _listen(settings.host, settings.port)
    except OSError as error:
        _log.error(
            "web.cannot_listen",
            address=f"{settings.host}:{settings.port}",
            error=error.strerror or str(error),
            advice="choose another web.port; the daemon goes on without health and metrics",
        )
        yield None
        return
    port = int(listener.getsockname()[1])
    server = _Server(config)
    quiet = QuietLog()
    logging.getLogger("uvicorn.error").addFilter(quiet)
    task = asyncio.create_task(server.serve([listener]), name="web")
    _log.info(
        "web.listening",
        address=f"{settings.host}:{port}",
        tls=config.is_ssl,
        token=token is not None,
    )
    try:
        yield port
    finally:
        server.should_exit = True
        await task
        listener.close()
        logging.getLogger("uvicorn.error").removeFilter(quiet)


def read_token(file: Path) -> str:
    """Return the token in a file.

    Raises:
        WebError: it cannot be read, others can read it, or it is too short.
    """
    try:
        token = file.read_text(encoding="utf-8").strip()
        mode = file.stat().st_mode
    except (OSError, UnicodeDecodeError) as error:
        raise WebError(f"web.token_file {file} cannot be read: {error}") from error
    if mode & (stat.S_IROTH | stat.S_IWOTH):
        raise WebError(
            f"web.token_file {file} can be read by everybody on this machine; chmod 640 {file}"
        )
    if len(token) < SHORTEST_TOKEN or not token.isascii() or not token.isprintable():
        raise WebError(
            f"web.token_file {file} holds {len(token)} characters; at least {SHORTEST_TOKEN} "
            "printable ones are needed, for instance from: openssl rand -hex 32"
        )
    return token


def _listen(host: str, port: int) -> socket.socket:
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    family, kind, protocol, _, address = found[0]
    listener = BoundedListener(family, kind, protocol)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(MOST_CONNECTIONS)
        listener.setblocking(False)
    except OSError:
        listener.close()
        raise
    return listener
