"""A loop of the simulated PLC that is controlled: a plant as an FMU, and a controller before it."""

from __future__ import annotations

import math

from compensator import Controller
from fieldlink.plc.program import Commands, LoopFailedError
from fieldlink.plc.truth import CycleRecord
from fmu_models import Plant, PlantError

__all__ = ["ControlledLoop"]


class ControlledLoop:
    """Plant, controller and, when a block is in force, the compensator.

    A cycle reads PV, computes OP from it, applies OP and lets the plant move on by one period; the
    PV it reports is the one that OP was computed from.

    Args:
        name: of the loop, for messages.
        plant: started; with input ``op`` and output ``pv``, and ``stem`` where it knows it.
        controller: what computes OP; None leaves the loop to whoever writes OP.
        op: OP at which the plant was started.
    """

    def __init__(self, name: str, plant: Plant, controller: Controller | None, op: float) -> None:
        self._name = name
        self._plant = plant
        self._controller = controller
        self._op = op
        self._pv = plant.outputs()["pv"]

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
        pv, op = self._pv, self._op
        automatic = commands.automatic and self._controller is not None
        if self._controller is not None:
            self._controller.observe(pv, op)
            if automatic:
                action = self._controller.decide(commands.sp)
                op = action.op if math.isfinite(action.op) else op
        if not automatic and math.isfinite(commands.op):
            op = commands.op
        try:
            outputs = self._plant.step({"op": op})
        except PlantError as error:
            raise LoopFailedError(
                f"loop {self._name}: {error}; the loop stands still, restart the PLC to go on"
            ) from error
        self._op, self._pv = op, outputs["pv"]
        return CycleRecord(op, pv, commands.sp, outputs.get("stem", math.nan), automatic, False)

    def close(self) -> None:
        """End the plant."""
        self._plant.close()
