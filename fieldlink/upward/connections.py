"""One connection after another to a broker: when the next one is due, and which events tell it."""

from __future__ import annotations

import time
from collections.abc import Callable

from fieldlink.links.backoff import Backoff, BackoffSettings
from fieldlink.upward.broker_settings import BrokerSettings

__all__ = ["Connections"]

PATIENCE = BackoffSettings(first=0.5, cap=30.0)
"""Pauses between attempts to connect."""

STEADY = 30.0
"""Seconds for which a connection must stand before the next pause is the shortest again: a broker
that takes every connection and ends it at once would otherwise be asked twice a second for ever."""

SHORT_LIVED = 3
"""Connections in a row that ended before that; then one event stands for all of them."""


class Connections:
    """The connections of one format.

    Args:
        settings: the broker.
        source: of the events.
        tell: records events: kind, source, message, ``bad``.

    Attributes:
        is_up: whether one stands now.
        count: how many there have been.
        last_error: why the last one was lost.
    """

    def __init__(self, settings: BrokerSettings, source: str, tell: Callable[..., None]) -> None:
        self._settings, self._source, self._tell = settings, source, tell
        self._backoff = Backoff(PATIENCE)
        self._up_since = 0.0
        self._is_told_up = False
        self._short_lived = 0
        self.is_up = False
        self.count = 0
        self.last_error = ""

    @property
    def pause(self) -> float:
        """Seconds until the next attempt is due."""
        return self._backoff.remaining(time.monotonic())

    def note_begin(self) -> None:
        """Note that a connection stands."""
        self.is_up = True
        self.count += 1
        self._up_since = time.monotonic()
        if self._short_lived < SHORT_LIVED:
            self._tell_begin()

    def note_work(self) -> None:
        """Note that the connection serves; when it has for long, the trouble is over."""
        if time.monotonic() - self._up_since >= STEADY:
            self._backoff.succeeded()
            self._short_lived = 0
            self._tell_begin()

    def note_end(self, *, is_known: bool) -> None:
        """Note that the connection, if there was one, has ended.

        Args:
            is_known: whether the reason is logged elsewhere; an early end is not counted then.
        """
        early = self.is_up and time.monotonic() - self._up_since < STEADY
        self.is_up = False
        if not early or is_known:
            return
        self._short_lived += 1
        if self._short_lived == SHORT_LIVED:
            self._tell(
                "mqtt.unsteady",
                self._source,
                f"the last {SHORT_LIVED} connections to {self._settings.where} were lost within "
                f"{STEADY:g} s; check whether another client has the name "
                f"{self._settings.client_id}, and the broker's log",
                bad=True,
            )

    def note_failure(self, said: str | None = None) -> None:
        """Note why the connection was lost or not made; without words another event tells it."""
        first = self._is_told_up or self._backoff.failures == 0
        self._is_told_up = False
        self._backoff.failed(time.monotonic())
        if said is None:
            return
        # One event for each way of failing: a broker that is away for a day is two lines.
        if first or said != self.last_error:
            self._tell("mqtt.lost", self._source, said, bad=True)
        self.last_error = said

    def _tell_begin(self) -> None:
        if not self._is_told_up:
            self._is_told_up = True
            self._tell("mqtt.connected", self._source, f"connected to {self._settings.where}")
