"""Whether a candidate may be written now: rules, orders, enable bit and registers, in one place.

It is asked when a candidate's turn comes, when its row is stored, and once more between bank and
commit; each time it answers by what is known at that moment.
"""

from __future__ import annotations

from fieldlink.daemon.writeback.block_use import BlockUse
from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.exchange_io import ControlWords
from fieldlink.daemon.writeback.outcomes import Attempt, WritebackOutcome
from fieldlink.daemon.writeback.rules import Objection, Rules
from fieldlink.daemon.writeback.sole_writer import SoleWriter, Standing
from fieldlink.daemon.writeback.standing_orders import StandingOrders

__all__ = ["WritePermission"]


class WritePermission:
    """Permits or objects, for one loop.

    Args:
        rules: the loop's rules.
        orders: what operators have ordered for the loop.
        use: what the PLC has in force, and whether it is used.
        identity: of this installation; None where it has none.

    Attributes:
        held: why an operator wants no blocks; empty when none does.
        mistimed: how the samples contradict the loop's period; empty when they do not.
        sole: whether this installation is the only writer.
    """

    def __init__(
        self, rules: Rules, orders: StandingOrders, use: BlockUse, identity: int | None
    ) -> None:
        self._rules = rules
        self._orders = orders
        self._use = use
        self._was_enabled: bool | None = None
        self.held = ""
        self.mistimed = ""
        self.sole = SoleWriter(identity)

    def carry_over(self, other: WritePermission) -> None:
        """Go on with what operators decided and what is known of other writers."""
        self.held, self.sole, self._was_enabled = other.held, other.sole, other._was_enabled

    def watch_enable(self, control: ControlWords) -> bool:
        """Return whether the enable bit was cleared and is set again: an operator has decided.

        An area of zeros is a PLC that starts again, which decides nothing.
        """
        if control.blank:
            return False
        again = self._was_enabled is False and control.enabled
        self._was_enabled = control.enabled
        return again

    def judge(self, candidate: Candidate, now: float) -> Objection | None:
        """Return why a candidate must not even wait; None when it may."""
        if self.mistimed and not candidate.withdrawal:
            return Objection(WritebackOutcome.WRONG_PERIOD, self.mistimed)
        return self._rules.judge(candidate, now, held=self.held, refused=self._use.refused)

    def before_turn(
        self, candidate: Candidate, control: ControlWords, now: float, not_before: float
    ) -> Objection | None:
        """Return why a candidate's turn has not come; None when its block may be planned.

        Args:
            candidate: what is to be written.
            control: the single words as read now.
            now: the plant second.
            not_before: plant second of the earliest attempt.
        """
        objection = self.judge(candidate, now) or self._rules.heed(candidate, self._orders)
        if objection is not None:
            return objection
        if self.sole.standing is not Standing.SOLE:
            return Objection(WritebackOutcome.CONTESTED, self.sole.standing.value)
        if not control.enabled:
            return _not_enabled(control)
        if now < not_before:
            return Objection(WritebackOutcome.TOO_SOON, f"{not_before - now:.0f} s left")
        return None

    def to_replace(self, candidate: Candidate, now: float) -> Objection | None:
        """Return why a candidate must not replace what the PLC has; None when it may."""
        if candidate.withdrawal:
            return None
        unused = bool(self._use.refusal)
        return self._rules.compare(candidate, self._use.in_force, now, unused=unused)

    def to_go_on(self, attempt: Attempt, control: ControlWords, now: float) -> Objection | None:
        """Return why a planned attempt must not go on, by what is known now; None when it may."""
        candidate = attempt.candidate
        if (objection := self._rules.heed(candidate, self._orders)) is not None:
            return objection
        if self.sole.look(control, now) is not Standing.SOLE:
            return Objection(WritebackOutcome.CONTESTED, self.sole.standing.value)
        if not control.enabled:
            return _not_enabled(control)
        if control.disagreement:
            return Objection(WritebackOutcome.DISAGREES, control.disagreement)
        if control.inactive_bank is not attempt.bank:
            return Objection(
                WritebackOutcome.READBACK_DIFFERS, "the PLC has changed its bank meanwhile"
            )
        return self.judge(candidate, now) or self.to_replace(candidate, now)


def _not_enabled(control: ControlWords) -> Objection:
    return Objection(WritebackOutcome.NOT_ENABLED, f"enable register is {control.enable}")
