"""The pages and their JSON: routes, each a question to the source and a template.

Everything is computed in threads; the event loop, which polls the devices, only hands over.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from fieldlink.daemon import DaemonStatus
from fieldlink.store import StoreError
from fieldlink.web.access import Access
from fieldlink.web.actions import action_routes
from fieldlink.web.health import Readiness
from fieldlink.web.requests import BadRequestError, milliseconds, number_of, refuse, wants_json
from fieldlink.web.responses import json_answer, page_answer, render
from fieldlink.web.source import Source
from fieldlink.web.view.causes import findings_document
from fieldlink.web.view.cost_map import cost_map
from fieldlink.web.view.curves import RAW, curves, phase
from fieldlink.web.view.devices import devices_document
from fieldlink.web.view.loop_page import loop_document
from fieldlink.web.view.store_queries import Row

__all__ = ["page_routes"]

_Work = Callable[[Request, DaemonStatus | None], Response]


def page_routes(source: Source, access: Access) -> list[Route]:
    """Return the routes of the pages."""
    pages = _Pages(source, access)
    looking: tuple[tuple[str, _Work], ...] = (
        ("/", pages.fleet),
        ("/devices", pages.devices),
        ("/loops/{name:path}", pages.loop),
        ("/fragments/fleet", pages.fleet_changes),
        ("/fragments/devices", pages.devices_part),
        ("/fragments/loops/{name:path}", pages.loop_part),
        ("/api/loops", pages.api_fleet),
        ("/api/devices", pages.api_devices),
        ("/api/findings", pages.api_findings),
        ("/api/loops/{name:path}/samples", pages.api_samples),
        ("/api/loops/{name:path}/window", pages.api_window),
        ("/api/loops/{name:path}/map", pages.api_map),
        ("/api/loops/{name:path}", pages.api_loop),
    )
    return [
        *(Route(path, pages.answer(work), methods=["GET"]) for path, work in looking),
        *action_routes(source, access),
    ]


class _Pages:
    def __init__(self, source: Source, access: Access) -> None:
        self._source = source
        self._access = access

    def answer(self, work: _Work) -> Callable[[Request], Awaitable[Response]]:
        """Return the handler that guards a piece of work and does it in a thread."""

        async def handle(request: Request) -> Response:
            if not self._access.is_for_us(request):
                return refuse(request, 421, "this server answers for this machine only")
            if not self._access.may_look(request):
                if wants_json(request):
                    return refuse(request, 401, "a bearer token is needed")
                return RedirectResponse("/login", 303)
            status = self._source.status()
            try:
                return await asyncio.to_thread(work, request, status)
            except StoreError as error:
                return self._store_failed(request, error)
            except BadRequestError as error:
                return refuse(request, 400, str(error))

        return handle

    # pages ---------------------------------------------------------------------------------------

    def fleet(self, request: Request, status: DaemonStatus | None) -> Response:
        _, fleet = self._source.fleet(status)
        return page_answer(
            request,
            render(
                "fleet.html.j2",
                **self._frame(status, "fleet"),
                rows=fleet.rows,
                revision=fleet.revision,
                largest=_largest(fleet.rows),
                findings=findings_document(self._source.queries()),
            ),
        )

    def devices(self, request: Request, status: DaemonStatus | None) -> Response:
        found = devices_document(self._source.queries(), self._source.site, status)
        return page_answer(
            request, render("devices.html.j2", **self._frame(status, "devices"), **found)
        )

    def loop(self, request: Request, status: DaemonStatus | None) -> Response:
        found = self._loop(request, status)
        if found is None:
            return self._missing(request, status)
        return page_answer(
            request, render("loop.html.j2", **self._frame(status, "loop"), loop=found)
        )

    # parts that live pages fetch -----------------------------------------------------------------

    def fleet_changes(self, request: Request, status: DaemonStatus | None) -> Response:
        _, fleet = self._source.fleet(status)
        known = number_of(request, "revision", None)
        # None, or one of another clock or another process: everything is sent.
        known = -1.0 if known is None or known > fleet.revision else known
        largest = _largest(fleet.rows)
        return json_answer(
            request,
            {
                "revision": fleet.revision,
                "order": [row["name"] for row in fleet.rows] if fleet.revision != known else None,
                "rows": {
                    row["name"]: render("fleet_row.html.j2", row=row, largest=largest)
                    for row in fleet.rows
                    if fleet.revisions[row["name"]] > known
                },
                "bar": self._bar(status),
                "summary": render("fleet_summary.html.j2", rows=fleet.rows),
                "findings": render(
                    "fleet_findings.html.j2", findings=findings_document(self._source.queries())
                ),
            },
        )

    def devices_part(self, request: Request, status: DaemonStatus | None) -> Response:
        found = devices_document(self._source.queries(), self._source.site, status)
        part = render("devices_part.html.j2", has_daemon=self._source.has_daemon, **found)
        return json_answer(request, {"bar": self._bar(status), "parts": {"devices": part}})

    def loop_part(self, request: Request, status: DaemonStatus | None) -> Response:
        found = self._loop(request, status)
        if found is None:
            return self._missing(request, status)
        names = ("now", "causes", "why", "effect", "written", "orders")
        frame = {"has_daemon": self._source.has_daemon}
        parts = {name: render(f"loop_{name}.html.j2", loop=found, **frame) for name in names}
        return json_answer(
            request,
            {
                "bar": self._bar(status),
                "parts": parts,
                "estimate": found["estimate"] and found["estimate"]["id"],
            },
        )

    # the same as JSON ----------------------------------------------------------------------------

    def api_fleet(self, request: Request, status: DaemonStatus | None) -> Response:
        _, fleet = self._source.fleet(status)
        return json_answer(
            request,
            {
                "site": self._source.name,
                "daemon": {"alive": status is not None, "since": self._source.since},
                "loops": fleet.rows,
            },
        )

    def api_devices(self, request: Request, status: DaemonStatus | None) -> Response:
        return json_answer(
            request, devices_document(self._source.queries(), self._source.site, status)
        )

    def api_findings(self, request: Request, status: DaemonStatus | None) -> Response:  # noqa: ARG002
        return json_answer(request, {"findings": findings_document(self._source.queries())})

    def api_loop(self, request: Request, status: DaemonStatus | None) -> Response:
        found = self._loop(request, status)
        return self._missing(request, status) if found is None else json_answer(request, found)

    def api_samples(self, request: Request, status: DaemonStatus | None) -> Response:
        name, queries = self._known(request, status), self._source.queries()
        if name is None:
            return self._missing(request, status)
        since, until, last = (
            milliseconds(number_of(request, key, None)) for key in ("since", "until", "last")
        )
        found = curves(
            queries,
            name,
            self._judged(name, status),
            since_ms=since,
            until_ms=until,
            last_ms=last,
            live=self._source.has_daemon,
            points=round(number_of(request, "points", RAW) or RAW),
        )
        return json_answer(request, found)

    def api_window(self, request: Request, status: DaemonStatus | None) -> Response:
        name, queries = self._known(request, status), self._source.queries()
        judged = None if name is None else self._judged(name, status)
        if judged is None:
            return self._missing(request, status)
        return json_answer(
            request, {"estimate": judged["id"], **phase(queries.window(judged), judged)}
        )

    def api_map(self, request: Request, status: DaemonStatus | None) -> Response:
        name, queries = self._known(request, status), self._source.queries()
        judged = None if name is None else self._judged(name, status)
        if judged is None:
            return self._missing(request, status)
        found = cost_map(queries, self._source.analyst, judged, self._source.site)
        return json_answer(request, found, 202 if found["state"] == "computing" else 200)

    # -----------------------------------------------------------------------------------------

    @property
    def _token_place(self) -> str:
        return self._access.token_place

    def _loop(self, request: Request, status: DaemonStatus | None) -> dict[str, Any] | None:
        view, fleet = self._source.fleet(status)
        name = request.path_params["name"]
        return loop_document(self._source.queries(), view, fleet, self._source.site, name)

    def _known(self, request: Request, status: DaemonStatus | None) -> str | None:
        """Return the name of the loop that is asked for; None when there is none."""
        _, fleet = self._source.fleet(status)
        name = str(request.path_params["name"])
        return name if any(row["name"] == name for row in fleet.rows) else None

    def _judged(self, name: str, status: DaemonStatus | None) -> Row | None:
        view, _ = self._source.fleet(status)
        return view.judged_of(name, status)

    def _frame(self, status: DaemonStatus | None, page: str) -> dict[str, Any]:
        return {
            "site": self._source.name,
            "page": page,
            "bar": self._bar(status),
            "has_daemon": self._source.has_daemon,
            "allows_actions": self._access.allows_actions and self._source.has_daemon,
            "token_place": self._token_place,
        }

    def _bar(self, status: DaemonStatus | None) -> str:
        found = None
        if status is not None:
            found = Readiness.of(status, started=self._source.is_started)
        return render("bar.html.j2", readiness=found, has_daemon=self._source.has_daemon)

    def _missing(self, request: Request, status: DaemonStatus | None) -> Response:
        said = "there is no such loop, or nothing of it has been judged yet"
        if wants_json(request):
            return refuse(request, 404, said)
        page = render("message.html.j2", **self._frame(status, ""), title="Not found", text=said)
        return page_answer(request, page, 404)

    def _store_failed(self, request: Request, error: StoreError) -> Response:
        if wants_json(request):
            return refuse(request, 503, str(error))
        page = render(
            "message.html.j2",
            **self._frame(self._source.status(), ""),
            title="The store cannot be read yet",
            text=str(error),
        )
        return page_answer(request, page, 503)


def _largest(rows: list[dict[str, Any]]) -> float:
    """Return the scale of the stick bands' bars: all on one, with every limit and interval."""
    values = [row["limit"] or 0.0 for row in rows]
    values += [row["stick_band"]["high"] or row["stick_band"]["value"] or 0.0 for row in rows]
    return max([value for value in values if value], default=1.0)
