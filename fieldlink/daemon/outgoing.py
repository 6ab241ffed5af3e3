"""Where records go: to the store always, to a broker and to people where the site file says so."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial

from fieldlink.daemon.operators.orders import Action
from fieldlink.daemon.operators.requests import OperatorRequests
from fieldlink.daemon.site_runner import SiteRunner
from fieldlink.links import Clock
from fieldlink.notices import NoticesReport, Notifying
from fieldlink.site import Site
from fieldlink.store import Historian, Record
from fieldlink.upward import Publishing, UpwardReport

__all__ = ["Outgoing"]


class Outgoing:
    """Hands every record to the store and to the receivers that the site file names."""

    def __init__(self, historian: Historian) -> None:
        self._historian = historian
        self._publishing: Publishing | None = None
        self._notifying: Notifying | None = None

    def open(
        self, site: Site, runner: SiteRunner, requests: OperatorRequests, clock: Clock
    ) -> None:
        """Make what the site file names; it works inside `running`."""
        journal = runner.journal
        if site.file.mqtt is not None:
            self._publishing = Publishing(
                site,
                health=lambda: runner.health(store_failing=self._historian.report().failing),
                actions={
                    "withdraw": partial(requests.order_for_broker, Action.WITHDRAW),
                    "estimate_now": partial(requests.order_for_broker, Action.ESTIMATE),
                },
                tell=journal.event,
                defect=journal.defect,
            )
        if site.file.notify is not None:
            self._notifying = Notifying(
                site,
                states=runner.device_states,
                tell=journal.event,
                defect=journal.defect,
                utc_ms=lambda: round(1000.0 * clock.utc()),
            )

    def put(self, record: Record) -> object:
        """Hand a record on; never waits."""
        if self._publishing is not None:
            self._publishing.put(record)
        if self._notifying is not None:
            self._notifying.put(record)
        return self._historian.put(record)

    def follow(self, site: Site) -> None:
        """Publish the loops of another site from now on."""
        if self._publishing is not None:
            self._publishing.follow(site)

    def upward(self) -> UpwardReport | None:
        """Counts of the messages to the broker; None where the site publishes nothing."""
        return None if self._publishing is None else self._publishing.report()

    def notices(self) -> NoticesReport | None:
        """Counts of the notices; None where none are configured."""
        return None if self._notifying is None else self._notifying.report()

    @asynccontextmanager
    async def running(self) -> AsyncIterator[list[asyncio.Task[None]]]:
        """Publish and notify while the block runs; yield what must not end by itself."""
        async with AsyncExitStack() as stack:
            tasks: list[asyncio.Task[None]] = []
            if self._publishing is not None:
                tasks += await stack.enter_async_context(self._publishing.running())
            if self._notifying is not None:
                tasks += await stack.enter_async_context(self._notifying.running())
            yield tasks
