"""Withdrawing a block while no daemon runs: the same writer, rules and record, for one loop."""

from __future__ import annotations

import asyncio

from fieldlink.daemon.installation import only_daemon
from fieldlink.daemon.loop import WritebackOffError
from fieldlink.daemon.site_runner import SiteRunner
from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.errors import FieldlinkError
from fieldlink.links import Clock, SystemClock
from fieldlink.registers import HEARTBEAT_EVERY
from fieldlink.site import Site
from fieldlink.store import Historian, last_blocks

__all__ = ["withdraw_without_daemon"]

PATIENCE = 40.0
"""Plant seconds for all of it: a look for another writer, the handover, the acknowledgement."""

_SETTLED = frozenset(
    {
        WritebackOutcome.ACCEPTED,
        WritebackOutcome.REJECTED,
        WritebackOutcome.NOT_ACKNOWLEDGED,
    }
)


async def withdraw_without_daemon(
    site: Site, name: str, reason: str, *, clock: Clock | None = None
) -> str:
    """Withdraw a loop's block; return the outcome in words.

    Raises:
        WritebackOffError: the loop may not be written; no store is made for that.
        FieldlinkError: its block was not withdrawn.
        InUseError: a daemon holds the data directory.
        StoreError: the record cannot be stored.
    """
    if not site.loops[name].writeback.enabled:
        raise WritebackOffError(name)
    clock = clock or SystemClock()
    with only_daemon(site.data_dir) as identity:
        historian = Historian(site.historian_url)
        site_runner = SiteRunner(site, clock, historian.put, keep=historian.keep)
        site_runner.identify(identity)
        loop = site_runner.loop(name)
        runner = site_runner.runner_of(name)
        assert loop is not None
        assert runner is not None
        begun = site_runner.journal.event_record("withdraw.start", name, reason)
        historian.start(begun)
        try:
            site_runner.resume(await asyncio.to_thread(last_blocks, site.historian_url))
            loop.withdraw(reason, clock.utc())
            await runner.link.open()
            now = 0.0
            while now < PATIENCE:
                await loop.service(now)
                last = loop.status(runner.name).last_attempt
                if last is not None and last.candidate.withdrawal and last.outcome in _SETTLED:
                    break
                await asyncio.sleep(HEARTBEAT_EVERY / 4.0 / runner.speed)
                now += HEARTBEAT_EVERY / 4.0
        finally:
            await runner.link.close()
            await asyncio.to_thread(historian.stop)
    last = loop.status(runner.name).last_attempt
    if last is None or last.outcome is not WritebackOutcome.ACCEPTED:
        why = "the PLC did not answer" if last is None else f"{last.reason}; {last.outcome.advice}"
        raise FieldlinkError(
            f"loop {name}: the block is not withdrawn: {why}; clear the PLC's enable bit to end "
            "its use; the daemon tries again when it starts"
        )
    assert last.block is not None
    return f"withdrawn with block {last.block.seq}, acknowledged by the PLC"
