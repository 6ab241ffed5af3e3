"""Reading what a browser asks for, and refusing what cannot be answered."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response

from fieldlink.errors import FieldlinkError
from fieldlink.web.responses import json_answer

__all__ = [
    "BadRequestError",
    "body_of",
    "milliseconds",
    "number_of",
    "refuse",
    "wants_json",
]

LARGEST_BODY = 8192
"""Bytes of a posted form: a name, a reason and a token are a few hundred."""


class BadRequestError(FieldlinkError):
    """A request whose parameters cannot be understood."""


def refuse(request: Request, status: int, said: str) -> Response:
    """Answer that a request is refused, with the reason."""
    answer = json_answer(request, {"error": said}, status)
    if status == 401:
        answer.headers["WWW-Authenticate"] = "Bearer"
    return answer


def wants_json(request: Request) -> bool:
    """Return whether a script asks, and not a person's browser for a page."""
    return request.url.path.startswith(("/api/", "/fragments/"))


def number_of(request: Request, key: str, default: float | None) -> float | None:
    """Return a parameter of the query as a number.

    Raises:
        BadRequestError: it is not a number.
    """
    text = request.query_params.get(key)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < 1e12:
        raise BadRequestError(f"{key} is {text[:40]!r}; give a number")
    return value


def milliseconds(seconds: float | None) -> int | None:
    """Return seconds as whole milliseconds."""
    return None if seconds is None else round(seconds * 1000.0)


async def body_of(request: Request) -> bytes:
    """Return what was posted.

    Raises:
        BadRequestError: it is too large.
    """
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > LARGEST_BODY:
            raise BadRequestError(f"the body has more than {LARGEST_BODY} bytes")
    return body
