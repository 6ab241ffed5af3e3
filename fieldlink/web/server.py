"""The HTTP server, in the daemon's event loop or alone: bound to loopback unless set otherwise."""

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
from starlette.applications import Starlette

from fieldlink.daemon import Daemon
from fieldlink.errors import FieldlinkError
from fieldlink.site import Site
from fieldlink.web.access import Access, is_local_name, make_operator_token
from fieldlink.web.app import make_app, make_store_app
from fieldlink.web.certificate import fault_of, follow_certificate
from fieldlink.web.limits import MOST_CONNECTIONS, BoundedListener, QuietLog, TimedProtocol
from fieldlink.web.source import Source

__all__ = [
    "WebError",
    "live_source",
    "page_address",
    "read_token",
    "store_server",
    "web_server",
]

SHORTEST_TOKEN = 20
"""Characters; less can be guessed."""

_log = structlog.get_logger(__name__)


class WebError(FieldlinkError):
    """The endpoints cannot be guarded as the site file asks."""

    may_pass = False


class _Server(uvicorn.Server):
    """Signals are the daemon's, not the server's."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


@asynccontextmanager
async def live_source(daemon: Daemon) -> AsyncIterator[Source]:
    """Yield the one source of a running daemon for pages and OPC UA; close it at the end."""
    source = Source.of_daemon(daemon)
    try:
        yield source
    finally:
        await asyncio.to_thread(source.close)


@asynccontextmanager
async def web_server(
    site: Site, daemon: Daemon, source: Source | None = None
) -> AsyncIterator[int | None]:
    """Answer HTTP while the block runs; gives the port, None when there is no server.

    If the port cannot be used, that is logged and the daemon runs without endpoints and pages: the
    plant's data matter more than those who watch.

    Args:
        site: the site.
        daemon: the daemon.
        source: what the pages show, where others show it too; one of their own unless given.

    Raises:
        WebError: the token or the certificate cannot be used.
    """
    settings = site.web
    if not settings.enabled:
        yield None
        return
    if source is None:
        async with live_source(daemon) as own, web_server(site, daemon, own) as port:
            yield port
        return
    access = _access_of(site)
    config = _configure(make_app(daemon, source, access), site)
    try:
        listener = _listen(settings.host, settings.port)
    except OSError as error:
        _log.error(
            "web.cannot_listen",
            address=f"{settings.host}:{settings.port}",
            error=error.strerror or str(error),
            advice="choose another web.port; the daemon goes on without health, metrics and pages",
        )
        yield None
        return
    async with _serving(config, listener, source):
        _log.info(
            "web.listening",
            address=f"{settings.host}:{listener.getsockname()[1]}",
            tls=config.is_ssl,
            token=access.is_guarded,
        )
        yield int(listener.getsockname()[1])


@asynccontextmanager
async def store_server(url: str, site: Site | None, host: str, port: int) -> AsyncIterator[str]:
    """Serve the pages of a store, read-only, while the block runs; gives their address.

    Args:
        url: the store.
        site: its site file, for limits, token and TLS; None where only the store is known.
        host, port: where to listen.

    Raises:
        WebError: other machines would reach it without token and TLS, or the port is in use.
        StoreError: there is no store to read.
    """
    source = Source(url, lambda: site)
    source.queries()
    local = is_local_name(host)
    guarded = site is not None and site.web.token_file and site.web.tls_certificate
    if not local and not guarded:
        raise WebError(
            f"--host {host} lets other machines in; that needs a site file with web.token_file, "
            "web.tls_certificate and web.tls_key, or use --host 127.0.0.1"
        )
    token = None
    if site is not None and site.web.token_file is not None:
        token = read_token(site.resolve(site.web.token_file))
    config = _configure(make_store_app(source, Access(token, None, "", local=local)), site)
    try:
        listener = _listen(host, port)
    except OSError as error:
        raise WebError(
            f"{host}:{port} cannot be used: {error.strerror or error}; name another --port"
        ) from error
    try:
        async with _serving(config, listener, source):
            scheme = "https" if config.is_ssl else "http"
            shown = f"[{host}]" if ":" in host else host
            yield f"{scheme}://{shown}:{listener.getsockname()[1]}/"
    finally:
        await asyncio.to_thread(source.close)


def page_address(site: Site, port: int) -> str:
    """Return the address of the pages of a daemon that listens on a port."""
    scheme = "http" if site.web.tls_certificate is None else "https"
    host = f"[{site.web.host}]" if ":" in site.web.host else site.web.host
    return f"{scheme}://{host}:{port}/"


def _access_of(site: Site) -> Access:
    """Return who may look and act: by the site file's token, or by one drawn for actions."""
    settings = site.web
    if settings.token_file is not None:
        file = site.resolve(settings.token_file)
        token = read_token(file)
        return Access(token, token, f"{file} (web.token_file)", local=settings.is_local)
    try:
        file = make_operator_token(site.data_dir)
        own = read_token(file)
    except FieldlinkError as error:
        _log.warning("web.no_actions", error=str(error))
        return Access(None, None, "", local=settings.is_local)
    return Access(None, own, str(file), local=settings.is_local)


def _configure(app: Starlette, site: Site | None) -> uvicorn.Config:
    config = uvicorn.Config(
        app,
        log_config=None,
        access_log=False,
        lifespan="off",
        server_header=False,
        http=TimedProtocol,
        timeout_graceful_shutdown=2,
    )
    settings = None if site is None else site.web
    if site is not None and settings is not None:
        certificate, key = settings.tls_certificate, settings.tls_key
        if certificate is not None and key is not None:
            files = [site.resolve(certificate), site.resolve(key)]
            if problem := fault_of(files):
                raise WebError(
                    f"web.tls_certificate and web.tls_key cannot be used: {problem}; both are PEM "
                    "files that this user can read, the key without a password"
                )
            config.ssl_certfile, config.ssl_keyfile = map(str, files)
    config.load()
    return config


@asynccontextmanager
async def _serving(
    config: uvicorn.Config, listener: socket.socket, source: Source
) -> AsyncIterator[None]:
    server = _Server(config)
    quiet = QuietLog()
    logging.getLogger("uvicorn.error").addFilter(quiet)
    task = asyncio.create_task(server.serve([listener]), name="web")
    # The store is read once in full: that has begun when the first page is asked for.
    reading = asyncio.create_task(asyncio.to_thread(source.read_ahead), name="web store")
    following = asyncio.create_task(follow_certificate(config), name="web certificate")
    try:
        yield
    finally:
        server.should_exit = True
        following.cancel()
        await asyncio.gather(following, return_exceptions=True)
        await task
        await reading
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
        why = getattr(error, "strerror", None) or "it is not a text"
        raise WebError(
            f"the token's file {file} cannot be read ({why}); let this user read it, and nobody "
            "else write it"
        ) from error
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
