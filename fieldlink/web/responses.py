"""Answers of the pages: rendered, packed and guarded by headers that let no foreign origin in."""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

import jinja2
from starlette.requests import Request
from starlette.responses import Response

from fieldlink.web.view import texts

__all__ = ["STATIC", "json_answer", "load_templates", "page_answer", "render", "static_answer"]

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
        "connect-src 'self'; form-action 'self'; frame-ancestors 'none'; base-uri 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}

PACK_FROM = 1000
"""Bytes from which an answer is packed: below that the packing costs more than it saves."""

PACK_LEVEL = 4
"""Of nine: a page of 500 loops shrinks to a twelfth in a few milliseconds."""

STATIC = {
    "fieldlink.css": ("text/css", "fieldlink.web", "static/fieldlink.css"),
    "fleet.js": ("text/javascript", "fieldlink.web", "static/fleet.js"),
    "loop.js": ("text/javascript", "fieldlink.web", "static/loop.js"),
    "live.js": ("text/javascript", "fieldlink.web", "static/live.js"),
    "uPlot.js": ("text/javascript", "uplot", "static/uPlot.iife.js"),
    "uPlot.css": ("text/css", "uplot", "static/uPlot.min.css"),
}
"""Files that the pages load: media type, package and path. The charts' are their wheel's own."""


def render(template: str, **values: Any) -> str:
    """Return a page or a part of one."""
    return _environment().get_template(template).render(**values)


def load_templates() -> None:
    """Compile every template, so that the first page need not."""
    environment = _environment()
    for name in environment.list_templates():
        environment.get_template(name)


def page_answer(request: Request, text: str, status: int = 200) -> Response:
    """Return a page."""
    headers = {**HEADERS, "Cache-Control": "no-store"}
    return _packed(request, text.encode(), "text/html; charset=utf-8", headers, status)


def json_answer(request: Request, document: Any, status: int = 200) -> Response:
    """Return a document as JSON; a number that is not finite is null."""
    text = json.dumps(_finite(document), separators=(",", ":"), allow_nan=False)
    headers = {**HEADERS, "Cache-Control": "no-store"}
    return _packed(request, text.encode(), "application/json", headers, status)


def static_answer(request: Request, name: str) -> Response:
    """Return one of `STATIC`, or 404."""
    if name not in STATIC:
        return Response("no such file\n", 404, HEADERS, media_type="text/plain")
    headers = {**HEADERS, "Cache-Control": "no-cache", "ETag": f'"{static_hash(name)}"'}
    if request.headers.get("If-None-Match") == headers["ETag"]:
        return Response(None, 304, headers)
    return _packed(request, _static(name), f"{STATIC[name][0]}; charset=utf-8", headers, 200)


@cache
def static_hash(name: str) -> str:
    """Return what changes with a file's content."""
    return hashlib.sha256(_static(name)).hexdigest()[:16]


@cache
def _static(name: str) -> bytes:
    _, package, path = STATIC[name]
    # The charts' wheel is not imported: its Python part would bring IPython along.
    found = files(package).joinpath(path) if package != "uplot" else _uplot(path)
    return bytes(found.read_bytes())


def _uplot(path: str) -> Any:
    from importlib.metadata import distribution

    return distribution("uplot-python").locate_file(f"uplot/{path}")


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("fieldlink.web"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        number=texts.number_text,
        percent=texts.percent_text,
        duration=texts.duration_text,
        moment=texts.moment_text,
        iso=texts.iso_time,
    )
    environment.globals.update(verdict_of=texts.verdict_of, static_hash=static_hash)
    return environment


def _packed(
    request: Request, body: bytes, media_type: str, headers: Mapping[str, str], status: int
) -> Response:
    sent = {**headers, "Vary": "Accept-Encoding"}
    if len(body) >= PACK_FROM and "gzip" in request.headers.get("Accept-Encoding", ""):
        body = gzip.compress(body, PACK_LEVEL)
        sent["Content-Encoding"] = "gzip"
    return Response(body, status, sent, media_type=media_type)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
