"""Taking a changed site file over while the daemon runs, device by device."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from fieldlink.daemon.devices_at_work import DevicesAtWork
from fieldlink.daemon.estimation.judging import WindowJudging
from fieldlink.daemon.reloading.site_change import SiteChange
from fieldlink.daemon.sampling.device import DeviceRunner
from fieldlink.daemon.schedule import Schedule
from fieldlink.daemon.site_runner import SiteRunner
from fieldlink.errors import FieldlinkError
from fieldlink.links import Clock, SteppedLink
from fieldlink.site import Site

__all__ = ["SiteTakeover"]


class SiteTakeover:
    """Reads the site again and takes over what has changed; a site that is wrong is refused.

    Args:
        reread: gives the site again.
        site_runner: the runners that work now.
        devices: their tasks.
        judging: judges the windows of the loops.
        clock: gives the deadlines.

    Attributes:
        accepted, refused: sites taken over, and sites that were wrong.
    """

    def __init__(
        self,
        reread: Callable[[], Site],
        site_runner: SiteRunner,
        devices: DevicesAtWork,
        judging: WindowJudging,
        clock: Clock,
    ) -> None:
        self._reread = reread
        self._site_runner = site_runner
        self._devices = devices
        self._judging = judging
        self._clock = clock
        self.accepted = self.refused = 0

    async def take_over(self, current: Site, schedule: Schedule) -> Site:
        """Return the site that is in force from now on: the new one, or the current one."""
        runners, journal = self._site_runner.runners, self._site_runner.journal
        opened: dict[str, DeviceRunner] = {}
        try:
            site = await asyncio.to_thread(self._reread)
            change = SiteChange.between(current, site)
            for name in (*change.changed, *change.added):
                opened[name] = self._site_runner.runner(site, name)
                if isinstance(opened[name].link, SteppedLink):
                    raise FieldlinkError(
                        f"device {name!r} runs in virtual time and the daemon by the clock; "
                        "give it a site file of its own"
                    )
                await opened[name].link.open()
        except Exception as error:  # noqa: BLE001  (logged, and the site that works stays in force)
            self.refused += 1
            for runner in opened.values():
                await runner.link.close()
            said = str(error) if isinstance(error, FieldlinkError) else repr(error)
            journal.event("site.refused", "daemon", f"the old site stays: {said}", bad=True)
            return current
        tasks = self._devices.tasks
        leaving = {name: tasks.pop(name) for name in (*change.changed, *change.removed)}
        await self._devices.end(leaving.values())
        await asyncio.gather(*(left.runner.link.close() for left in leaving.values()))
        for name, left in leaving.items():
            self._judging.end(left.runner, schedule)
            del runners[name]
        for name, runner in opened.items():
            runners[name] = runner
            begin = self._clock.monotonic()
            if (before := leaving.get(name)) is not None:
                runner.carry_over(before.runner)
                if runner.speed == before.runner.speed:
                    begin = before.begin
            self._devices.begin(runner, begin)
            self._judging.begin(runner, schedule)
        self.accepted += 1
        journal.event("site.reloaded", "daemon", str(change))
        return site
