"""Who may look and who may act.

Looking needs the token of the site file where there is one: as ``Authorization: Bearer``, or, in a
browser, as a session that the login page gives for it. Acting always needs a token in the header of
the request itself, never a cookie, so that no other page can make a browser act. Without a token of
the site file, on loopback, the daemon draws one for actions and keeps it in its data directory:
those who may write there may give orders to the daemon anyway.
"""

from __future__ import annotations

import hmac
import re
import secrets
import time
from ipaddress import ip_address
from pathlib import Path

from starlette.requests import Request

from fieldlink.errors import FieldlinkError
from fieldlink.unfinished_file import write_whole

__all__ = [
    "COOKIE",
    "SESSION_SECONDS",
    "TOKEN_FILE",
    "Access",
    "is_local_name",
    "make_operator_token",
]

COOKIE = "fieldlink_session"

SESSION_SECONDS = 12 * 3600
"""A shift, and the hand-over after it."""

MOST_SESSIONS = 200
"""Sessions at a time; the oldest ends when one more begins."""

TOKEN_FILE = "operator-token"

_HOST = re.compile(r"(\[[^\[\]]*\]|[^\[\]:]*)(?::[0-9]{1,5})?")
"""A Host header: a name or an address, and a port."""


class Access:
    """Decides about requests.

    Args:
        token: what looking needs; nothing when None.
        operator_token: what acting needs; nobody may act when None.
        token_place: where an operator finds that token, for the page.
        local: whether only this machine reaches the server.
    """

    def __init__(
        self, token: str | None, operator_token: str | None, token_place: str, *, local: bool
    ) -> None:
        self._token = token
        self._operator_token = operator_token
        self._local = local
        self._sessions: dict[str, float] = {}
        self.token_place = token_place

    @property
    def is_guarded(self) -> bool:
        """Whether looking needs a token."""
        return self._token is not None

    @property
    def allows_actions(self) -> bool:
        """Whether anybody may act."""
        return self._operator_token is not None

    def may_scrape(self, request: Request) -> bool:
        """Whether a request may read health and metrics: by its header alone."""
        return self._token is None or _bears(request, self._token)

    def may_scrape_by_name(self, request: Request) -> bool:
        """Whether a request names this server, or bears a token, which no foreign page has."""
        token = self._token
        return self.is_for_us(request) or (token is not None and _bears(request, token))

    def may_look(self, request: Request) -> bool:
        """Whether a request may read the pages: by its header, or by its session."""
        if self.may_scrape(request):
            return True
        ends = self._sessions.get(request.cookies.get(COOKIE, ""))
        return ends is not None and time.monotonic() < ends

    def may_act(self, request: Request) -> bool:
        """Whether a request may act: by its header alone."""
        return self._operator_token is not None and _bears(request, self._operator_token)

    def is_for_us(self, request: Request) -> bool:
        """Whether a request names this server, so that no foreign name is bound to it."""
        if not self._local:
            return True
        # Starlette answers for a header that it cannot read as if it named the server itself.
        named = _HOST.fullmatch(request.headers.get("Host", ""))
        return named is not None and is_local_name(named[1].lower())

    def begin_session(self, token: str) -> str | None:
        """Return a new session for the right token, else None."""
        if self._token is None or not _same(token, self._token):
            return None
        while len(self._sessions) >= MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        session = secrets.token_urlsafe(32)
        self._sessions[session] = time.monotonic() + SESSION_SECONDS
        return session


def is_local_name(host: str) -> bool:
    """Whether a name means this machine: ``localhost`` or a loopback address."""
    if host in ("localhost", ""):
        return True
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def make_operator_token(data_dir: Path) -> Path:
    """Return the file with the token for actions; it is drawn once and kept, for its owner only.

    Raises:
        FieldlinkError: it cannot be written.
    """
    file = data_dir / TOKEN_FILE
    try:
        # An empty one is what a full disk has left of an attempt.
        if file.exists() and file.stat().st_size:
            return file
        data_dir.mkdir(mode=0o750, parents=True, exist_ok=True)
        write_whole(file, f"{secrets.token_hex(16)}\n".encode("ascii"), mode=0o600)
    except OSError as error:
        raise FieldlinkError(
            f"the token for actions cannot be kept in {file}: {error.strerror}; make the data "
            "directory writable and see to free space, or name a web.token_file"
        ) from error
    return file


def _bears(request: Request, token: str) -> bool:
    scheme, _, given = request.headers.get("Authorization", "").partition(" ")
    return scheme.lower() == "bearer" and _same(given.strip(), token)


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "replace"), token.encode())
