"""The write-back of one loop: findings into the PLC's parameter block, by rules without exception.

Every two plant seconds `BlockWriter.service` reads the exchange area, beats the heartbeat, looks
for the PLC's acknowledgement, and makes at most one attempt:

    sole writer? - no operator's order against it? - enable bit set? - minimum interval over?
    do banks and acknowledgement agree? - do the rules (`rules`) allow it now?
    may it replace what is in force?
    store what is about to be written - once that is stored, and the rules still allow it: write,
    read back, read enable and acknowledgement again, commit (`handover`)

Only the newest candidate waits, and a newer window that says otherwise ends its wait. An operator
decides by clearing the enable bit and setting it again: withdrawals, refusals and contests are
forgotten then. Times are plant seconds that the caller passes in; there is no clock here.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Protocol

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.candidate import Agreement, Candidate, findings_agree
from fieldlink.daemon.writeback.exchange_io import ControlWords, Exchange
from fieldlink.daemon.writeback.handover import Handover
from fieldlink.daemon.writeback.in_force import InForce, RefusedModel, refusal_of
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.rules import Objection, Rules
from fieldlink.daemon.writeback.sequence import SequenceNumbers
from fieldlink.daemon.writeback.sole_writer import SoleWriter, Standing
from fieldlink.daemon.writeback.standing_orders import StandingOrders
from fieldlink.errors import FieldlinkError
from fieldlink.links import LinkError
from fieldlink.registers import (
    ACCEPTED,
    HEARTBEAT_EVERY,
    HEARTBEAT_TIMEOUT,
    BlockFault,
    ParameterBlock,
    Status,
    commit_word,
    describe_ack,
)
from fieldlink.site import WriteBack as WriteBackSettings
from fieldlink.store import WritebackRecord

__all__ = ["BlockWriter", "Receipt"]

ACK_WAIT = 10.0
"""Plant seconds that a PLC may take to acknowledge, or four periods of the loop if that is more."""

RETRY = 30.0
"""Plant seconds after an attempt that failed before its commit, or the interval if that is less."""

RECORD_WAIT = 60.0
"""Plant seconds after which it is told that a block waits for the store."""


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
    contradicted: bool = False


@dataclass(slots=True)
class _Awaited:
    """An attempt that the PLC has to acknowledge, from its first look on until a plant second."""

    attempt: Attempt
    until: float | None = None


class BlockWriter:
    """Writes the blocks of one loop.

    Args:
        settings: the loop's write-back settings, with an exchange area and a loop id.
        exchange: the exchange area.
        period: plant seconds of the loop's period.
        read_only: never write, whatever the settings say.
        pause: waits one scan of the PLC before a second read-back.
        report: called with every attempt and every decision.
        keep: called with an attempt before anything of it is written; promises its row.
        tell: called with kind and message of what an operator has to know.
        numbers: the loop's sequence numbers.
        identity: of this installation; None where it has none.
        max_age: plant seconds for which a finding may wait; the settings' where they give one.
        orders: what an operator has ordered for the loop, looked at whenever something is written.
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
        tell: Callable[[str, str], None],
        numbers: SequenceNumbers,
        identity: int | None = None,
        max_age: float = math.inf,
        orders: StandingOrders | None = None,
    ) -> None:
        if settings.loop_id is None:
            raise ValueError("write-back needs a loop_id; the site file's check asks for it")
        self._settings = settings
        self._exchange = exchange
        self._rules = Rules(settings, settings.loop_id, read_only, settings.max_age or max_age)
        self._handover = Handover(
            exchange,
            loop_id=settings.loop_id,
            valid_for=settings.valid_for,
            pause=pause,
            numbers=numbers,
        )
        self._orders = orders or StandingOrders()
        self._off_since: float | None = None
        self._report = report
        self._keep = keep
        self._tell = tell
        self._ack_wait = max(ACK_WAIT, 4.0 * period)
        self._sole = SoleWriter(identity)
        self._agreement = Agreement()
        self._in_force = InForce()
        self._pending: Candidate | None = None
        self._said: WritebackOutcome | None = None
        self._begun: _Begun | None = None
        self._under_way: Attempt | None = None
        self._awaited: _Awaited | None = None
        self._left: Attempt | None = None
        self._not_before = -math.inf
        self._next_look: float | None = None
        self._was_enabled: bool | None = None
        self._held = ""
        self._refused: RefusedModel | None = None
        self._refusal = ""
        self._told: set[str] = set()
        self._found_at: float | None = None
        self.compensates: bool | None = None

    @property
    def requests(self) -> int:
        """Requests made so far."""
        return self._exchange.requests

    @property
    def block(self) -> ParameterBlock | None:
        """The last block that the PLC acknowledged and that said something of the valve."""
        return self._in_force.block

    @property
    def may_compensate(self) -> bool:
        """Whether the PLC's controller may be using a block, or be about to."""
        return bool(self.compensates) or self._awaited is not None

    @property
    def refusal(self) -> str:
        """Why the PLC's controller does not use the accepted model; empty when it does."""
        return self._refusal

    @property
    def waiting(self) -> str | None:
        """What waits to be written, and why; None when nothing does."""
        if self._begun is not None:
            return "its row is being stored"
        if self._awaited is not None:
            return "the PLC has not acknowledged yet"
        if self._pending is None:
            return None
        what = self._pending.status.name.lower().replace("_", " ")
        why = "its turn comes with the next look" if self._said is None else self._said.advice
        return f"{what}: {why}"

    def carry_over(self, other: BlockWriter) -> None:
        """Go on where another writer of the same registers was; everything is judged anew.

        Named here is all that is carried: what waits and what is under way, what the PLC has, what
        operators decided, and the times of the last look and attempt.
        """
        self._agreement = other._agreement
        self._pending, self._said, self._awaited = other._pending, None, other._awaited
        # A handover that was given up in the middle is looked for in the PLC; one that was planned
        # and not begun is planned anew.
        self._left = other._under_way or other._left
        if other._begun is not None and other._under_way is None:
            planned = other._begun.attempt
            self._report(planned.became(WritebackOutcome.INTERRUPTED, "the site was read again"))
            if self._pending is None and not other._begun.contradicted:
                self._pending = planned.candidate
        self._in_force, self._sole = other._in_force, other._sole
        self._not_before, self._next_look = other._not_before, other._next_look
        self._was_enabled, self._held = other._was_enabled, other._held
        self._refused, self._refusal = other._refused, other._refusal
        self._told = other._told
        self._found_at, self.compensates = other._found_at, other.compensates
        self._off_since = other._off_since

    def identify(self, identity: int) -> None:
        """Take the identity of this installation; to be called before the first look."""
        self._sole = SoleWriter(identity)

    def resume(self, record: WritebackRecord) -> None:
        """Go on after the last block of a process before this one.

        The outcome of a block whose row leaves it open is found at the next look. A
        withdrawal holds until an operator decides otherwise.
        """
        attempt = self._handover.recall(record)
        if attempt is None:
            return
        if attempt.candidate.withdrawal:
            self._held = "withdrawn before the daemon began again"
        if attempt.outcome.leaves_open:
            self._left = attempt

    def submit(
        self, findings: Findings, end_utc: float, *, since: float, compensated: bool = False
    ) -> None:
        """Judge new findings; what passes waits for its turn and takes the place of what waited.

        Args:
            findings: of the newest window.
            end_utc: end of the window, seconds since 1970.
            since: plant second of that.
            compensated: whether a block may have been in force during the window.
        """
        if self._found_at is not None and since <= self._found_at:
            compensated = True
        counted = self._agreement.count(findings)
        candidate = Candidate(findings, end_utc, counted, since, compensated)
        self._drop_what_contradicts(findings)
        objection = self._judge(candidate, since)
        if objection is not None:
            self._report(Attempt(objection.outcome, objection.reason, candidate))
            return
        if self._pending is not None:
            if self._pending.withdrawal or _says_nothing_against(self._pending, candidate):
                kept = "what waits is not touched by a window that cannot tell"
                self._report(Attempt(WritebackOutcome.KEPT_VALID, kept, candidate))
                return
            self._report(Attempt(WritebackOutcome.SUPERSEDED, "", self._pending))
        self._pending, self._said = candidate, None

    def withdraw(self, reason: str, utc: float) -> None:
        """Withdraw the loop's block at the next look; no block follows until an operator decides.

        Args:
            reason: the operator's, for the record.
            utc: seconds since 1970.

        Raises:
            FieldlinkError: an operator has switched the loop's write-back off.
        """
        if self._orders.off:
            raise FieldlinkError(
                "the loop's write-back is switched off, so nothing can be written; the PLC drops "
                "its model by itself when the heartbeat stands still"
            )
        if self._pending is not None:
            self._report(Attempt(WritebackOutcome.SUPERSEDED, "", self._pending))
        self._held = reason
        self._pending, self._said = Candidate.to_withdraw(reason, utc), None
        self._not_before = -math.inf

    async def service(self, now: float) -> bool:
        """Do what is due at ``now`` plant seconds; return whether that was anything.

        Raises:
            LinkError: the exchange area could not be read, or the heartbeat not written.
        """
        if self._rules.read_only or (self._next_look is not None and now < self._next_look):
            return False
        self._next_look = now + HEARTBEAT_EVERY
        try:
            control = await self._exchange.control()
            self._watch_operator(control)
            standing = self._sole.look(control, now)
            self._watch_orders(now)
            if control.enabled and not self._orders.off:
                await self._show_life(control)
            await self._in_force.look(self._exchange, control, now)
        except LinkError as error:
            self._wait(WritebackOutcome.UNREACHABLE, str(error))
            raise
        if standing is Standing.CONTESTED:
            self._tell_once("writeback.contested", standing.value)
        if self._left is not None:
            await self._look_back(self._left, control, now)
        self._look_for_ack(control, now)
        self._watch_use(control, now)
        if self._orders.off:
            self._wait(WritebackOutcome.SWITCHED_OFF, self._orders.off)
            return True
        if self._begun is None and self._awaited is None and self._pending is not None:
            await self._try(self._pending, control, now)
        if self._begun is not None:
            await self._go_on(self._begun, control, now)
        return True

    async def _show_life(self, control: ControlWords) -> None:
        if (identity := self._sole.mark(control)) is not None:
            await self._exchange.sign(identity)
        if self._sole.beats:
            await self._exchange.beat(self._sole.next_beat(control))

    def _watch_orders(self, now: float) -> None:
        """Notice since when the write-back is switched off."""
        if not self._orders.off:
            self._off_since = None
        elif self._off_since is None:
            self._off_since = now

    def _watch_operator(self, control: ControlWords) -> None:
        """Take an enable bit that was cleared and set again as the operator's decision."""
        again = self._was_enabled is False and control.enabled
        self._was_enabled = control.enabled
        if not again:
            return
        withdrawing = self._pending is not None and self._pending.withdrawal
        if not withdrawing:
            self._held = ""
        self._refused = None
        if self._sole.standing is Standing.CONTESTED:
            self._sole.start_again()
        self._told.clear()

    def _watch_use(self, control: ControlWords, now: float) -> None:
        """Notice whether the block in force is used, and what the PLC's controller refuses."""
        valve = self._in_force.valve(now)
        refusal = refusal_of(control) if valve is not None else ""
        if refusal and refusal != self._refusal and valve is not None:
            self._refused = RefusedModel(valve, control.ack_refusal or 0, now)
            self._tell("writeback.refused", f"block {valve.seq}: {refusal}")
        self._refusal = refusal
        # Without a heartbeat the PLC drops its model.
        dropped = self._off_since is not None and now - self._off_since > HEARTBEAT_TIMEOUT
        uses = valve is not None and control.enabled and not refusal and not dropped
        if uses and self.compensates is None:
            # Nobody looked before: the windows up to now may have been compensated.
            self._found_at = now
            if self._pending is not None and not self._pending.withdrawal:
                self._pending = replace(self._pending, compensated=True)
        if uses is not self.compensates:
            self._agreement.start_again()
        self.compensates = uses

    def _drop_what_contradicts(self, findings: Findings) -> None:
        """End the wait of what a newer window contradicts, whether or not that may be written."""
        pending, begun = self._pending, self._begun
        if pending is not None and _contradicts(findings, pending):
            self._pending, self._said = None, None
            self._report(Attempt(WritebackOutcome.CONTRADICTED, _words(findings), pending))
        if begun is not None and _contradicts(findings, begun.attempt.candidate):
            self._begun = replace(begun, contradicted=True)

    def _judge(self, candidate: Candidate, now: float) -> Objection | None:
        return self._rules.judge(candidate, now, held=self._held, refused=self._refused)

    def _objection_at(
        self, control: ControlWords, attempt: Attempt, now: float
    ) -> Objection | None:
        """Return why an attempt must not go on, by what is known at this moment."""
        candidate = attempt.candidate
        if self._begun is not None and self._begun.contradicted:
            return Objection(WritebackOutcome.CONTRADICTED, "")
        if (objection := self._rules.heed(candidate, self._orders)) is not None:
            return objection
        if self._sole.look(control, now) is not Standing.SOLE:
            return Objection(WritebackOutcome.CONTESTED, self._sole.standing.value)
        if not control.enabled:
            return Objection(WritebackOutcome.NOT_ENABLED, f"enable register is {control.enable}")
        if control.disagreement:
            return Objection(WritebackOutcome.DISAGREES, control.disagreement)
        if control.inactive_bank is not attempt.bank:
            return Objection(
                WritebackOutcome.READBACK_DIFFERS, "the PLC has changed its bank meanwhile"
            )
        if (objection := self._judge(candidate, now)) is not None:
            return objection
        if candidate.withdrawal:
            return None
        return self._rules.compare(candidate, self._in_force, now, unused=bool(self._refusal))

    async def _try(self, candidate: Candidate, control: ControlWords, now: float) -> None:
        if (objection := self._judge(candidate, now)) is not None:
            self._settle(Attempt(objection.outcome, objection.reason, candidate))
            return
        if (objection := self._rules.heed(candidate, self._orders)) is not None:
            self._wait(objection.outcome, objection.reason)
            return
        if self._sole.standing is not Standing.SOLE:
            self._wait(WritebackOutcome.CONTESTED, self._sole.standing.value)
            return
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
        if self._pending is not candidate:
            # A newer window came while the banks were read: the next look is for that.
            return
        if banks.disagreement:
            self._tell_once("writeback.disagrees", banks.disagreement)
            self._wait(WritebackOutcome.DISAGREES, banks.disagreement)
            return
        self._told.discard("writeback.disagrees")
        if not candidate.withdrawal:
            unused = bool(self._refusal)
            objection = self._rules.compare(candidate, self._in_force, now, unused=unused)
            if objection is not None:
                self._decline(candidate, objection, banks.active_words)
                return
            valve = self._in_force.valve(now)
            if candidate.compensated and valve is not None:
                candidate = candidate.confirming(valve)
        attempt = self._handover.plan(candidate, control, banks)
        self._begun = _Begun(attempt, self._keep(attempt), now)
        self._pending = None

    def _decline(self, candidate: Candidate, objection: Objection, active: tuple[int, ...]) -> None:
        """Give up a candidate that must not replace what the PLC has."""
        if objection.outcome is WritebackOutcome.CONTRADICTS_BLOCK:
            self._tell_once(
                "writeback.experiment_wanted", f"{objection.reason}; {objection.outcome.advice}"
            )
        if self._pending is candidate:
            self._pending = None
        self._report(Attempt(objection.outcome, objection.reason, candidate, active_before=active))

    async def _go_on(self, begun: _Begun, control: ControlWords, now: float) -> None:
        """Write what was begun once its row is in the store."""
        attempt = begun.attempt
        if not begun.receipt.done():
            if now - begun.since > RECORD_WAIT:
                self._say(WritebackOutcome.NOT_RECORDED, "its row is not stored yet", attempt)
            return
        if not begun.receipt.result():
            done = attempt.became(WritebackOutcome.NOT_RECORDED, "the store did not take its row")
        elif (objection := self._objection_at(control, attempt, now)) is not None:
            done = attempt.became(objection.outcome, objection.reason)
        else:
            self._under_way = attempt
            done = await self._handover.carry_out(
                attempt, lambda found: self._objection_at(found, attempt, now)
            )
            self._under_way = None
        contradicted = self._begun is not None and self._begun.contradicted
        self._begun = None
        interval = self._settings.min_interval
        if done.outcome in (WritebackOutcome.COMMITTED, WritebackOutcome.COMMIT_FAILED):
            self._awaited = _Awaited(done)
            self._not_before = now + interval
        else:
            self._not_before = now + min(interval, RETRY)
        if done.outcome.leaves_pending and self._pending is None and not contradicted:
            self._pending, self._said = attempt.candidate, done.outcome
        self._report(done)

    async def _look_back(self, left: Attempt, control: ControlWords, now: float) -> None:
        """Complete the record of what a process before this one had begun."""
        found = await self._handover.look_back(left, control)
        self._left = None
        if found.outcome is WritebackOutcome.COMMITTED:
            self._awaited = _Awaited(found)
            self._not_before = now + self._settings.min_interval
        elif found.candidate.withdrawal:
            self._pending, self._said = found.candidate, None
        if found.outcome is not left.outcome:
            self._report(found)

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
            self._in_force.accept(attempt.block, now)
            # What a failed commit left waiting has arrived after all.
            if self._pending is attempt.candidate:
                self._pending = None
            self._finish(attempt.became(WritebackOutcome.ACCEPTED, ""))
        elif control.ack_commit == committed and control.ack_result != ACCEPTED:
            if control.ack_result == BlockFault.NOT_ENABLED.code and self._pending is None:
                # Not the finding was refused: it is judged anew and gets a new number.
                self._pending, self._said = attempt.candidate, WritebackOutcome.NOT_ENABLED
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

    def _tell_once(self, kind: str, message: str) -> None:
        """Tell what holds until an operator decides, once."""
        if kind not in self._told:
            self._told.add(kind)
            self._tell(kind, message)

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


def _contradicts(findings: Findings, candidate: Candidate) -> bool:
    """Whether newer findings say otherwise; a window that cannot tell says nothing."""
    if candidate.withdrawal or findings.verdict == "not_assessable":
        return False
    return not findings_agree(candidate.findings, findings)


def _says_nothing_against(waiting: Candidate, newer: Candidate) -> bool:
    """Whether a window that cannot tell would take the place of one that can."""
    return newer.status is Status.NOT_ASSESSABLE and waiting.status is not Status.NOT_ASSESSABLE


def _words(findings: Findings) -> str:
    verdict = findings.verdict.replace("_", " ")
    if findings.verdict != "stiction":
        return f"a newer window says {verdict}"
    return f"a newer window says {verdict} with S = {findings.stick_band.value:g}"
