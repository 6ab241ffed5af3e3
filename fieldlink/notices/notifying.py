"""Sends notices: takes findings and device states, keeps notices on disk, delivers each once.

notifying = Notifying(site, states=..., tell=..., defect=..., utc_ms=...)
notifying.put(record)                  # at once, from the event loop; never waits
async with notifying.running():        # outbox and receivers
    ...
"""

from __future__ import annotations

import asyncio
import sqlite3
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import replace

from fieldlink.errors import FieldlinkError
from fieldlink.links import LinkState
from fieldlink.notices.counts import NoticesReport, ReceiverReport
from fieldlink.notices.device_watch import DeviceWatch
from fieldlink.notices.errors import NoticeError
from fieldlink.notices.notice import Notice, device_notice, finding_notice
from fieldlink.notices.outbox import Outbox, Retrying
from fieldlink.notices.receivers import Receiver, receivers_of
from fieldlink.site import Site
from fieldlink.store import FindingRecord, Record
from fieldlink.store.damage import is_corruption

__all__ = ["Notifying"]

OUTBOX = "notices.sqlite"

LOOK_EVERY = 1.0
"""Seconds between two looks at devices and outbox."""

MEMORY = 1000
"""Notices held while the disk cannot be written; then the oldest go."""

DeviceState = tuple[LinkState, str]
"""A device's state, and why it is not good."""


