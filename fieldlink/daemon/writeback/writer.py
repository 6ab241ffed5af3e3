"""The write-back of one loop: findings into the PLC's parameter block, by rules without exception.

A candidate is judged when it comes (agreement of windows, limits) and then waits for its turn.
Every two plant seconds `WriteBack.service` reads the exchange area, beats the heartbeat, looks for
the PLC's acknowledgement, and makes at most one attempt:

    enable bit set? - minimum interval over? - more than the deadband away from the active block?
    nothing but another valve model while a sticky valve's model is in force?
    store what is about to be written - once that is stored: write, read back, commit (`handover`)

Only the newest candidate waits. The sequence number goes on from the newest that PLC, banks, store
or this process know. Times are plant seconds that the caller passes in; there is no clock here.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Protocol

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.candidate import Agreement, Candidate
from fieldlink.daemon.writeback.exchange_io import ControlWords, Exchange
from fieldlink.daemon.writeback.handover import Handover
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.links import LinkError
from fieldlink.registers import (
    ACCEPTED,
    BlockError,
    ParameterBlock,
    Status,
    commit_word,
    describe_ack,
)
from fieldlink.site import WriteBack as WriteBackSettings
from fieldlink.store import WritebackRecord

__all__ = ["BEAT", "Receipt", "WriteBack"]

BEAT = 2.0
"""Plant seconds between two looks at the exchange area; PLCs count a heartbeat dead after ten."""

ACK_WAIT = 10.0
"""Plant seconds that a PLC may take to acknowledge, or four periods of the loop if that is more."""

RETRY = 30.0
"""Plant seconds after an attempt that failed before its commit, or the interval if that is less."""


RECORD_WAIT = 60.0
"""Plant seconds after which it is said that a block waits for the store."""


class Receipt(Protocol):
    """The promise that a row will be in the store."""

    def done(self) -> bool:
        """Whether that has been settled."""
        ...

    def result(self) -> bool:
        """Whether the row is there."""
        ...


@dataclass(frozen=True, slots=True)
class _Begun:
    """An attempt whose row is on its way into the store, since a plant second."""

    attempt: Attempt
    receipt: Receipt
    since: float


@dataclass(slots=True)
class _Awaited:
    """An attempt that the PLC has to acknowledge, from its first look on until a plant second."""

    attempt: Attempt
    until: float | None = None


class WriteBack:
    """Writes the blocks of one loop.

    Args:
        settings: the loop's write-back settings, with an exchange area and a loop id.
        exchange: the exchange area.
        period: plant seconds of the loop's period.
        read_only: never write, whatever the settings say.
        pause: waits one scan of the PLC before a second read-back.
        report: called with every attempt and every decision.
        keep: called with an attempt before anything of it is written; promises its row.
    """

    def __init__(
        self,
        settings: WriteBackSettings,
        exchange: Exchange,
        *,
        period: float,
        read_only: bool,
        pause: Callable[[], Awaitable[None]],
        report: Callable[[Attempt], None],
        keep: Callable[[Attempt], Receipt],
    ) -> None:
        if settings.loop_id is None:
            raise ValueError("write-back needs a loop_id; the site file's check asks for it")
        self._settings = settings
        self._loop_id = settings.loop_id
        self._exchange = exchange
        self._read_only = read_only
        self._handover = Handover(
            exchange, loop_id=self._loop_id, valid_for=settings.valid_for, pause=pause
        )
        self._report = report
        self._keep = keep
        self._ack_wait = max(ACK_WAIT, 4.0 * period)
        self._agreement = Agreement()
        self._pending: Candidate | None = None
        self._said: WritebackOutcome | None = None
        self._begun: _Begun | None = None
        self._awaited: _Awaited | None = None
        self._left: Attempt | None = None
        self._written_at: float | None = None
        self._not_before = -math.inf
        self._next_beat: float | None = None

    @property
    def requests(self) -> int:
        """Requests made so far."""
        return self._exchange.requests

    def inherit(self, other: WriteBack) -> None:
        """Go on where another write-back of the same loop was: its settings may have differed."""
        self._agreement = other._agreement
        self._pending, self._said = other._pending, other._said
        self._begun, self._awaited, self._left = other._begun, other._awaited, other._left
        self._handover.last_seq = other._handover.last_seq
        self._written_at = other._written_at
        self._not_before = other._not_before
        self._next_beat = other._next_beat

    def resume(self, record: WritebackRecord) -> None:
        """Find out at the next look what became of a block that a process before this had begun."""
        self._left = self._handover.recall(record)

    def submit(self, findings: Findings, end_utc: float) -> None:
        """Judge new findings; what passes waits for its turn and takes the place of what waited."""
        candidate = Candidate(findings, end_utc, self._agreement.count(findings))
        refusal = self._judge(candidate)
        if refusal is not None:
            self._report(refusal)
            return
        if self._pending is not None:
            self._report(Attempt(WritebackOutcome.SUPERSEDED, "", self._pending))
        self._pending, self._said = candidate, None

    async def service(self, now: float) -> bool:
        """Do what is due at ``now`` plant seconds; return whether that was anything.

        Raises:
            LinkError: the exchange area could not be read, or the heartbeat not written.
        """
        if self._read_only or (self._next_beat is not None and now < self._next_beat):
            return False
        self._next_beat = now + BEAT
        try:
            control = await self._exchange.control()
            if control.enabled:
                await self._exchange.beat((control.heartbeat + 1) & 0xFFFF)
        except LinkError as error:
            self._wait(WritebackOutcome.UNREACHABLE, str(error))
            raise
        if self._left is not None:
            await self._look_back(self._left, control, now)
        self._look_for_ack(control, now)
        if self._begun is None and self._awaited is None and self._pending is not None:
            await self._try(self._pending, control, now)
        if self._begun is not None:
            await self._go_on(self._begun, control, now)
        return True

    def _judge(self, candidate: Candidate) -> Attempt | None:
        """Return why a candidate must not even wait; None when it may."""
        settings, found = self._settings, candidate.findings
        if self._read_only:
            return Attempt(WritebackOutcome.READ_ONLY, "", candidate)
        if candidate.windows < settings.min_windows:
            counted = f"{candidate.windows} of {settings.min_windows} windows agree"
            return Attempt(WritebackOutcome.TOO_FEW_WINDOWS, counted, candidate)
        if candidate.status is Status.VALID:
            for name, value, (low, high) in (
                ("stick_band", found.stick_band.value, settings.limits.stick_band),
                ("slip_jump", found.slip_jump.value, settings.limits.slip_jump),
            ):
                if not low <= value <= high:
                    what = f"{name} = {value:g}, limits {low:g} to {high:g}"
                    return Attempt(WritebackOutcome.OUT_OF_LIMITS, what, candidate)
        try:
            candidate.block(self._loop_id, 1, settings.valid_for)
        except BlockError as error:
            return Attempt(WritebackOutcome.NOT_EXPRESSIBLE, str(error), candidate)
        return None

    async def _try(self, candidate: Candidate, control: ControlWords, now: float) -> None:
        if not control.enabled:
            self._wait(WritebackOutcome.NOT_ENABLED, f"enable register is {control.enable}")
            return
        if now < self._not_before:
            self._wait(WritebackOutcome.TOO_SOON, f"{self._not_before - now:.0f} s left")
            return
        try:
            banks = await self._handover.banks(control)
        except LinkError as error:
            self._wait(WritebackOutcome.UNREACHABLE, str(error))
            return
        if self._is_unchanged(candidate, banks.active, now):
            self._settle(
                Attempt(
                    WritebackOutcome.UNCHANGED,
                    f"deadband {self._settings.deadband:g}",
                    candidate,
                    active_before=banks.active_words,
                )
            )
            return
        if candidate.status is not Status.VALID and self._in_force(banks.active, now):
            self._settle(
                Attempt(
                    WritebackOutcome.KEPT_VALID,
                    "the active block names a sticky valve",
                    candidate,
                    active_before=banks.active_words,
                )
            )
            return
        attempt = self._handover.plan(candidate, control, banks)
        self._begun = _Begun(attempt, self._keep(attempt), now)
        self._pending = None

    async def _go_on(self, begun: _Begun, control: ControlWords, now: float) -> None:
        """Write what was begun once its row is in the store."""
        attempt = begun.attempt
        if not begun.receipt.done():
            if now - begun.since > RECORD_WAIT:
                self._say(WritebackOutcome.NOT_RECORDED, "its row is not stored yet", attempt)
            return
        self._begun = None
        if not begun.receipt.result():
            done = attempt.became(WritebackOutcome.NOT_RECORDED, "the store did not take its row")
        elif not control.enabled:
            done = attempt.became(
                WritebackOutcome.NOT_ENABLED, f"enable register is {control.enable}"
            )
        elif control.inactive_bank is not attempt.bank:
            done = attempt.became(
                WritebackOutcome.READBACK_DIFFERS, "the PLC has changed its bank meanwhile"
            )
        else:
            done = await self._handover.carry_out(attempt)
        interval = self._settings.min_interval
        if done.outcome in (WritebackOutcome.COMMITTED, WritebackOutcome.COMMIT_FAILED):
            self._awaited = _Awaited(done)
            self._not_before = now + interval
        else:
            self._not_before = now + min(interval, RETRY)
        if done.outcome.leaves_pending and self._pending is None:
            self._pending, self._said = attempt.candidate, done.outcome
        self._report(done)

    async def _look_back(self, left: Attempt, control: ControlWords, now: float) -> None:
        """Complete the record of what a process before this one had begun."""
        found = await self._handover.look_back(left, control)
        self._left = None
        if found.outcome is WritebackOutcome.COMMITTED:
            self._awaited = _Awaited(found)
            self._not_before = now + self._settings.min_interval
        if found.outcome is not left.outcome:
            self._report(found)

    def _is_unchanged(
        self, candidate: Candidate, active: ParameterBlock | None, now: float
    ) -> bool:
        """Whether the PLC has as good as this, with more than half of its time to go."""
        if active is None or active.status is not candidate.status or self._written_at is None:
            return False
        if now - self._written_at > 0.5 * self._settings.valid_for:
            return False
        if candidate.status is not Status.VALID:
            return True
        found, deadband = candidate.findings, self._settings.deadband
        return (
            abs(found.stick_band.value - active.stick_band.value) <= deadband
            and abs(found.slip_jump.value - active.slip_jump.value) <= deadband
        )

    def _in_force(self, active: ParameterBlock | None, now: float) -> bool:
        """Whether the PLC has a sticky valve's model that has not expired.

        A block of a time before this process counts from its start: at worst it is kept too long.
        """
        if active is None or active.status is not Status.VALID:
            return False
        return now - (self._written_at or 0.0) <= active.valid_for

    def _look_for_ack(self, control: ControlWords, now: float) -> None:
        if self._awaited is None:
            return
        attempt = self._awaited.attempt
        assert attempt.block is not None
        assert attempt.bank is not None
        if self._awaited.until is None:
            self._awaited.until = now + self._ack_wait
        committed = commit_word(attempt.bank, attempt.block.seq)
        if control.ack_seq == attempt.block.seq and control.ack_result == ACCEPTED:
            self._written_at = now
            # What a failed commit left waiting has arrived after all.
            if self._pending is attempt.candidate:
                self._pending = None
            self._finish(attempt.became(WritebackOutcome.ACCEPTED, ""))
        elif control.ack_commit == committed and control.ack_result != ACCEPTED:
            self._finish(
                attempt.became(WritebackOutcome.REJECTED, describe_ack(control.ack_result))
            )
        elif now >= self._awaited.until:
            self._finish(
                attempt.became(
                    WritebackOutcome.NOT_ACKNOWLEDGED,
                    f"ack_seq is {control.ack_seq} after {self._ack_wait:g} s",
                )
            )

    def _finish(self, attempt: Attempt) -> None:
        self._awaited = None
        self._report(attempt)

    def _wait(self, outcome: WritebackOutcome, reason: str) -> None:
        """Say once a candidate why it waits."""
        if self._pending is not None:
            self._say(outcome, reason, Attempt(outcome, reason, self._pending))

    def _say(self, outcome: WritebackOutcome, reason: str, attempt: Attempt) -> None:
        if self._said is not outcome:
            self._said = outcome
            self._report(attempt.became(outcome, reason))

    def _settle(self, attempt: Attempt) -> None:
        if not attempt.outcome.leaves_pending and self._pending is attempt.candidate:
            self._pending = None
        self._report(attempt)
