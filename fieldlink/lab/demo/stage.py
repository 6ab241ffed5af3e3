"""Runs a demonstration: the PLC in its process, the daemon here, Modbus TCP between them."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from fieldlink.daemon import Daemon, DaemonStatus, Findings, LoopStatus
from fieldlink.lab.demo.outcome import SETTLE
from fieldlink.lab.demo.plc_process import PlcEnd, PlcProcess
from fieldlink.lab.demo.registers import RegisterRow, read_block
from fieldlink.lab.demo.scene import DEVICE, DemoError, Scene
from fieldlink.registers import Status
from fieldlink.site import Site

__all__ = ["Course", "Performance", "Step", "perform"]

AFTER = 400
"""Cycles that the compensated loop is watched for, after it has settled."""

PATIENCE = 180.0
"""Wall seconds after which a demonstration that does not come to its end is given up: several times
what it needs, because a machine that has other work is slower."""

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
        end: what really happened in the PLC.
        block: the active bank as read over Modbus at the end, register by register.
    """

    site: Site
    findings: Findings
    slots: tuple[int, int]
    status: DaemonStatus
    end: PlcEnd
    block: tuple[RegisterRow, ...]


def perform(
    scene: Scene,
    watch: Callable[[Course], None],
    *,
    hold: float = 0.0,
    holding: Callable[[Site], None] | None = None,
) -> Performance:
    """Run a scene to its end.

    Args:
        scene: what to run.
        watch: called several times a second with the course.
        hold: wall seconds for which the PLC goes on answering afterwards.
        holding: called with the site when that time begins.

    Raises:
        DemoError: the PLC does not start, or no block is accepted in time.
        FieldlinkError: what the daemon or the PLC cannot cure.
    """
    plc = PlcProcess(scene.file, scene.loop)
    try:
        # The first writing is for the PLC, which picks its port; the second names that port.
        scene.write(502)
        site = scene.write(plc.start())
        director = _Director(scene, site, watch)
        status = asyncio.run(director.run())
        block = read_block(site, DEVICE, scene.loop)
        if hold > 0.0 and holding is not None:
            holding(site)
            time.sleep(hold)
        end = plc.stop()
    finally:
        plc.close()
    accepted = director.accepted
    assert accepted is not None
    return Performance(site, accepted.findings, accepted.slots, status, end, block)


@dataclass(frozen=True, slots=True)
class _Accepted:
    """The first block that the PLC took: its findings, their window, the slot of that moment."""

    findings: Findings
    slots: tuple[int, int]
    at: int


class _Director:
    """Watches the daemon and says when the demonstration is over."""

    def __init__(self, scene: Scene, site: Site, watch: Callable[[Course], None]) -> None:
        self._scene = scene
        self._watch = watch
        self._daemon = Daemon(site)
        self.accepted: _Accepted | None = None

    async def run(self) -> DaemonStatus:
        stop = asyncio.Event()
        daemon = asyncio.create_task(self._daemon.run(stop=stop))
        try:
            async with asyncio.timeout(PATIENCE):
                while not daemon.done():
                    course = self._course()
                    self._watch(course)
                    if course.step is Step.DONE:
                        break
                    await asyncio.sleep(BEAT)
        except TimeoutError:
            raise DemoError(self._why_not()) from None
        finally:
            stop.set()
            status = await daemon
        return status

    def _course(self) -> Course:
        status = self._daemon.status()
        loop = status.loops[self._scene.loop]
        if self.accepted is None:
            self.accepted = self._first_accepted(loop)
        step, progress = self._step(loop)
        return Course(step, progress, loop, status.requests, status.late_slots)

    def _first_accepted(self, loop: LoopStatus) -> _Accepted | None:
        """What the PLC took; a simulated loop's compensator waits for a sticky valve's model."""
        attempt, estimate, latest = loop.last_accepted, loop.last_estimate, loop.latest
        if attempt is None or estimate is None or latest is None:
            return None
        if self._scene.recording is None and attempt.candidate.status is not Status.VALID:
            return None
        slots = (estimate.first_slot, estimate.last_slot)
        return _Accepted(attempt.candidate.findings, slots, latest.slot)

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
        said = [f"no parameter block was accepted within {PATIENCE:g} s"]
        if failure := status.devices[DEVICE].last_failure:
            said.append(f"last failure of the device: {failure}")
        if (estimate := loop.last_estimate) is not None:
            reasons = estimate.findings.reasons if estimate.findings is not None else ()
            said.append(" ".join(("last estimate:", estimate.message, *reasons)).strip())
        if (attempt := loop.last_attempt) is not None:
            said.append(f"last write-back: {attempt.outcome.code}, {attempt.outcome.advice}")
        said.append("on a machine with other work, try again when that is done")
        return "; ".join(said)
