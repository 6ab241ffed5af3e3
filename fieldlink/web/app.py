"""The application: health, readiness and metrics, and beside them the pages (`pages`)."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from fieldlink.daemon import Daemon
from fieldlink.web.access import Access
from fieldlink.web.health import Readiness
from fieldlink.web.metrics import render_metrics
from fieldlink.web.pages import page_routes
from fieldlink.web.source import Source

__all__ = ["make_app", "make_store_app"]

_Answer = Callable[[Request], Awaitable[Response]]


def make_app(daemon: Daemon, source: Source, access: Access) -> Starlette:
    """Return the endpoints and the pages of a daemon.

    Args:
        daemon: the daemon.
        source: what the pages show.
        access: who may look and who may act.
    """

    async def healthz(_: Request) -> Response:
        stuck = daemon.stuck()
        return JSONResponse(
            {"status": "stuck" if stuck else "ok", "stuck": list(stuck)}, 503 if stuck else 200
        )

    async def readyz(_: Request) -> Response:
        found = Readiness.of(daemon.status(), started=daemon.started.is_set())
        return JSONResponse(found.to_dict(), 200 if found.ready else 503)

    async def metrics(_: Request) -> Response:
        # In a thread: thousands of lines must not hold up the polls.
        text = await asyncio.to_thread(render_metrics, daemon.status())
        return Response(text, media_type="text/plain; version=0.0.4; charset=utf-8")

    def guarded(answer: _Answer, *, under_any_name: bool = False) -> _Answer:
        async def check(request: Request) -> Response:
            if not under_any_name and not access.may_scrape_by_name(request):
                return Response(
                    "this server answers for this machine only: ask it as 127.0.0.1 or localhost, "
                    "or with the token of a web.token_file\n",
                    421,
                    media_type="text/plain",
                )
            if not access.may_scrape(request):
                return Response(
                    "a bearer token is needed\n",
                    401,
                    {"WWW-Authenticate": "Bearer"},
                    media_type="text/plain",
                )
            return await answer(request)

        return check

    return Starlette(
        routes=[
            # A watchdog may know this machine under any name, and learns nothing of the plant.
            Route("/healthz", guarded(healthz, under_any_name=True), methods=["GET"]),
            Route("/readyz", guarded(readyz), methods=["GET"]),
            Route("/metrics", guarded(metrics), methods=["GET"]),
            *page_routes(source, access),
        ]
    )


def make_store_app(source: Source, access: Access) -> Starlette:
    """Return the pages of a store without a daemon."""
    return Starlette(routes=page_routes(source, access))
