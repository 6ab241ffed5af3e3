"""A PLC without a network and without a clock: registers, and a scan that moves them.

    with VirtualPlc(site, "plc") as plc:
        plc.scan()                                   # one control cycle of every loop that is due
        plc.image.read(Table.HOLDING, 0, 8)          # what a client would get
        plc.truth("FC101").stem                      # what no client gets

Everything of a scan appears in the registers before `scan` returns, so a client that reads between
two scans reads one of them. A run is the same for the same site and seeds. The Modbus server
(`fieldlink.lab.plc.server`) and the lockstep link (`fieldlink.lab.plc.lockstep`) are two ways to
move it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from types import TracebackType
from typing import Literal, Self

from compensator import LoopMemory, Supervisor
from fieldlink.lab.plc.build import PlcError, Programs
from fieldlink.lab.plc.hosted import HostedLoop, exact_period
from fieldlink.lab.plc.image import RegisterImage
from fieldlink.lab.plc.plants import step_all
from fieldlink.lab.plc.ports import ExchangePort, TagPort
from fieldlink.lab.plc.program import LoopProgram
from fieldlink.lab.plc.truth import Truth
from fieldlink.registers import BlockLimits, BlockReader, ReaderState
from fieldlink.site import Device, Loop, Site

__all__ = ["BuildProgram", "VirtualPlc", "scan_period"]

BuildProgram = Callable[[str], LoopProgram]
"""From the name of a loop to its program."""

HEARTBEAT_TIMEOUT = 10.0


class VirtualPlc:
    """One device of a site, with every loop on it that has a plant.

    Args:
        site: the site.
        device: the device's name.
        speed: plant seconds per second of the wall clock, for who paces the scans. Fieldlink's
            heartbeat is dead after 10 seconds of the wall clock.
        pace: who paces the scans: the clock; the clock, but each scan waits for a client that reads
            (`is_read`); or the plants, scan after scan as fast as they can. Without a clock no
            heartbeat is ever dead.
        isolated: run each FMU in a process of its own; a crash then ends one loop alone.
        patience: seconds of the wall clock that a scan waits for its plants together. A plant that
            takes longer goes on by itself and its loops stand still meanwhile; after 60 seconds it
            is given up. Without a limit a run is the same on every machine.
        programs: builds the program of a loop of the site; by default what the site file says.
        operator_switch: whether clients may write ``enable``, as an operator's panel does.
        retained: what an earlier life of this PLC kept (RETAIN), see `retained`.

    Raises:
        PlcError: no loop of the device has a plant, or a plant and its loop do not fit.
        RecordingError: a recording cannot be read.
    """

    def __init__(
        self,
        site: Site,
        device: str,
        *,
        speed: float = 1.0,
        pace: Literal["clock", "reader", "plant"] = "clock",
        isolated: bool = True,
        patience: float = math.inf,
        programs: BuildProgram | None = None,
        operator_switch: bool = False,
        retained: Mapping[str, LoopMemory] | None = None,
    ) -> None:
        self.device = device
        self.speed = speed
        self.pace = pace
        self.image = RegisterImage()
        self.scans = 0
        self._ports = {name: TagPort(self.image, tag) for name, tag in site.maps[device].items()}
        self._loops: dict[str, HostedLoop] = {}
        settings = site.devices[device]
        self._patience = patience
        self._operator_switch = operator_switch
        own = Programs(site, isolated=isolated)
        build = programs or own.build
        dead_after = HEARTBEAT_TIMEOUT * speed if pace != "plant" else math.inf
        try:
            for name, loop in site.loops_of(device).items():
                if loop.plant is not None:
                    exchange = self._exchange(loop, settings, dead_after)
                    program = build(name)
                    self._loops[name] = HostedLoop(name, loop, program, self._roles(loop), exchange)
        except BaseException:
            own.close()
            self.close()
            raise
        if not self._loops:
            raise PlcError(
                f"device {device}: none of its loops has a plant; add a table [loops.NAME.plant] "
                "with an fmu or a recording"
            )
        for name, memory in (retained or {}).items():
            supervisor = self.supervisor(name)
            if supervisor is not None:
                supervisor.restore(memory)
        self._period = scan_period(site, device)
        self._numerator, self._denominator = self._period.as_integer_ratio()
        self._due = [(loop, int(loop.period / self._period)) for loop in self._loops.values()]

    @property
    def loops(self) -> tuple[str, ...]:
        """The loops that it runs."""
        return tuple(self._loops)

    @property
    def scan_period(self) -> float:
        """Plant seconds from one scan to the next: the longest that fits every loop's period."""
        return float(self._period)

    @property
    def time(self) -> float:
        """Plant seconds since the start."""
        return float(self.scans * self._period)

    @property
    def failures(self) -> Mapping[str, str]:
        """Loops that stand still, and why."""
        return {name: loop.failure for name, loop in self._loops.items() if loop.failure}

    @property
    def late_cycles(self) -> Mapping[str, int]:
        """Cycles in which a loop stood still because its plant had not answered, by loop."""
        return {name: loop.late for name, loop in self._loops.items()}

    @property
    def is_read(self) -> bool:
        """Whether a client has read every loop of the last scan; true unless readers pace it."""
        return self.image.is_read

    def scan(self, *, show: bool = True) -> None:
        """Run one control cycle of every loop whose period has passed.

        Args:
            show: whether the tags show it at once; otherwise they wait for `show`.
        """
        scans = self.scans
        due = [loop for loop, every in self._due if scans % every == 0]
        moment = scans * self._numerator / self._denominator
        plants = [loop.program.plant for loop in due if loop.program.plant is not None]
        for plant in plants:
            plant.finish(0.0)  # what came late since the scan before
        for loop in due:
            loop.begin(moment)
        step_all(plants, self._patience)
        for loop in due:
            loop.end()
            if show:
                loop.show()
        self.scans += 1
        if self.pace == "reader":
            self.image.await_read(loop.place for loop in due)

    def show(self) -> None:
        """Bring the tags up to date, where scans did not show theirs."""
        for loop in self._loops.values():
            loop.show()

    def truth(self, loop: str, *, last: int | None = None) -> Truth:
        """Return what really happened in a loop, for judging; ``last`` is the number of cycles."""
        hosted = self._loops[loop]
        hosted.settle()
        return hosted.log.arrays(last)

    def block(self, loop: str) -> ReaderState | None:
        """Return the outcome of the parameter block in the last cycle; None without an area."""
        return self._loops[loop].block

    def supervisor(self, loop: str) -> Supervisor | None:
        """Return who decides which controller has the loop, for its state; None without one."""
        return self._loops[loop].program.supervisor

    @property
    def retained(self) -> dict[str, LoopMemory]:
        """What a compensator of this PLC has to know after a restart, by loop."""
        known = {name: self.supervisor(name) for name in self._loops}
        return {name: found.memory for name, found in known.items() if found is not None}

    def enable(self, loop: str, allowed: bool) -> None:
        """Set or clear a loop's enable register, as its operator would.

        Raises:
            PlcError: the loop has no exchange area.
        """
        exchange = self._loops[loop].exchange
        if exchange is None:
            raise PlcError(f"loop {loop} has no exchange area; give its writeback a base")
        exchange.enable(allowed)

    def watch(self, seconds: float) -> None:
        """Let the block readers look ``seconds`` after the last scan, before the next one."""
        if not self.scans:
            return
        moment = (self.scans - 1) * self._period.numerator / self._period.denominator + seconds
        for loop in self._loops.values():
            loop.watch(moment)

    def close(self) -> None:
        """End the plants; may be called twice."""
        for loop in self._loops.values():
            loop.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _roles(self, loop: Loop) -> dict[str, TagPort]:
        roles = {role: getattr(loop, role) for role in ("op", "pv", "sp", "mode", "scan")}
        if loop.plant is not None and loop.plant.external is not None:
            roles["status"] = loop.plant.external.status
        return {role: self._ports[tag] for role, tag in roles.items() if tag is not None}

    def _exchange(self, loop: Loop, device: Device, heartbeat: float) -> ExchangePort | None:
        writeback = loop.writeback
        if writeback.exchange is None or writeback.loop_id is None:
            return None
        reader = BlockReader(
            writeback.loop_id,
            word_order=device.word_order,
            heartbeat_timeout=heartbeat,
            limits=BlockLimits(writeback.limits.stick_band, writeback.limits.slip_jump),
        )
        return ExchangePort(
            self.image, writeback.exchange, reader, operator_switch=self._operator_switch
        )


def scan_period(site: Site, device: str) -> Fraction:
    """Return the plant seconds of a scan: the longest that every simulated loop's period is a
    multiple of."""
    loops = site.loops_of(device).values()
    periods = [exact_period(loop) for loop in loops if loop.plant is not None]
    denominator = math.lcm(*(period.denominator for period in periods))
    return Fraction(math.gcd(*(int(period * denominator) for period in periods)), denominator)
