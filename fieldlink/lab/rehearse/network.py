"""The link of a rehearsal: the simulated PLC in lockstep, with a network and power that fail."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldlink.lab.plc import LockstepLink
from fieldlink.lab.rehearse.errors import ScenarioError
from fieldlink.lab.rehearse.happenings import Disable
from fieldlink.lab.rehearse.injected_defects import Defect
from fieldlink.lab.rehearse.models import Scenario
from fieldlink.lab.rehearse.simulated_site import SimulatedSite
from fieldlink.links import (
    Clock,
    LinkState,
    LinkTimeoutError,
    LinkUnreachableError,
    Quality,
    Reading,
    Scan,
)
from fieldlink.registers import ExchangeLayout, Table
from fieldlink.site import Site

__all__ = ["RehearsalLink"]


class RehearsalLink(LockstepLink):
    """A `LockstepLink` through which polls and writes can get lost, and whose PLC can be off.

    Args:
        site, device, clock: as for `LockstepLink`.
        stage: the plant and its program.
        scenario: what fails when.
        defect: what is broken on purpose.
    """

    def __init__(
        self,
        site: Site,
        device: str,
        clock: Clock,
        *,
        stage: SimulatedSite,
        scenario: Scenario,
        defect: Defect | None,
    ) -> None:
        super().__init__(site, device, clock, programs=stage.program)
        self._stage = stage
        self._scenario = scenario
        self._faults = scenario.network
        self._clock = clock
        self._tags = tuple(site.maps[device])
        (self._loop,) = site.loops_of(device)
        loop = site.loops[self._loop]
        self._counter = loop.scan if defect is Defect.CLOSED_GAPS else None
        layout = loop.writeback.exchange
        lost = defect is Defect.LOST_BLOCKS and layout is not None
        self._lost_register = layout.commit if lost and layout is not None else None
        with_polls = defect is Defect.HEARTBEAT_WITH_POLLS and layout is not None
        self._heartbeat = layout.heartbeat if with_polls and layout is not None else None
        self._polled = False
        self._layout: ExchangeLayout | None = layout
        self._random = np.random.default_rng(scenario.scenario.seed)
        self._answered = 0
        self._poll_lost = False
        self._off = False

    @property
    def state(self) -> LinkState:
        """How the device answers."""
        return LinkState.DEMOTED if self._off else super().state

    async def scan(self) -> Scan:
        """Run one control cycle, then read every mapped tag, as far as the faults let it.

        Raises:
            ScenarioError: the plant has failed, which no scenario means to rehearse.
        """
        now = self._stage.time
        self._polled = True
        if self._hit("restart", now):
            if not self._off:
                await self.close()
                self._off = True
            self._stage.coast()
            return self._unanswered()
        if self._off:
            self._off = False
            await self.open()
        self._operate(now)
        self._poll_lost = self._hit("drop", now)
        if self._hit("late", now) and self.plc.scans:
            scan = await self._reader.scan()
            self.plc.scan()
        else:
            scan = await super().scan()
        for failure in self.plc.failures.values():
            raise ScenarioError(f"the rehearsal cannot go on at {now:g} s: {failure}")
        return self._without_gap(scan)

    def go_on(self, seconds: float) -> None:
        """Let the PLC's block readers look ``seconds`` after the last scan."""
        self._polled = False
        super().go_on(seconds)

    async def _read(self, table: Table, address: int, count: int) -> list[int]:
        self._require_power("read")
        if self._poll_lost:
            self.requests += 1
            raise LinkTimeoutError(
                self._device, "no reply to a read (rehearsed)", "see [[network]] of the scenario"
            )
        return await super()._read(table, address, count)

    def _write(self, address: int, words: Sequence[int]) -> None:
        self._require_power("write")
        if address == self._lost_register or (address == self._heartbeat and not self._polled):
            self.requests += 1
            return
        if self._hit("write_lost", self._stage.time):
            self.requests += 1
            raise LinkTimeoutError(
                self._device, "no reply to a write (rehearsed)", "see [[network]] of the scenario"
            )
        super()._write(address, self._damaged(words))

    def _damaged(self, words: Sequence[int]) -> Sequence[int]:
        """Return what arrives of a write of several registers: of a block, as a rule."""
        now = self._stage.time
        if len(words) > 1 and self._hit("write_flipped", now):
            place = int(self._random.integers(len(words)))
            words = [*words[:place], words[place] ^ 0x0100, *words[place + 1 :]]
        if len(words) > 1 and self._hit("write_torn", now):
            words = words[: len(words) // 2]
        return words

    def _require_power(self, what: str) -> None:
        if self._off:
            raise LinkUnreachableError(
                self._device, f"a {what} finds the PLC off (rehearsed)", "wait until it is back"
            )

    def _hit(self, kind: str, now: float) -> bool:
        active = [fault for fault in self._faults if fault.kind == kind and fault.covers(now)]
        return any(self._random.random() < fault.share for fault in active)

    def _operate(self, now: float) -> None:
        """Set the enable register as the operator of the scenario would."""
        switches = [e for e in self._scenario.maintenance if isinstance(e, Disable)]
        if switches and self._layout is not None:
            self.plc.enable(self._loop, not any(e.covers(now) for e in switches))

    def _unanswered(self) -> Scan:
        now, utc = self._clock.monotonic(), self._clock.utc()
        self.requests += 1
        failure = LinkUnreachableError(
            self._device, "the PLC is off (rehearsed)", "wait until it is back"
        )
        silent = Reading(math.nan, Quality.NOT_READ, now, utc)
        return Scan(dict.fromkeys(self._tags, silent), now, utc, 1, (failure,))

    def _without_gap(self, scan: Scan) -> Scan:
        """With the defect: number the answered polls instead of the controller's cycles."""
        if self._counter is None or not scan[self._counter].good:
            return scan
        self._answered += 1
        true = scan[self._counter]
        counted = Reading(float(self._answered), true.quality, true.monotonic, true.utc)
        return replace(scan, readings={**scan.readings, self._counter: counted})
