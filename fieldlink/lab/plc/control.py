"""Loops of the simulated PLC that have a plant: OP from the PLC, or from inside the plant."""

from __future__ import annotations

import math
from dataclasses import dataclass

from compensator import Supervisor
from fieldlink.compensate.offers import refusal_of
from fieldlink.lab.plc.op_sources import OpSource, Supervised
from fieldlink.lab.plc.plants import HostedPlant
from fieldlink.lab.plc.program import Commands, LoopFailedError
from fieldlink.lab.plc.truth import CycleRecord
from fieldlink.registers import Refusal

__all__ = ["ControlledLoop", "SelfControlledLoop", "Signals"]


@dataclass(frozen=True, slots=True)
class Signals:
    """What a loop's signals are called in its plant; ``stem`` need not exist, None sends no SP."""

    op: str = "op"
    pv: str = "pv"
    stem: str = "stem"
    sp: str | None = None


class _PlantLoop:
    """What both kinds of loops have."""

    def __init__(self, name: str, plant: HostedPlant, signals: Signals) -> None:
        self._name = name
        self._signals = signals
        self.plant = plant

    @property
    def pv(self) -> float:
        """PV as the next cycle will read it."""
        return self.plant.values[self._signals.pv]

    @property
    def refusal(self) -> Refusal | None:
        """Why the model of the block in force is not used; None if it is, or there is none."""
        return None

    @property
    def supervisor(self) -> Supervisor | None:
        """Who has controller and compensator; None for a loop without."""
        return None

    def close(self) -> None:
        """End the plant."""
        self.plant.close()

    def _send(self, commands: Commands, inputs: dict[str, float]) -> None:
        if self._signals.sp is not None and math.isfinite(commands.sp):
            inputs[self._signals.sp] = commands.sp
        self.plant.apply(inputs)

    @property
    def stem(self) -> float:
        """The stem after the step; NaN where unknown, or not known yet."""
        known = self.plant.is_fresh
        return self.plant.values.get(self._signals.stem, math.nan) if known else math.nan

    def _require_plant(self) -> None:
        error = self.plant.failure
        if error is not None:
            raise LoopFailedError(f"loop {self._name}: {error}") from error


class ControlledLoop(_PlantLoop):
    """A plant to which the PLC sends OP.

    A cycle reads PV, computes OP from it, applies OP and lets the plant move on by one period; the
    PV it reports is the one that OP was computed from.

    Args:
        name: of the loop, for messages.
        plant: started.
        signals: its variables.
        source: who decides OP.
        op: OP at which the plant was started.
    """

    def __init__(
        self, name: str, plant: HostedPlant, signals: Signals, source: OpSource, op: float
    ) -> None:
        super().__init__(name, plant, signals)
        self._source = source
        self._op = op
        self._record = CycleRecord(op, math.nan, math.nan, math.nan, False, False)

    @property
    def supervisor(self) -> Supervisor | None:
        """Who has controller and compensator; None for a loop without."""
        return self._source.supervisor if isinstance(self._source, Supervised) else None

    @property
    def refusal(self) -> Refusal | None:
        """Why the model of the block in force is not used; None if it is, or there is none."""
        return None if self.supervisor is None else refusal_of(self.supervisor)

    @property
    def op(self) -> float:
        """OP as it is applied now."""
        return self._op

    def begin(self, commands: Commands) -> None:
        """Read PV and decide OP."""
        self._require_plant()
        pv = self.pv
        decision = self._source.decide(pv, self._op, commands)
        self._op = decision.op
        supervisor = self.supervisor
        self._record = CycleRecord(
            op=decision.op,
            pv=pv,
            sp=commands.sp,
            stem=math.nan,
            automatic=decision.automatic,
            compensated=supervisor is not None and supervisor.compensating,
            status=decision.status,
        )
        self._send(commands, {self._signals.op: decision.op})

    def end(self) -> CycleRecord:
        """Return what the cycle did."""
        self._require_plant()
        return self._record.with_stem(self.stem)


class SelfControlledLoop(_PlantLoop):
    """A plant with its controller inside: OP is an output, and SP may be an input."""

    def __init__(self, name: str, plant: HostedPlant, signals: Signals) -> None:
        super().__init__(name, plant, signals)
        self._pv = self._sp = math.nan

    @property
    def op(self) -> float:
        """OP as it was applied last."""
        return self.plant.values[self._signals.op]

    def begin(self, commands: Commands) -> None:
        """Read PV and send SP."""
        self._require_plant()
        self._pv, self._sp = self.pv, commands.sp
        self._send(commands, {})

    def end(self) -> CycleRecord:
        """Return what the plant did; OP is the one that it applied in this step."""
        self._require_plant()
        op = self.op if self.plant.is_fresh else math.nan
        return CycleRecord(op, self._pv, self._sp, self.stem, True, False)