class Notifying:
    """The notices of a site.

    Args:
        site: the site; must have a table ``[notify]``. A change of the table takes effect at the
            next start.
        states: gives the state of each device.
        tell: records events: kind, source, message, ``bad``.
        defect: records an unforeseen error: source, error, consequence.
        utc_ms: gives the time of day.
        retrying: how often a notice is tried.
        look_every: seconds between two looks at devices and outbox.

    Raises:
        MissingExtraError: a package is not installed.
        NoticeError: a file of the table cannot be read.
    """

    def __init__(
        self,
        site: Site,
        *,
        states: Callable[[], Mapping[str, DeviceState]],
        tell: Callable[..., None],
        defect: Callable[[str, Exception, str], object],
        utc_ms: Callable[[], int],
        retrying: Retrying | None = None,
        look_every: float = LOOK_EVERY,
    ) -> None:
        notify = site.file.notify
        assert notify is not None
        self._site = site
        self._name, self._page, self._about = site.name, notify.page, notify.about
        self._receivers = receivers_of(site)
        self._reports = dict.fromkeys(self._receivers, ReceiverReport())
        self._outbox = Outbox(
            site.data_dir / OUTBOX,
            list(self._receivers),
            per_hour=notify.per_hour,
            retrying=retrying,
        )
        self._devices = DeviceWatch(notify.lost_after)
        self._states, self._tell, self._defect, self._utc_ms = states, tell, defect, utc_ms
        self._waiting: deque[tuple[Notice, str]] = deque(maxlen=MEMORY)
        self._look_every = look_every
        self._failing = self._is_open = False
        self._held = 0

    def put(self, record: Record) -> None:
        """Take a record of the daemon; what is not a confirmed finding is passed over."""
        is_finding = isinstance(record, FindingRecord) and record.state == "confirmed"
        if is_finding and "findings" in self._about:
            assert isinstance(record, FindingRecord)
            self._waiting.append((finding_notice(record, self._name, self._page), ""))

    def report(self) -> NoticesReport:
        """Return the counts."""
        return NoticesReport(dict(self._reports), self._held)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[list[asyncio.Task[None]]]:
        """Watch and deliver while the block runs; yields tasks that must not end by themselves."""
        tasks = [asyncio.create_task(self._keep(), name="notices")]
        tasks += [
            asyncio.create_task(self._serve(name, receiver), name=f"notices {name}")
            for name, receiver in self._receivers.items()
        ]
        try:
            yield tasks
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            # what the last second brought is delivered at the next start
            try:
                await asyncio.to_thread(self._store_waiting)
            except sqlite3.Error as error:
                self._note_disk(error)

    async def _keep(self) -> None:
        """Bring what is new to disk, once a second."""
        while True:
            try:
                if "devices" in self._about:
                    self._watch_devices()
                if not self._is_open:
                    aside = await asyncio.to_thread(self._outbox.open)
                    self._is_open = True
                    if aside is not None:
                        self._tell(
                            "notice.outbox_replaced",
                            "notify",
                            f"the outbox was damaged and is set aside as {aside.name}; a notice "
                            "may come twice",
                            bad=True,
                        )
                await asyncio.to_thread(self._store_waiting)
                self._note_disk(None)
            except (sqlite3.Error, OSError, FieldlinkError) as error:
                self._doubt_outbox(error)
                self._note_disk(error)
            except Exception as error:  # noqa: BLE001  (told; the rest of the daemon goes on)
                self._defect("notify", error, "it is tried again in a second")
            await asyncio.sleep(self._look_every)

    def _watch_devices(self) -> None:
        states = self._states()
        now = time.monotonic()
        for device, state in self._devices.look({n: s for n, (s, _) in states.items()}, now):
            reason = states[device][1] if state == "lost" else ""
            notice = device_notice(device, state, reason, self._name, self._page, self._utc_ms())
            # a device that was not reported lost is not reported back
            self._waiting.append((notice, "lost" if state == "back" else ""))

    def _store_waiting(self) -> None:
        while self._waiting:
            notice, only_after = self._waiting[0]
            self._outbox.offer(notice, only_after=only_after)
            self._waiting.popleft()
        self._outbox.release(self._name, self._page, self._utc_ms())
        self._held = self._outbox.held()

    def _doubt_outbox(self, error: Exception) -> None:
        """Have the outbox opened again, which replaces it, where SQLite says that it is damaged."""
        if isinstance(error, sqlite3.Error) and is_corruption(error):
            self._is_open = False

    def _note_disk(self, error: Exception | None) -> None:
        if (error is not None) == self._failing:
            return
        self._failing = error is not None
        if error is not None:
            self._tell(
                "notice.outbox_failing", "notify", f"{error}; check the disk and its space",
                bad=True,
            )  # fmt: skip
        else:
            self._tell("notice.outbox_written", "notify", "the outbox is written again")

    async def _serve(self, name: str, receiver: Receiver) -> None:
        """Deliver to one receiver, a notice at a time; a failure holds up no other receiver."""
        failing = False
        while True:
            await asyncio.sleep(self._look_every)
            try:
                failing = await self._deliver_due(name, receiver, failing=failing)
            except sqlite3.Error as error:
                # the task that writes the outbox tells of it
                self._doubt_outbox(error)
            except Exception as error:  # noqa: BLE001  (told; the others go on)
                self._defect(f"notify {name}", error, "it is tried again in a second")

    async def _deliver_due(self, name: str, receiver: Receiver, *, failing: bool) -> bool:
        """Deliver what is due; return whether the newest attempt failed."""
        while True:
            delivery = await asyncio.to_thread(self._outbox.next_due, name, self._utc_ms())
            if delivery is None:
                return failing
            report = self._reports[name]
            if failing:
                receiver = await self._read_again(name, receiver)
            try:
                flaw = await receiver.send(delivery.notice)
            except NoticeError as error:
                is_last = await asyncio.to_thread(
                    self._outbox.failed, name, delivery, self._utc_ms()
                )
                self._reports[name] = replace(
                    report,
                    failed=report.failed + 1,
                    given_up=report.given_up + is_last,
                    last_error=str(error),
                )
                if not failing:
                    self._tell("notice.failed", name, f"{error}; it is tried again", bad=True)
                if is_last:
                    title = delivery.notice.title
                    self._tell("notice.given_up", name, f"{error}; given up: {title}", bad=True)
                failing = True
            except Exception:
                # counted too: a notice that cannot be sent at all must not hold up the next ones
                await asyncio.to_thread(self._outbox.failed, name, delivery, self._utc_ms())
                raise
            else:
                await asyncio.to_thread(self._outbox.delivered, name, delivery.number)
                self._reports[name] = replace(report, delivered=report.delivered + 1)
                self._tell("notice.delivered", name, delivery.notice.title)
                if flaw:
                    self._tell("notice.refused", name, flaw, bad=True)
                failing = False

    async def _read_again(self, name: str, receiver: Receiver) -> Receiver:
        """Return a receiver with what its files hold now: a password may have been put right."""
        try:
            found = await asyncio.to_thread(receivers_of, self._site)
        except NoticeError:
            # what is wrong with the one in use is told already
            return receiver
        return found[name]
