"""Runs a demonstration: the PLC in its process, the daemon here, Modbus TCP between them."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from fieldlink.daemon import Daemon, DaemonStatus, Findings, LoopStatus, stop_on_signals
from fieldlink.lab.demo.judged_windows import JudgedWindows
from fieldlink.lab.demo.outcome import SETTLE
from fieldlink.lab.demo.plc_process import PlcCourse, PlcProcess
from fieldlink.lab.demo.registers import RegisterRow, read_block
from fieldlink.lab.demo.site_files import DEVICE, PORT, DemoError, Scene
from fieldlink.registers import Status
from fieldlink.site import Site
from fieldlink.web import page_address, web_server

__all__ = ["Course", "Performance", "Step", "perform"]

AFTER = 400
"""Cycles that the compensated loop is watched for, after it has settled."""

PATIENCE = 600.0
"""Wall seconds after which a demonstration that does not come to its end is given up: twenty times
what it needs, because the plant is slower on a machine that has other work."""

BEAT = 0.1


class Step(Enum):
    """How far a demonstration has come; the value is what its user reads."""

    CONNECTING = "connecting to the PLC"
    COLLECTING = "collecting a window of OP and PV"
    IDENTIFYING = "identifying valve and process"
    WRITING = "writing the parameter block"
    COMPENSATING = "the compensator has taken over"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Course:
    """A moment of a demonstration, for a live view."""

    step: Step
    progress: float
    status: LoopStatus
    requests: int
    late_slots: int


@dataclass(frozen=True, slots=True)
class Performance:
    """What a demonstration leaves behind.

    Attributes:
        site: the site that it ran.
        findings: what the first accepted block was made of, the one that took over.
        slots: first and last slot of the window behind it.
        status: the daemon's last.
        course: what really happened in the PLC.
        block: the active bank as read over Modbus at the end, register by register.
        page: address of the daemon's pages; None where they have no port.
    """

    site: Site
    findings: Findings
    slots: tuple[int, int]
    status: DaemonStatus
    course: PlcCourse
    block: tuple[RegisterRow, ...]
    page: str | None = None


def perform(
    scene: Scene,
    watch: Callable[[Course], None],
    *,
    hold: float = 0.0,
    opened: Callable[[str | None], None] | None = None,
    finished: Callable[[Performance], None] | None = None,
) -> Performance:
    """Run a scene to its end.

    Args:
        scene: what to run.
        watch: called several times a second with the course.
        hold: wall seconds for which PLC, daemon and page go on afterwards; may be infinite.
        opened: called with the page's address when it answers; None where it has no port.
        finished: called, in a thread, with the performance before that time begins.

    Raises:
        DemoError: the PLC does not start, or no block is accepted in time.
        FieldlinkError: what the daemon or the PLC cannot cure.
    """
    plc = PlcProcess(scene.file, scene.loop)
    try:
        # The first writing is for the PLC, which picks its port; the second names that port.
        scene.write(PORT)
        site = scene.write(plc.start())
        director = _Director(scene, site, watch, plc)
        performance = asyncio.run(director.run(hold, opened, finished))
        plc.stop()
    finally:
        plc.close()
    return performance


@dataclass(frozen=True, slots=True)
class _Accepted:
    """The first block that the PLC took: its findings, their window, the slot of that moment."""

    findings: Findings
    slots: tuple[int, int]
    at: int


class _Director:
    """Watches the daemon and says when the demonstration is over."""

    def __init__(
        self, scene: Scene, site: Site, watch: Callable[[Course], None], plc: PlcProcess
    ) -> None:
        self._scene = scene
        self._site = site
        self._watch = watch
        self._plc = plc
        self._daemon = Daemon(site)
        self._page: str | None = None
        self._windows = JudgedWindows()
        self.accepted: _Accepted | None = None

    async def run(
        self,
        hold: float,
        opened: Callable[[str | None], None] | None,
        finished: Callable[[Performance], None] | None,
    ) -> Performance:
        stop = asyncio.Event()
        async with web_server(self._site, self._daemon) as port:
            self._page = None if port is None else page_address(self._site, port)
            if opened is not None:
                opened(self._page)
            daemon = asyncio.create_task(self._daemon.run(stop=stop))
            try:
                await self._watch_course(daemon)
                performance = await self._performance()
                if finished is not None:
                    await asyncio.to_thread(finished, performance)
                if hold > 0.0:
                    await self._stay(daemon, hold)
            finally:
                stop.set()
                await daemon
        return performance

    async def _stay(self, daemon: asyncio.Task[DaemonStatus], hold: float) -> None:
        """Go on until the time is over, the daemon ends or a signal comes."""
        with stop_on_signals() as stop:
            signalled = asyncio.create_task(stop.wait())
            await asyncio.wait(
                [daemon, signalled],
                timeout=hold if math.isfinite(hold) else None,
                return_when=asyncio.FIRST_COMPLETED,
            )
            signalled.cancel()

    async def _watch_course(self, daemon: asyncio.Task[DaemonStatus]) -> None:
        try:
            async with asyncio.timeout(PATIENCE):
                while not daemon.done():
                    course = self._course()
                    self._watch(course)
                    if course.step is Step.DONE:
                        return
                    await asyncio.sleep(BEAT)
        except TimeoutError:
            raise DemoError(self._why_not()) from None
        # It has ended by itself, which is an error that it raises.
        await daemon

    async def _performance(self) -> Performance:
        accepted = self.accepted
        assert accepted is not None
        block = await read_block(self._site, DEVICE, self._scene.loop)
        return Performance(
            self._site,
            accepted.findings,
            accepted.slots,
            self._daemon.status(),
            await asyncio.to_thread(self._plc.look),
            block,
            self._page,
        )

    def _course(self) -> Course:
        status = self._daemon.status()
        loop = status.loops[self._scene.loop]
        if self.accepted is None:
            self._windows.note(loop.last_estimate)
            self.accepted = self._first_accepted(loop)
        step, progress = self._step(loop)
        return Course(step, progress, loop, status.requests, status.late_slots)

    def _first_accepted(self, loop: LoopStatus) -> _Accepted | None:
        """What the PLC took; a simulated loop's compensator waits for a sticky valve's model."""
        attempt, latest = loop.last_accepted, loop.latest
        if attempt is None or latest is None:
            return None
        if self._scene.recording is None and attempt.candidate.status is not Status.VALID:
            return None
        findings = attempt.candidate.findings
        slots = self._windows.slots_of(findings)
        return None if slots is None else _Accepted(findings, slots, latest.slot)

    def _step(self, loop: LoopStatus) -> tuple[Step, float]:
        if loop.latest is None:
            return Step.CONNECTING, 0.0
        if self.accepted is not None:
            if self._scene.recording is not None:
                return Step.DONE, 1.0
            share = (loop.latest.slot - self.accepted.at) / (SETTLE + AFTER)
            return (Step.DONE if share >= 1.0 else Step.COMPENSATING), min(share, 1.0)
        if loop.filled < 1.0:
            return Step.COLLECTING, loop.filled
        return (Step.WRITING if loop.last_estimate is not None else Step.IDENTIFYING), 1.0

    def _why_not(self) -> str:
        status = self._daemon.status()
        loop = status.loops[self._scene.loop]
        missing = "no parameter block was accepted"
        if self.accepted is not None:
            missing = "the loop under compensation was not watched to the end"
        said = [f"{missing} within {PATIENCE:g} s"]
        if failure := status.devices[DEVICE].last_failure:
            said.append(f"last failure of the device: {failure}")
        if (estimate := loop.last_estimate) is not None:
            reasons = estimate.findings.reasons if estimate.findings is not None else ()
            said.append(" ".join(("last estimate:", estimate.message, *reasons)).strip())
        if (attempt := loop.last_attempt) is not None:
            said.append(f"last write-back: {attempt.outcome.code}, {attempt.outcome.advice}")
        said.append("on a machine with other work, try again when that is done")
        return "; ".join(said)
