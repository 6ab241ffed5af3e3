"""What may be written: every rule in one place, judged at the moment of writing.

A candidate is judged when it comes, when its turn comes, when its row is stored, and once more
between bank and commit; each time by the rules, limits and findings of that moment.
"""

from __future__ import annotations

from dataclasses import dataclass

from fieldlink.daemon.writeback.candidate import Candidate
from fieldlink.daemon.writeback.in_force import InForce, RefusedModel, has_other_gain
from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.daemon.writeback.standing_orders import StandingOrders
from fieldlink.registers import BlockError, ParameterBlock, Status
from fieldlink.site import WriteBack as WriteBackSettings

__all__ = ["Objection", "Rules"]


@dataclass(frozen=True, slots=True)
class Objection:
    """Why a candidate is not written, and the figures behind it."""

    outcome: WritebackOutcome
    reason: str


@dataclass(frozen=True, slots=True)
class Rules:
    """The rules of one loop.

    Attributes:
        settings: the loop's write-back settings.
        loop_id: as the PLC knows the loop.
        read_only: never write, whatever the settings say.
        max_age: plant seconds from the end of its window for which a finding may wait.
    """

    settings: WriteBackSettings
    loop_id: int
    read_only: bool
    max_age: float

    def judge(
        self, candidate: Candidate, now: float, *, held: str, refused: RefusedModel | None
    ) -> Objection | None:
        """Return why a candidate must not even wait; None when it may.

        Args:
            candidate: what is to be written.
            now: the plant second.
            held: why an operator wants no blocks; empty when none does.
            refused: the model that the PLC's controller has refused.
        """
        settings = self.settings
        if self.read_only:
            return Objection(WritebackOutcome.READ_ONLY, "")
        if candidate.withdrawal:
            return None
        if candidate.findings.uncertain:
            return Objection(WritebackOutcome.UNCERTAIN, "")
        if candidate.windows < settings.min_windows:
            counted = f"{candidate.windows} of {settings.min_windows} windows agree"
            return Objection(WritebackOutcome.TOO_FEW_WINDOWS, counted)
        if outside := self._outside(candidate):
            return Objection(WritebackOutcome.OUT_OF_LIMITS, outside)
        try:
            candidate.block(self.loop_id, 1, settings.valid_for)
        except BlockError as error:
            return Objection(WritebackOutcome.NOT_EXPRESSIBLE, str(error))
        if held:
            return Objection(WritebackOutcome.HELD, held)
        if refused is not None and refused.is_same(candidate, now):
            return Objection(WritebackOutcome.REFUSED_BEFORE, f"refusal code {refused.code}")
        if now - candidate.since > self.max_age:
            age = f"its window ended {now - candidate.since:.0f} s ago, limit {self.max_age:g} s"
            return Objection(WritebackOutcome.TOO_OLD, age)
        return None

    def heed(self, candidate: Candidate, orders: StandingOrders) -> Objection | None:
        """Return which standing order forbids a candidate now; None when none does."""
        if orders.off:
            return Objection(WritebackOutcome.SWITCHED_OFF, orders.off)
        if orders.hold and not candidate.withdrawal:
            return Objection(WritebackOutcome.ON_HOLD, orders.hold)
        return None

    def compare(
        self, candidate: Candidate, in_force: InForce, now: float, *, unused: bool
    ) -> Objection | None:
        """Return why a candidate must not replace what the PLC has; None when it may.

        Args:
            candidate: what is to be written.
            in_force: what the PLC has.
            now: the plant second.
            unused: whether the PLC's controller says that it does not use its model.
        """
        valve = in_force.valve(now)
        if candidate.compensated:
            if valve is None:
                gone = "the block under which its window was taken is no longer in force"
                return Objection(WritebackOutcome.CONTRADICTS_BLOCK, gone)
            if candidate.status is Status.VALID and not candidate.agrees_with(valve):
                what = (
                    f"S = {candidate.findings.stick_band.value:g}, "
                    f"in force is {valve.stick_band.value:g}"
                )
                return Objection(WritebackOutcome.CONTRADICTS_BLOCK, what)
        if valve is not None and not unused and candidate.status is not Status.VALID:
            return Objection(WritebackOutcome.KEPT_VALID, "the active block names a sticky valve")
        # a refused model is compared with its intervals before: what comes here is another one
        asked_for = unused and candidate.status is Status.VALID
        if not asked_for and self._is_unchanged(candidate, in_force, now):
            return Objection(WritebackOutcome.UNCHANGED, f"deadband {self.settings.deadband:g}")
        return None

    def _outside(self, candidate: Candidate) -> str:
        if candidate.status is not Status.VALID:
            return ""
        found, limits = candidate.findings, self.settings.limits
        for name, value, (low, high) in (
            ("stick_band", found.stick_band.value, limits.stick_band),
            ("slip_jump", found.slip_jump.value, limits.slip_jump),
        ):
            if not low <= value <= high:
                return (
                    f"no block is written: {name} {value:g} is outside writeback.limits "
                    f"({low:g} to {high:g})"
                )
        return ""

    def _is_unchanged(self, candidate: Candidate, in_force: InForce, now: float) -> bool:
        """Whether the PLC has as good as this, with more than half of its time to go."""
        active, accepted_at = in_force.block, in_force.accepted_at
        if active is None or active.status is not candidate.status or accepted_at is None:
            return False
        if now - accepted_at > 0.5 * self.settings.valid_for:
            return False
        if candidate.status is not Status.VALID or candidate.compensated:
            return True
        return self._is_within_deadband(candidate, active)

    def _is_within_deadband(self, candidate: Candidate, active: ParameterBlock) -> bool:
        found, deadband = candidate.findings, self.settings.deadband
        return (
            not has_other_gain(candidate, active)
            and abs(found.stick_band.value - active.stick_band.value) <= deadband
            and abs(found.slip_jump.value - active.slip_jump.value) <= deadband
        )
