"""What the pages are about: a running daemon with its store, or a store alone."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import structlog

from fieldlink.daemon import Daemon, DaemonStatus
from fieldlink.daemon.operators.orders import Order
from fieldlink.site import Site
from fieldlink.store import StoreError
from fieldlink.store.database import file_of
from fieldlink.web.analyst import Analyst
from fieldlink.web.responses import load_templates
from fieldlink.web.view.fleet_view import Fleet, FleetView
from fieldlink.web.view.store_queries import StoreQueries

__all__ = ["Source"]

_log = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class _Opened:
    queries: StoreQueries
    view: FleetView
    identity: tuple[int, int] | None


class Source:
    """Gives the pages what they show.

    Args:
        url: the store.
        site: gives the site in force, None where only a store is known.
        daemon: the running daemon; None without one.

    Attributes:
        analyst: computes what needs the estimator.
    """

    def __init__(
        self, url: str, site: Callable[[], Site | None], daemon: Daemon | None = None
    ) -> None:
        self._url = url
        self._find_site = site
        self._daemon = daemon
        self._lock = threading.Lock()
        self._opened: _Opened | None = None
        self.analyst = Analyst()

    @classmethod
    def of_daemon(cls, daemon: Daemon) -> Source:
        """Return what a running daemon knows, beside its store."""
        return cls(daemon.site.historian_url, lambda: daemon.site, daemon)

    @property
    def has_daemon(self) -> bool:
        """Whether a daemon runs behind the pages."""
        return self._daemon is not None

    @property
    def site(self) -> Site | None:
        """The site in force."""
        return self._find_site()

    @property
    def name(self) -> str:
        """Name of the site, shown at the top of every page."""
        site = self.site
        if site is not None:
            return site.name
        file = file_of(self._url)
        return "store" if file is None else file.name

    @property
    def since(self) -> float | None:
        """When the daemon began, seconds since 1970."""
        return None if self._daemon is None else self._daemon.since

    @property
    def is_started(self) -> bool:
        """Whether the daemon polls its devices."""
        return self._daemon is None or self._daemon.started.is_set()

    def status(self) -> DaemonStatus | None:
        """Return the daemon's snapshot; to be called in its event loop."""
        return None if self._daemon is None else self._daemon.status()

    def carry_out(self, order: Order) -> str:
        """Give an order to the daemon; to be called in its event loop.

        Raises:
            OrderError: it cannot be carried out.
        """
        assert self._daemon is not None
        return self._daemon.carry_out(order)

    def queries(self) -> StoreQueries:
        """Return the store's queries; opened again when the file was replaced.

        Raises:
            StoreError: there is no store to read.
        """
        return self._open().queries

    def fleet(self, status: DaemonStatus | None) -> tuple[FleetView, Fleet]:
        """Return the fleet.

        Raises:
            StoreError: the store cannot be read.
        """
        view = self._open().view
        return view, view.look(status)

    def read_ahead(self) -> None:
        """Read the store before anybody asks; a store that is not there yet is read later."""
        load_templates()
        try:
            self._open().view.read_ahead()
        except StoreError as error:
            _log.debug("web.store_later", error=str(error))

    def close(self) -> None:
        """Close the store and end the computations."""
        self.analyst.close()
        with self._lock:
            opened, self._opened = self._opened, None
        if opened is not None:
            opened.view.close()
            opened.queries.close()

    def _open(self) -> _Opened:
        identity = _identity(self._url)
        with self._lock:
            opened = self._opened
            if opened is not None and opened.identity == identity:
                return opened
            if opened is not None:
                opened.view.close()
                opened.queries.close()
                self._opened = None
            queries = StoreQueries(self._url)
            view = FleetView(queries, self._find_site, self.analyst)
            self._opened = _Opened(queries, view, identity)
            return self._opened


def _identity(url: str) -> Any:
    file = file_of(url)
    if file is None:
        return None
    try:
        found = os.stat(file)
    except OSError:
        return None
    return found.st_dev, found.st_ino
