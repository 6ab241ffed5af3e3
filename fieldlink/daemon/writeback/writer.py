"""The write-back of one loop: findings into the PLC's parameter block, by rules without exception.

Every two plant seconds `BlockWriter.service` reads the exchange area, beats the heartbeat, looks
for the PLC's acknowledgement, and makes at most one attempt:

    sole writer? - no operator's order against it? - enable bit set? - minimum interval over?
    do banks and acknowledgement agree? - do the rules allow it now?
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

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.block_use import BlockUse
from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.exchange_io import ControlWords, Exchange
from fieldlink.daemon.writeback.handover import Handover
from fieldlink.daemon.writeback.intake import Intake
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.permission import WritePermission
from fieldlink.daemon.writeback.recorded_handover import Receipt, RecordedHandover
from fieldlink.daemon.writeback.rules import Rules
from fieldlink.daemon.writeback.sequence import SequenceNumbers
from fieldlink.daemon.writeback.sole_writer import SoleWriter, Standing
from fieldlink.daemon.writeback.standing_orders import StandingOrders
from fieldlink.daemon.writeback.telling import ToldOnce
from fieldlink.daemon.writeback.turn import Turn
from fieldlink.daemon.writeback.unsettled import Unsettled
from fieldlink.daemon.writeback.waiting import Waiting
from fieldlink.errors import FieldlinkError
from fieldlink.links import LinkError
from fieldlink.registers import HEARTBEAT_EVERY, ParameterBlock, Status
from fieldlink.site import WriteBack as WriteBackSettings
from fieldlink.store import WritebackRecord

__all__ = ["BlockWriter", "Receipt"]

RETRY = 30.0
"""Plant seconds after an attempt that failed before its commit, or the interval if that is less."""

RETRY_AT_MOST = 600.0
"""Plant seconds to which that pause grows, twofold with each further failure: what has failed all
morning is not cured by a try every half minute, and each try leaves rows in the store."""

_UNHEARD = (
    "the heartbeat register does not keep what is written, so the PLC uses no block; look for a "
    "program that writes it, and at the register's address"
)

_LOST = (
    "and the PLC acknowledges none now, as after a restart without RETAIN; it controls without "
    "compensation until the next block; let it keep ack_seq, ack_result, active_bank and "
    "ack_commit over a restart"
)


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
        self._handover = Handover(
            exchange,
            loop_id=settings.loop_id,
            valid_for=settings.valid_for,
            pause=pause,
            numbers=numbers,
        )
        self._read_only = read_only
        self._orders = orders or StandingOrders()
        self._report = report
        self._told = ToldOnce(tell)
        self._use = BlockUse(self._orders, tell)
        rules = Rules(settings, settings.loop_id, read_only, settings.max_age or max_age)
        self._permission = WritePermission(rules, self._orders, self._use, identity)
        self._waiting = Waiting(report)
        self._intake = Intake(self._permission, self._waiting, report, settings.min_windows)
        self._recorded = RecordedHandover(self._handover, self._permission, self._waiting, keep)
        self._unsettled = Unsettled(period, self._handover, self._use, self._waiting, report)
        self._turn = Turn(
            self._handover,
            self._permission,
            self._use,
            self._waiting,
            self._recorded,
            self._told,
            report,
        )
        self._not_before = -math.inf
        self._failures = 0
        self._unanswered = ""
        self._next_look: float | None = None

    @property
    def requests(self) -> int:
        """Requests made so far."""
        return self._exchange.requests

    @property
    def block(self) -> ParameterBlock | None:
        """The last block that the PLC acknowledged and that said something of the valve."""
        return self._use.in_force.block

    @property
    def compensates(self) -> bool | None:
        """Whether the PLC's controller uses a block; None before the first look."""
        return self._use.in_use

    @property
    def may_compensate(self) -> bool:
        """Whether the PLC's controller may be using a block, or be about to."""
        return bool(self._use.in_use) or self._unsettled.is_awaited

    @property
    def refusal(self) -> str:
        """Why the PLC's controller does not use the accepted model; empty when it does."""
        return self._use.refusal

    @property
    def unused(self) -> str:
        """Why it does not use a model that it does not refuse; empty when it does."""
        return self._use.unused

    @property
    def waiting(self) -> str | None:
        """What waits to be written, and why; None when nothing does."""
        if self._recorded.is_begun:
            return self._unanswered or "its row is being stored"
        if self._unsettled.is_awaited:
            return "the PLC has not acknowledged yet"
        return self._waiting.words

    def carry_over(self, other: BlockWriter) -> None:
        """Go on where another writer of the same registers was; everything is judged again.

        Named here is all that is carried: what waits and what is under way, what the PLC has, what
        operators decided, and the times of the last look and attempt.
        """
        self._intake.carry_over(other._intake)
        self._waiting.carry_over(other._waiting)
        # A handover that was given up in the middle is looked for in the PLC; one that was planned
        # and not begun is planned again.
        self._unsettled.carry_over(other._unsettled, other._recorded.under_way)
        if (given_up := other._recorded.give_up()) is not None:
            planned, may_wait = given_up
            self._report(planned)
            if self._waiting.candidate is None and may_wait:
                self._waiting.put(planned.candidate)
        self._use.carry_over(other._use)
        self._permission.carry_over(other._permission)
        self._not_before, self._next_look = other._not_before, other._next_look
        self._told.carry_over(other._told)

    def mistrust_time(self, why: str) -> None:
        """Write no model while the samples contradict the loop's period; empty: they do not."""
        self._permission.mistimed = why

    def identify(self, identity: int) -> None:
        """Take the identity of this installation; to be called before the first look."""
        self._permission.sole = SoleWriter(identity)

    def resume(self, record: WritebackRecord) -> None:
        """Go on after the last block of a process before this one.

        The outcome of a block whose row leaves it open is found at the next look. A
        withdrawal holds until an operator decides otherwise.
        """
        attempt = self._handover.recall(record)
        if attempt is None:
            return
        outcome = attempt.outcome
        if attempt.candidate.withdrawal:
            self._permission.held = "withdrawn before the daemon started again"
        if outcome.leaves_withdrawal_open if attempt.candidate.withdrawal else outcome.leaves_open:
            self._unsettled.leave(attempt)

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
        self._recorded.contradict(findings)
        self._intake.take(findings, end_utc, since, compensated)

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
        self._permission.held = reason
        self._waiting.supersede(Candidate.to_withdraw(reason, utc))
        self._not_before = -math.inf

    async def service(self, now: float) -> bool:
        """Do what is due at ``now`` plant seconds; return whether that was anything.

        Raises:
            LinkError: the exchange area could not be read, or the heartbeat not written.
        """
        if self._read_only or (self._next_look is not None and now < self._next_look):
            return False
        self._next_look = now + HEARTBEAT_EVERY
        try:
            control = await self._exchange.control()
            if self._permission.watch_enable(control):
                self._follow_operator()
            was = self._permission.sole.standing
            standing = self._permission.sole.look(control, now)
            self._use.watch_orders(now)
            if control.enabled and not self._orders.off:
                if control.names_a_bank:
                    await self._show_life(control)
                else:
                    # Registers of something else, perhaps: they are not written to.
                    self._told.tell(
                        "writeback.disagrees",
                        f"{control.disagreement}; nothing is written there: check the base or the "
                        "addresses of the exchange area",
                    )
            had = self._use.in_force.valve(now)
            if await self._use.in_force.look(self._exchange, control, now):
                self._heed_a_withdrawn_block()
                self._notice_a_lost_block(had, control)
        except LinkError as error:
            self._unanswered = f"{WritebackOutcome.UNREACHABLE.advice}: {error.what}"
            self._waiting.explain(WritebackOutcome.UNREACHABLE, str(error))
            raise
        self._unanswered = ""
        if standing is Standing.CONTESTED:
            advice = WritebackOutcome.CONTESTED.advice
            self._told.tell("writeback.contested", f"{standing.value}; {advice}")
        elif was is Standing.DOUBTED and standing is Standing.SOLE:
            self._told.forget("writeback.uncontested")
            self._told.tell("writeback.uncontested", self._permission.sole.relief)
        if await self._unsettled.look_back(control):
            self._not_before = now + self._settings.min_interval
        await self._unsettled.look_for_answer(control, now)
        before = self._use.in_use
        unheard = self._permission.sole.is_unheard(now)
        if unheard:
            self._told.tell("writeback.heartbeat_lost", _UNHEARD)
        else:
            self._told.forget("writeback.heartbeat_lost")
        self._use.watch(control, now, is_unheard=unheard)
        self._intake.follow_use(before, self._use.in_use, now)
        if self._orders.off:
            self._waiting.explain(WritebackOutcome.SWITCHED_OFF, self._orders.off)
            return True
        waits = self._waiting.candidate
        is_free = not self._recorded.is_begun and not self._unsettled.is_awaited
        if waits is None or not is_free:
            pass
        elif not await self._turn.take(waits, control, now, self._not_before):
            # Banks that do not answer cost the device's polls a time-out each.
            self._not_before = now + self._retry
        await self._go_on(control, now)
        return True

    @property
    def _retry(self) -> float:
        return min(self._settings.min_interval, RETRY)

    async def _show_life(self, control: ControlWords) -> None:
        sole = self._permission.sole
        if (identity := sole.mark(control)) is not None:
            await self._exchange.sign(identity)
        if sole.beats:
            await self._exchange.beat(sole.next_beat(control))

    def _follow_operator(self) -> None:
        """Forget what held until an operator decides: the enable bit was cleared and set again."""
        if not self._waiting.forget_withdrawal():
            self._permission.held = ""
        self._use.refused = None
        if self._permission.sole.standing is Standing.CONTESTED:
            self._permission.sole.start_again()
        self._told.forget_all()

    def _notice_a_lost_block(self, had: ParameterBlock | None, control: ControlWords) -> None:
        """Report that the PLC has forgotten the block in force, as a restart makes it."""
        if control.ack_seq != 0:
            self._told.forget("writeback.lost")
        elif had is not None:
            self._told.tell("writeback.lost", f"block {had.seq} was in force, {_LOST}")

    def _heed_a_withdrawn_block(self) -> None:
        """Write nothing over a withdrawn block, whichever process wrote it, unasked."""
        block = self._use.in_force.block
        withdrawn = block is not None and block.status is Status.WITHDRAWN
        if withdrawn and not self._permission.held and not self._unsettled.is_awaited:
            self._permission.held = "the PLC has a block that says withdrawn"

    async def _go_on(self, control: ControlWords, now: float) -> None:
        """Write the block of the attempt under way once its row is stored."""
        done = await self._recorded.go_on(control, now)
        if done is None:
            return
        interval = self._settings.min_interval
        if done.outcome in (WritebackOutcome.COMMITTED, WritebackOutcome.COMMIT_FAILED):
            self._unsettled.expect(done)
            self._not_before = now + interval
            self._failures = 0
        else:
            pause = self._retry * 2.0 ** min(self._failures, 16)
            self._not_before = now + min(pause, RETRY_AT_MOST)
            self._failures += 1
        self._waiting.note_end(done)
        self._report(done)
