"""One loop as the simulated PLC hosts it: its program, its tags, its exchange area."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction

from fieldlink.lab.plc.ports import ExchangePort, TagPort
from fieldlink.lab.plc.program import Commands, LoopFailedError, LoopProgram
from fieldlink.lab.plc.setpoint import SetpointProfile
from fieldlink.lab.plc.truth import CycleRecord, TruthLog
from fieldlink.registers import ReaderState
from fieldlink.registers.types import Table
from fieldlink.site import Loop

__all__ = ["HostedLoop", "exact_period", "manual_value"]

SETTLE = 1.0
"""Seconds that a request for the true signals waits for a plant at work."""


def exact_period(loop: Loop) -> Fraction:
    """Return a loop's period in seconds as written, to the microsecond, without rounding."""
    return Fraction(loop.period).limit_denominator(1_000_000)


def manual_value(loop: Loop) -> float:
    """Return what a loop's mode tag shows in manual: the least value that is not automatic."""
    return next(float(v) for v in range(256) if v not in loop.auto_values)


class HostedLoop:
    """Connects one loop's program with the register image.

    The operator's side is where the register map says so: a writable mode tag switches between
    automatic and manual, a writable OP tag sets OP while in manual, a writable SP tag sets the
    set-point until its next step.

    Args:
        name: of the loop.
        loop: its settings; the plant is there.
        program: what runs.
        tags: its tags by role: op and pv, and what the loop has of sp, mode and scan.
        exchange: its exchange area, None without one.
    """

    def __init__(
        self,
        name: str,
        loop: Loop,
        program: LoopProgram,
        tags: Mapping[str, TagPort],
        exchange: ExchangePort | None,
    ) -> None:
        self.name = name
        self.period = exact_period(loop)
        self.exchange = exchange
        self.block: ReaderState | None = None
        self.failure: str | None = None
        self.log = TruthLog()
        self.cycles = 0
        self._stands = False
        self._late_automatic = False
        self.late = 0
        self._stem_comes = False
        self._record: CycleRecord | None = None
        self.program = program
        self._tags = tags
        self._auto_values = loop.auto_values
        self._manual_value = manual_value(loop)
        self._compensate = loop.plant is not None and loop.plant.compensate
        steps = loop.plant.setpoint if loop.plant is not None else ()
        self._profile = SetpointProfile(steps or ((0.0, program.pv),))
        self._profile_sp = self._sp = math.nan
        self._show("mode", self._auto_values[0])
        self._show("op", program.op)

    @property
    def place(self) -> tuple[Table, int]:
        """The register by which a client's read of a cycle is known: cycle counter's or PV's."""
        return self._tags["scan" if "scan" in self._tags else "pv"].place

    def begin(self, now: float) -> None:
        """Begin a control cycle at ``now`` plant seconds: judge a block, decide OP."""
        if self.exchange is not None:
            self.block = self.exchange.scan(now)
        commands = self._commands(now)
        self._amend()
        plant = self.program.plant
        self._stands, self._late_automatic = self.failure is not None, False
        if plant is not None and plant.is_at_work:
            # It has not answered: there is no PV of this cycle to decide on.
            self._stands = True
            self._late_automatic = commands.automatic
            self.late += 1
        elif not self._stands:
            try:
                self.program.begin(commands)
                if self.exchange is not None:
                    self.exchange.tell(self.program.refusal)
            except LoopFailedError as error:
                self.failure, self._stands = str(error), True

    def end(self) -> None:
        """End the cycle, after the plant was stepped; the tags know of it after `show`."""
        record = None
        if not self._stands:
            try:
                record = self.program.end()
            except LoopFailedError as error:
                self.failure = str(error)
        if record is None:
            record = self._standing_still()
        plant = self.program.plant
        self._stem_comes = not self._stands and plant is not None and plant.is_at_work
        self.log.add(record)
        self._record = record
        self.cycles += 1

    def show(self) -> None:
        """Bring the tags up to date with the cycle that ended last."""
        record = self._record
        if record is None:
            return
        self._show("op", record.op)
        self._show("pv", record.pv)
        self._show("sp", record.sp)
        self._show("mode", self._auto_values[0] if record.automatic else self._manual_value)
        if record.status is not None:
            self._show("status", record.status)
        if "scan" in self._tags:
            self._tags["scan"].count(self.cycles)

    def watch(self, now: float) -> None:
        """Look at the exchange area between two cycles, as a PLC's faster task does."""
        if self.exchange is not None:
            self.block = self.exchange.scan(now)

    def settle(self) -> None:
        """Wait for a plant that is at work, so that the record of the last cycle is whole."""
        plant = self.program.plant
        if self._stem_comes and plant is not None:
            plant.finish(SETTLE)
        self._amend()

    def _amend(self) -> None:
        """Put the stem into the last record, when the plant gives it only now."""
        plant = self.program.plant
        if self._stem_comes and plant is not None and not plant.is_at_work:
            self.log.amend_stem(self.program.stem)
            self._stem_comes = False

    def close(self) -> None:
        """End the program."""
        self.program.close()

    def _commands(self, now: float) -> Commands:
        self._sp = self._set_point(now)
        return Commands(
            automatic=self._wants_automatic(),
            op=self._operators("op"),
            sp=self._sp,
            block=self.block if self._compensate else None,
            op_was_written="op" in self._tags and self._tags["op"].take_written(),
        )

    def _set_point(self, now: float) -> float:
        planned = self._profile.at(now)
        if planned != self._profile_sp:
            self._profile_sp = planned
            return planned
        written = self._operators("sp")
        return written if math.isfinite(written) else planned

    def _wants_automatic(self) -> bool:
        written = self._operators("mode")
        return math.isnan(written) or written in self._auto_values

    def _operators(self, role: str) -> float:
        """The value the operator wrote; NaN where the map has no such writable tag."""
        port = self._tags.get(role)
        return port.value() if port is not None and port.writable else math.nan

    def _standing_still(self) -> CycleRecord:
        # A plant that is late has not switched the loop to manual, one that failed has.
        automatic = self._late_automatic
        return CycleRecord(self.program.op, math.nan, self._sp, math.nan, automatic, False)

    def _show(self, role: str, value: float) -> None:
        if role in self._tags:
            self._tags[role].show(value)
