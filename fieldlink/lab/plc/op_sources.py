"""Who decides OP of a loop with a plant: a controller of the PLC, a person, or a client.

A source is asked once a scan, before OP goes to the plant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, NamedTuple, Protocol

from compensator import Controller, OpLimits, Supervisor, WithdrawReason
from fieldlink.compensate.offers import uncertainty_of
from fieldlink.lab.plc.program import Commands
from fieldlink.registers import Fallback, ReaderState
from loop_model import LoopModel

__all__ = ["ByClient", "ByHand", "ClientState", "Decision", "OpSource", "Supervised", "TimeOut"]

_REASONS = {
    Fallback.EXPIRED: WithdrawReason.EXPIRED,
    Fallback.HEARTBEAT_DEAD: WithdrawReason.HEARTBEAT_DEAD,
}


class ClientState(IntEnum):
    """What the status register of a loop with a controller outside shows."""

    IN_COMMAND = 0
    HELD = 1
    FAIL_SAFE = 2
    TAKEN_OVER = 3
    MANUAL = 4


class Decision(NamedTuple):
    """OP, whether the loop is in automatic, and the status to show (None for none)."""

    op: float
    automatic: bool
    status: ClientState | None = None


class OpSource(Protocol):
    """Decides OP."""

    def decide(self, pv: float, op: float, commands: Commands) -> Decision:
        """Return OP for PV measured now; ``op`` was applied since the scan before."""
        ...


class ByHand:
    """OP from a client that writes the tag; there is no time-out."""

    def __init__(self, limits: OpLimits) -> None:
        self._limits = limits

    def decide(self, pv: float, op: float, commands: Commands) -> Decision:  # noqa: ARG002
        """Return what was written, inside the limits."""
        return Decision(_written(op, commands, self._limits), automatic=False)


class Supervised:
    """A controller of the PLC, and the compensator while a block is in force.

    Args:
        supervisor: has both.
        limits: of what an operator writes.
    """

    def __init__(self, supervisor: Supervisor, limits: OpLimits) -> None:
        self.supervisor = supervisor
        self._limits = limits
        self._model: LoopModel | None = None

    def decide(self, pv: float, op: float, commands: Commands) -> Decision:
        """Return the controller's OP in automatic, the operator's in manual."""
        self._follow(commands.block)
        action = self.supervisor.step(pv, commands.sp, op, automatic=commands.automatic)
        decided = action.op if math.isfinite(action.op) else op
        if not commands.automatic:
            decided = _written(decided, commands, self._limits)
        return Decision(decided, commands.automatic)

    def _follow(self, block: ReaderState | None) -> None:
        """Tell the supervisor of a change of model, once."""
        model = None if block is None else block.model
        if model == self._model:
            return
        self._model = model
        if block is not None and block.in_force is not None and model is not None:
            self.supervisor.offer(model, uncertainty_of(block.in_force))
        else:
            self.supervisor.withdraw(_reason(block))


@dataclass(frozen=True, slots=True)
class TimeOut:
    """What happens when a client that has a loop falls silent.

    Attributes:
        after: plant seconds without a write of OP.
        policy: keep OP, go to ``fail_safe_op``, or let the PLC's own controller take over.
    """

    after: float
    policy: Literal["hold", "fail_safe", "take_over"]
    fail_safe_op: float = math.nan


class ByClient:
    """A controller outside: a client that writes OP, if only to show that it lives.

    While it is silent for too long the policy of the time-out has the loop; the first write gives
    it back. The mode stays what the operator chose: who has the loop is for the status to say.

    Args:
        time_out: the policy.
        period: of the loop, seconds.
        limits: of OP.
        own: the PLC's controller for ``take_over``; it observes all the time, so that it takes over
            without a bump.
    """

    def __init__(
        self, time_out: TimeOut, period: float, limits: OpLimits, own: Controller | None
    ) -> None:
        self._time_out = time_out
        self._period = period
        self._limits = limits
        self._own = own
        self._silent = 0

    def decide(self, pv: float, op: float, commands: Commands) -> Decision:
        """Return the client's OP, or the value that the policy gives when it is silent."""
        self._silent = 0 if commands.op_was_written else self._silent + 1
        if self._own is not None:
            self._own.observe(pv, op)
        if not commands.automatic:
            return Decision(_written(op, commands, self._limits), False, ClientState.MANUAL)
        if self._silent * self._period <= self._time_out.after:
            return Decision(_written(op, commands, self._limits), True, ClientState.IN_COMMAND)
        if self._own is not None:
            wanted = self._own.decide(commands.sp).op
            kept = wanted if math.isfinite(wanted) else op
            return Decision(kept, True, ClientState.TAKEN_OVER)
        if self._time_out.policy == "fail_safe":
            safe = min(max(self._time_out.fail_safe_op, self._limits.low), self._limits.high)
            return Decision(safe, True, ClientState.FAIL_SAFE)
        return Decision(op, True, ClientState.HELD)


def _written(op: float, commands: Commands, limits: OpLimits) -> float:
    """The OP tag's value, held inside the limits; ``op`` where the tag is not writable."""
    if not math.isfinite(commands.op):
        return op
    return min(max(commands.op, limits.low), limits.high)


def _reason(block: ReaderState | None) -> WithdrawReason:
    """Why a block gives no model, in the supervisor's words."""
    if block is None:
        return WithdrawReason.OPERATOR
    if block.fallback is not None:
        return _REASONS.get(block.fallback, WithdrawReason.OPERATOR)
    return WithdrawReason.NO_STICTION  # in force, and it says that the valve is healthy
