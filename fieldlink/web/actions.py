"""What a person may do at the pages: give an order, with the operator's token, and log in."""

from __future__ import annotations

import json
from urllib.parse import parse_qs

import structlog
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from fieldlink.daemon.operators.orders import Action, Order, OrderError
from fieldlink.errors import FieldlinkError
from fieldlink.once_a_minute import OnceAMinute
from fieldlink.web.access import COOKIE, SESSION_SECONDS, Access
from fieldlink.web.requests import BadRequestError, body_of, refuse
from fieldlink.web.responses import json_answer, page_answer, render, static_answer
from fieldlink.web.source import Source

__all__ = ["action_routes"]

_log = structlog.get_logger(__name__)


def action_routes(source: Source, access: Access) -> list[Route]:
    """Return the routes for orders, for logging in, and for the files that the pages load."""
    actions = _Actions(source, access)
    return [
        Route("/api/loops/{name:path}/actions", actions.act, methods=["POST"]),
        Route("/login", actions.login_form, methods=["GET"]),
        Route("/login", actions.login, methods=["POST"]),
        Route("/static/{name}", actions.static, methods=["GET"]),
    ]


class _Actions:
    def __init__(self, source: Source, access: Access) -> None:
        self._source = source
        self._access = access
        self._refusals = OnceAMinute()

    async def act(self, request: Request) -> Response:
        """Carry out an operator's order; the token is in the request's own header."""
        if not self._access.is_for_us(request):
            return refuse(request, 421, "this server answers for this machine only")
        if not self._source.has_daemon:
            return refuse(
                request, 409, "no daemon runs behind this page; actions need fieldlink run"
            )
        if not self._access.may_act(request):
            return refuse(
                request,
                401,
                f"this needs the operator's token; it is in {self._access.token_place}",
            )
        try:
            order = _order_of(request.path_params["name"], await body_of(request))
        except (BadRequestError, OrderError) as error:
            return refuse(request, 400, str(error))
        try:
            done = self._source.carry_out(order)
        except FieldlinkError as error:
            return refuse(request, 409, str(error))
        return json_answer(request, {"done": done, "action": order.action.code})

    async def login_form(self, request: Request) -> Response:
        """Ask for the token."""
        if not self._access.is_guarded:
            return RedirectResponse("/", 303)
        return page_answer(request, render("login.html.j2", site=self._source.name, wrong=False))

    async def login(self, request: Request) -> Response:
        """Give a session for the right token."""
        try:
            fields = parse_qs((await body_of(request)).decode("utf-8", "replace"))
        except BadRequestError as error:
            return refuse(request, 400, str(error))
        session = self._access.begin_session(fields.get("token", [""])[0].strip())
        if session is None:
            if count := self._refusals.note("login"):
                client = request.client and request.client.host
                _log.warning("web.login_refused", client=client, count=count)
            page = render("login.html.j2", site=self._source.name, wrong=True)
            return page_answer(request, page, 401)
        answer = RedirectResponse("/", 303)
        answer.set_cookie(
            COOKIE,
            session,
            max_age=SESSION_SECONDS,
            httponly=True,
            samesite="strict",
            secure=request.url.scheme == "https",
        )
        return answer

    async def static(self, request: Request) -> Response:
        """Give a file that the pages load; there is nothing secret in it."""
        return static_answer(request, request.path_params["name"])


def _order_of(loop: str, body: bytes) -> Order:
    """Return the order that a body asks for.

    Raises:
        BadRequestError: it is not an object of texts.
        OrderError: there is no such action, or who or why is missing or too long.
    """
    try:
        asked = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise BadRequestError("the body is not JSON") from error
    if not isinstance(asked, dict):
        raise BadRequestError("an action is a JSON object with action, who and why")
    texts = {key: asked.get(key, "") for key in ("action", "who", "why")}
    for key, text in texts.items():
        if not isinstance(text, str):
            raise BadRequestError(f'{key} is not a text; write "{key}": "..."')
    return Order(loop, Action.of(texts["action"]), texts["who"], texts["why"])
