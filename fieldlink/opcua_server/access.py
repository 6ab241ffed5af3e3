"""Who may connect, and what a client may ask: to look, and nothing else.

asyncua asks a rule for every request of a session; the rule here knows the services that read. What
is not among them is refused to every user: writing, calling, adding nodes, updating history. The
two requests that asyncua takes before a session, to register other servers, are refused as well.
"""

from __future__ import annotations

import hmac
from collections.abc import Collection
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import PermissionRuleset, User, UserRole
from asyncua.server.internal_server import InternalServer

__all__ = ["BoundedServer", "Doorkeeper", "ReadOnlyRules"]

_READING = (
    "ActivateSession",
    "Browse",
    "CloseSecureChannel",
    "CloseSession",
    "CreateMonitoredItems",
    "CreateSession",
    "CreateSubscription",
    "DeleteMonitoredItems",
    "DeleteSubscriptions",
    "FindServers",
    "GetEndpoints",
    "ModifyMonitoredItems",
    "ModifySubscription",
    "Publish",
    "Read",
    "RegisterNodes",
    "Republish",
    "SetMonitoringMode",
    "SetPublishingMode",
    "TranslateBrowsePathsToNodeIds",
    "UnregisterNodes",
)

SESSION_MS = 120_000.0
"""Longest time that a session may be silent; a client that is gone frees its place after it."""

ACTIVATE_WITHIN = 10.0
"""Seconds from the connection to the activated session."""

SUBSCRIPTIONS_A_CLIENT = 10
"""Subscriptions on average: a screen, an alarm list and a historian need one each."""

MOST_WAITING = 50
"""Requests of a connection that may wait for their answer; the connection is closed above that."""

MOST_QUEUE = 100
"""Values that are kept for a client that does not fetch them, of one variable."""


class ReadOnlyRules(PermissionRuleset):  # type: ignore[misc]
    """Allows the services that read to users who were let in."""

    def __init__(self) -> None:
        names = [f"{name}Request_Encoding_DefaultBinary" for name in _READING]
        self._allowed = {ua.NodeId(getattr(ua.ObjectIds, name)) for name in names}

    def check_validity(self, user: Any, action_type_id: Any, body: Any) -> bool:  # noqa: ARG002
        """Return whether a request may be answered; part of asyncua's interface."""
        return user.role is UserRole.User and action_type_id in self._allowed


class Doorkeeper:
    """Lets clients in.

    Args:
        username, password: what a client has to give; None lets everybody in.
        trusted: certificates (DER) of the clients that may connect; empty for any.
    """

    def __init__(
        self, username: str | None, password: str | None, trusted: Collection[bytes]
    ) -> None:
        self._username, self._password = username, password
        self._trusted = frozenset(trusted)

    def get_user(
        self,
        iserver: Any,  # noqa: ARG002
        username: str | None = None,
        password: str | None = None,
        certificate: bytes | None = None,
    ) -> User | None:
        """Return the user of a session, None to refuse it; part of asyncua's interface.

        ``certificate`` is that of the secure channel, whose key the client has proved to hold.
        """
        if self._trusted and certificate not in self._trusted:
            return None
        if self._username is not None and self._password is not None:
            known = _same(username, self._username) & _same(password, self._password)
            if not known:
                return None
        return User(role=UserRole.User, name=username)


class BoundedServer(InternalServer):  # type: ignore[misc]
    """asyncua's server with bounds on what clients may take, and without registration of others."""

    def __init__(self, doorkeeper: Doorkeeper, max_clients: int) -> None:
        super().__init__(user_manager=doorkeeper)
        self._most_sessions = max_clients
        self.max_connections = max_clients
        self.max_subscriptions = SUBSCRIPTIONS_A_CLIENT * max_clients
        self.max_session_timeout_ms = SESSION_MS
        self.max_pending_activation_seconds = ACTIVATE_WITHIN
        self.max_pending_messages_per_connection = MOST_WAITING
        self.max_monitored_item_queue_size = MOST_QUEUE

    def create_session(
        self, name: str, *arguments: Any, external: bool = False, **more: Any
    ) -> Any:
        """Create a session; part of asyncua's interface.

        Raises:
            ServiceError: there are as many as there may be.
        """
        if external and len(self._external_sessions) >= self._most_sessions:
            raise ServiceError(ua.StatusCodes.BadTooManySessions)
        return super().create_session(name, *arguments, external=external, **more)

    def register_server(self, server: Any, conf: Any = None) -> None:  # noqa: ARG002
        """Refuse to list another server; part of asyncua's interface.

        Raises:
            ServiceError: always.
        """
        raise ServiceError(ua.StatusCodes.BadServiceUnsupported)

    def register_server2(self, params: Any) -> Any:  # noqa: ARG002
        """Refuse to list another server; errors as `register_server`."""
        raise ServiceError(ua.StatusCodes.BadServiceUnsupported)


def _same(given: str | None, wanted: str) -> bool:
    return hmac.compare_digest((given or "").encode("utf-8", "replace"), wanted.encode())
