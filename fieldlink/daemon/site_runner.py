"""The parts of a running site, put together the same way for live and lockstep runs."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from concurrent.futures import Future

from fieldlink.daemon.diagnosis.counts import FindingsReport
from fieldlink.daemon.estimation.pool import PoolReport
from fieldlink.daemon.loop import LoopRunner
from fieldlink.daemon.operators.orders import ORDER_EVENTS, recall_orders
from fieldlink.daemon.reporting.journal import Journal
from fieldlink.daemon.reporting.status import DaemonStatus
from fieldlink.daemon.sampling.clock_watch import ClockWatch
from fieldlink.daemon.sampling.device import DeviceRunner
from fieldlink.daemon.windows.loop_counts import LoopCounts
from fieldlink.daemon.writeback.asked_withdrawal import find_open_withdrawals
from fieldlink.daemon.writeback.sequence import SequenceNumbers
from fieldlink.daemon.writeback.standing_orders import StandingOrders
from fieldlink.links import Clock, Link, LinkState, open_link
from fieldlink.notices import NoticesReport
from fieldlink.site import Site
from fieldlink.store import (
    Record,
    StoreError,
    StoreReport,
    WritebackRecord,
    last_blocks,
    last_events,
)
from fieldlink.upward import UpwardReport

__all__ = ["OpenLink", "SiteRunner"]

OpenLink = Callable[[Site, str, Clock], Link]
"""Makes the link of a device: `open_link`, or something that stands before it."""


class SiteRunner:
    """One runner for every device that has a loop.

    Args:
        site: the site.
        clock: stamps readings and records.
        put: takes records for the store.
        read_only: never write to any device.
        live: whether the clock goes by itself.
        links: makes the link of each device.
        watch: knows how the wall clock has stepped; None where none does.
        keep: see `Journal`.

    Attributes:
        orders: what operators have ordered, by the loop's name.
    """

    def __init__(
        self,
        site: Site,
        clock: Clock,
        put: Callable[[Record], object],
        *,
        read_only: bool = False,
        live: bool = True,
        links: OpenLink = open_link,
        watch: ClockWatch | None = None,
        keep: Callable[[Record], Future[bool]] | None = None,
    ) -> None:
        self.journal = Journal(put, clock, keep)
        self._clock = clock
        self._read_only = read_only
        self._live = live
        self._links = links
        self._watch = watch
        self._identity: int | None = None
        # By the loop's name: a loop that comes back after a change of the site goes on counting.
        self._numbers: dict[str, SequenceNumbers] = {}
        self.orders: dict[str, StandingOrders] = {}
        used = dict.fromkeys(loop.device for loop in site.loops.values())
        self.runners = {name: self.runner(site, name) for name in used}

    def runner(self, site: Site, name: str) -> DeviceRunner:
        """Build the runner of a device; its link is not open yet."""
        return DeviceRunner(
            site,
            name,
            self._links(site, name, self._clock),
            self.journal,
            numbers=self._numbers,
            orders=self.orders,
            identity=self._identity,
            read_only=self._read_only,
            live=self._live,
            watch=self._watch,
        )

    def identify(self, identity: int) -> None:
        """Give every writer the identity of this installation, those to come included."""
        self._identity = identity
        for runner in self.runners.values():
            for loop in runner.loops.values():
                if loop.writer is not None:
                    loop.writer.identify(identity)

    def resume(self, unfinished: Mapping[str, WritebackRecord]) -> None:
        """Let the write-backs go on after the last blocks that a process before has recorded."""
        for loop, record in unfinished.items():
            if (found := self.loop(loop)) is not None:
                found.resume(record)

    async def resume_from(self, url: str) -> None:
        """Go on after the last block and the last order of every loop in the historian at ``url``.

        A historian that cannot be read now is an event: what waits is then judged again.
        """
        try:
            last = await asyncio.to_thread(last_blocks, url)
            withdrawals = await asyncio.to_thread(find_open_withdrawals, url)
            orders = await asyncio.to_thread(last_events, url, ORDER_EVENTS)
        except StoreError as error:
            self.journal.event("writeback.past_unknown", "daemon", str(error), bad=True)
        else:
            self.resume(last)
            loops = {
                name: loop
                for runner in self.runners.values()
                for name, loop in runner.loops.items()
            }
            for event in withdrawals:
                if event.source in loops:
                    loops[event.source].withdraw_again(event.message, event.utc_ms / 1000.0)
            recall_orders(orders, loops, self.journal)

    async def open(self) -> None:
        """Open every link.

        Raises:
            FieldlinkError: a link cannot ever work; a device that is only absent is not an error.
        """
        for runner in self.runners.values():
            await runner.link.open()

    async def close(self) -> None:
        """Close every link, all at once: a silent device is given some time for it."""
        await asyncio.gather(*(runner.link.close() for runner in self.runners.values()))
        self.journal.summarize(at_the_end=True)

    def loop(self, name: str) -> LoopRunner | None:
        """Return the runner of a loop; None when the site has no such loop any more."""
        runner = self.runner_of(name)
        return None if runner is None else runner.loops[name]

    def runner_of(self, loop: str) -> DeviceRunner | None:
        """Return the runner of a loop's device; None when the site has no such loop any more."""
        for runner in self.runners.values():
            if loop in runner.loops:
                return runner
        return None

    def counts(self) -> dict[str, LoopCounts]:
        """Return the counts of every loop's samples."""
        return {
            name: loop.pipeline.counts
            for runner in self.runners.values()
            for name, loop in runner.loops.items()
        }

    def status(
        self,
        store: StoreReport,
        pool: PoolReport | None = None,
        *,
        reloads: int = 0,
        refused: int = 0,
        upward: UpwardReport | None = None,
        findings: FindingsReport | None = None,
        notices: NoticesReport | None = None,
    ) -> DaemonStatus:
        """Return a snapshot."""
        return DaemonStatus(
            devices={name: runner.status() for name, runner in self.runners.items()},
            loops={
                name: loop.status(runner.name)
                for runner in self.runners.values()
                for name, loop in runner.loops.items()
            },
            store=store,
            pool=pool or PoolReport(),
            clock_steps=0 if self._watch is None else self._watch.steps,
            reloads=reloads,
            refused=refused,
            defects=self.journal.defects,
            upward=upward,
            findings=findings,
            notices=notices,
        )

    def device_states(self) -> dict[str, tuple[LinkState, str]]:
        """Return the state of each device, and its newest failure."""
        return {
            name: (state.state, state.last_failure)
            for name, runner in self.runners.items()
            for state in (runner.status(),)
        }

    def health(self, *, store_failing: bool) -> dict[str, object]:
        """Return the states of devices and loops, for consumers above; cheap enough to poll."""
        states = {name: runner.status() for name, runner in self.runners.items()}
        return {
            "devices": [
                {
                    "name": name,
                    "state": state.state.name.lower(),
                    "reason": state.last_failure if state.state is not LinkState.GOOD else "",
                    "missed": sum(
                        loop.pipeline.counts.missed for loop in self.runners[name].loops.values()
                    ),
                }
                for name, state in states.items()
            ],
            "loops": {
                loop: states[name].state.name.lower()
                for name, runner in self.runners.items()
                for loop in runner.loops
            },
            "store_failing": store_failing,
        }
