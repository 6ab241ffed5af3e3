"""A loop of the simulated PLC that is controlled: a plant as an FMU, and a controller before it."""

from __future__ import annotations

import math

from compensator import OpLimits, Supervisor, WithdrawReason
from fieldlink.plc.program import Commands, LoopFailedError
from fieldlink.plc.truth import CycleRecord
from fieldlink.registers import Fallback, ReaderState
from fmu_models import Plant, PlantError
from loop_model import LoopModel

__all__ = ["ControlledLoop"]

_REASONS = {
    Fallback.EXPIRED: WithdrawReason.EXPIRED,
    Fallback.HEARTBEAT_DEAD: WithdrawReason.HEARTBEAT_DEAD,
}


class ControlledLoop:
    """Plant, controller and, while a block is in force, the compensator.

    A cycle reads PV, computes OP from it, applies OP and lets the plant move on by one period; the
    PV it reports is the one that OP was computed from.

    Args:
        name: of the loop, for messages.
        plant: started; with input ``op`` and output ``pv``, and ``stem`` where it knows it.
        supervisor: holds the controller; None leaves the loop to whoever writes OP.
        op: OP at which the plant was started.
        limits: range of OP, for the operator too.
    """

    def __init__(
        self,
        name: str,
        plant: Plant,
        supervisor: Supervisor | None,
        op: float,
        limits: OpLimits,
    ) -> None:
        self._name = name
        self._plant = plant
        self.supervisor = supervisor
        self._op = op
        self._limits = limits
        self._pv = plant.outputs()["pv"]
        self._model: LoopModel | None = None

    @property
    def op(self) -> float:
        """OP as it is applied now."""
        return self._op

    @property
    def pv(self) -> float:
        """PV as the next cycle will read it."""
        return self._pv

    def cycle(self, commands: Commands) -> CycleRecord:
        """Run one control cycle."""
        pv, op, supervisor = self._pv, self._op, self.supervisor
        automatic = commands.automatic and supervisor is not None
        if supervisor is not None:
            self._follow(supervisor, commands.block)
            action = supervisor.step(pv, commands.sp, op, automatic=automatic)
            op = action.op if math.isfinite(action.op) else op
        if not automatic and math.isfinite(commands.op):
            op = min(max(commands.op, self._limits.low), self._limits.high)
        try:
            outputs = self._plant.step({"op": op})
        except PlantError as error:
            raise LoopFailedError(
                f"loop {self._name}: {error}; the loop stands still, restart the PLC to go on"
            ) from error
        self._op, self._pv = op, outputs["pv"]
        return CycleRecord(
            op=op,
            pv=pv,
            sp=commands.sp,
            stem=outputs.get("stem", math.nan),
            automatic=automatic,
            compensated=supervisor is not None and supervisor.compensating,
        )

    def _follow(self, supervisor: Supervisor, block: ReaderState | None) -> None:
        """Tell the supervisor of a change of model, once."""
        model = None if block is None else block.model
        if model == self._model:
            return
        self._model = model
        if model is not None and math.isclose(model.process.period, self._plant.info.period):
            supervisor.offer(model)
        else:
            supervisor.withdraw(_reason(block))

    def close(self) -> None:
        """End the plant."""
        self._plant.close()


def _reason(block: ReaderState | None) -> WithdrawReason:
    """Why a block gives no model, in the supervisor's words."""
    if block is None:
        return WithdrawReason.OPERATOR
    if block.fallback is not None:
        return _REASONS.get(block.fallback, WithdrawReason.OPERATOR)
    # In force: either it says that the valve is healthy, or its model is of another period.
    return WithdrawReason.NO_STICTION if block.model is None else WithdrawReason.REFUSED
