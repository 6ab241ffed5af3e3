"""Whether the PLC's controller uses the block in force, and which model it refuses."""

from __future__ import annotations

from collections.abc import Callable

from fieldlink.daemon.writeback.exchange_io import ControlWords
from fieldlink.daemon.writeback.in_force import InForce, RefusedModel, refusal_of
from fieldlink.daemon.writeback.standing_orders import StandingOrders
from fieldlink.registers import HEARTBEAT_TIMEOUT

__all__ = ["BlockUse"]


class BlockUse:
    """Watches what the PLC does with the block that it accepted.

    Args:
        orders: what operators have ordered for the loop.
        tell: called with kind and message of what an operator has to know.

    Attributes:
        in_force: the block that the PLC acknowledges.
        in_use: whether its controller uses it; None before the first look that tells.
        refused: the model that its controller refused last; None after an operator's decision.
        refusal: why it does not use the accepted model; empty when it does.
        unused: why it does not use it although it does not refuse it; empty when it does.
    """

    def __init__(self, orders: StandingOrders, tell: Callable[[str, str], None]) -> None:
        self._orders = orders
        self._tell = tell
        self._off_since: float | None = None
        self.in_force = InForce()
        self.in_use: bool | None = None
        self.refused: RefusedModel | None = None
        self.refusal = ""
        self.unused = ""

    def carry_over(self, other: BlockUse) -> None:
        """Go on with what another one has seen of the same registers."""
        self._off_since = other._off_since
        self.in_force, self.in_use = other.in_force, other.in_use
        self.refused, self.refusal = other.refused, other.refusal
        self.unused = other.unused

    def watch_orders(self, now: float) -> None:
        """Notice since when the write-back is switched off."""
        if not self._orders.off:
            self._off_since = None
        elif self._off_since is None:
            self._off_since = now

    def watch(self, control: ControlWords, now: float, *, is_unheard: bool = False) -> None:
        """Notice whether the block in force is used, and what the PLC's controller refuses.

        Args:
            control: the single words as read now.
            now: the plant second.
            is_unheard: whether the heartbeat does not reach the PLC.
        """
        if control.disagreement and self.in_use is None:
            # Still nobody knows which block is in force, so the windows may be compensated.
            return
        valve = self.in_force.valve(now)
        refusal = refusal_of(control) if valve is not None else ""
        if refusal and refusal != self.refusal and valve is not None:
            self.refused = RefusedModel(valve, control.ack_refusal or 0, now)
            self._tell("writeback.refused", f"block {valve.seq}: {refusal}")
        self.refusal = refusal
        # Without a heartbeat the PLC drops its model.
        dropped = self._off_since is not None and now - self._off_since > HEARTBEAT_TIMEOUT
        self.unused = ""
        if valve is not None and not refusal:
            if not control.enabled:
                self.unused = "the PLC's enable bit is off, and it controls without the model"
            elif dropped or is_unheard:
                self.unused = "no heartbeat reaches the PLC, and it controls without the model"
        self.in_use = valve is not None and not refusal and not self.unused
