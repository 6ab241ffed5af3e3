"""A web hook: each notice is one POST of JSON."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import ssl
from pathlib import Path
from urllib.parse import urlsplit

from fieldlink.errors import MissingExtraError
from fieldlink.notices.errors import NoticeError
from fieldlink.notices.notice import Notice
from fieldlink.secret import Secret
from fieldlink.site.base import is_loopback
from fieldlink.tls_words import tls_remedy, tls_words

__all__ = ["WebHookReceiver"]

PATIENCE = 20.0
"""Seconds for a POST in all: a receiver that hands on to another service answers within a few."""

_REMEDIES = {
    401: "check the token",
    403: "check the token, and what it may do there",
    404: "check the address",
    413: "it does not take a notice of this size: see its settings",
    429: "it does not take so many notices: lower notify.per_hour",
}
"""By HTTP status."""


class WebHookReceiver:
    """Posts notices to one address.

    Args:
        site_file: for messages.
        url: the address; it may be a secret itself, so only its host is ever shown.
        token: sent as ``Authorization: Bearer``; None without one.
        tls: certificates for an https address.

    Raises:
        MissingExtraError: httpx is not installed.
        NoticeError: the address is not for the web, or the token would go unencrypted or cannot be
            sent.
    """

    def __init__(
        self, site_file: Path, url: str, token: Secret | None, tls: ssl.SSLContext
    ) -> None:
        try:
            import httpx
        except ImportError as error:
            place = f"{site_file}: the table [notify.web_hook]"
            raise MissingExtraError(place, "httpx", "notify") from error
        # its log lines would tell the whole address
        for name in ("httpx", "httpcore"):
            logging.getLogger(name).setLevel(logging.WARNING)
        try:
            parts = urlsplit(url)
            host, port = parts.hostname, parts.port
            httpx.URL(url)
        except (ValueError, httpx.InvalidURL) as error:
            raise NoticeError(
                f"{site_file}: notify.web_hook: not a web address; write https://HOST/PATH"
            ) from error
        if parts.scheme not in ("http", "https") or not host:
            raise NoticeError(
                f"{site_file}: notify.web_hook: not a web address; write https://HOST/PATH"
            )
        has_secret = token is not None or parts.password is not None
        if has_secret and parts.scheme == "http" and not is_loopback(host):
            raise NoticeError(
                f"{site_file}: notify.web_hook: the token or password would cross the network "
                "unencrypted; use an https address"
            )
        if token is not None and not (token.reveal().isascii() and token.reveal().isprintable()):
            raise NoticeError(
                f"{site_file}: notify.web_hook: the token has characters that a header cannot "
                "carry; write it in ASCII on one line"
            )
        self._httpx = httpx
        self._url = Secret(url)
        self._token = token
        self._tls = tls
        shown = f"[{host}]" if ":" in host else host
        self.where = f"{parts.scheme}://{shown}" + ("" if port is None else f":{port}")

    async def send(self, notice: Notice) -> str:
        """Post a notice; see `Receiver.send`."""
        httpx = self._httpx
        headers = {"User-Agent": "fieldlink"}
        if self._token is not None:
            headers["Authorization"] = f"Bearer {self._token.reveal()}"
        try:
            async with (
                asyncio.timeout(PATIENCE),
                httpx.AsyncClient(verify=self._tls, timeout=PATIENCE) as client,
                client.stream(
                    "POST", self._url.reveal(), json=notice.to_dict(), headers=headers
                ) as answer,
            ):
                # the status is enough; a body without end is not waited for
                status = answer.status_code
        except (TimeoutError, httpx.TimeoutException) as error:
            raise NoticeError(f"{self.where} did not answer within {PATIENCE:g} s") from error
        except httpx.HTTPError as error:
            cause, remedy = _cause(error)
            raise NoticeError(f"{self.where} cannot be reached: {cause}; {remedy}") from error
        if not 200 <= status < 300:
            raise NoticeError(
                f"{self.where} answered with HTTP status {status}; {_remedy_of(status)}"
            )
        return ""


def _remedy_of(status: int) -> str:
    """What to do about an answer that takes no notice (RFC 9110, 15)."""
    if status in _REMEDIES:
        return _REMEDIES[status]
    if 300 <= status < 400:
        return "it names another address, where notices do not follow it: write that address"
    if status >= 500:
        return "it has failed by itself: see its own log"
    return "check address and token"


def _cause(error: Exception) -> tuple[str, str]:
    """The innermost cause in words, and what to do; never the request, which has the secrets."""
    inner: BaseException = error
    while (deeper := inner.__cause__ or inner.__context__) is not None:
        inner = deeper
    remedy = "check address, certificates and network"
    if isinstance(inner, ssl.SSLError):
        table = "notify.web_hook"
        hint = tls_remedy(inner, f"{table}.ca", host=f"the host of {table}.url")
        return tls_words(inner), hint or remedy
    if isinstance(inner, socket.gaierror):
        return "no address is known for its name", remedy
    if isinstance(inner, OSError) and inner.errno:
        return os.strerror(inner.errno).lower(), remedy
    return "the connection was lost", remedy
