"""``[loops.NAME.compensate]``: the compensator beside a real PLC."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from fieldlink.site.device import Model, Seconds

__all__ = ["CompensateSettings"]


class CompensateSettings(Model):
    """``[loops.NAME.compensate]``: OP computed by ``fieldlink compensate``. Off by default."""

    enabled: bool = False
    """Whether OP may be written (the PLC's enable register must allow it too)."""
    op_out: str | None = None
    """Tag that takes OP, writable in the register map; needed when enabled."""
    controller: Literal["hybrid", "embedding"] = "hybrid"
    """Which compensator has the loop."""
    low: float = 0.0
    """Least OP that is ever written."""
    high: float = 100.0
    """Greatest OP that is ever written."""
    rate: float = Field(default=5.0, gt=0, le=1e6)
    """Most that OP changes from one scan to the next."""
    heartbeat_timeout: Seconds = 10.0
    """Plant seconds without a count of the daemon's heartbeat after which the block is not used."""
    travel_budget: float = Field(default=2.0, ge=0.1, le=100)
    """Factor of the stem's travel before compensation beyond which the model is given up."""
    pv_trip: float = Field(default=3.0, ge=1, le=100)
    """Multiple of the largest error known beyond which PV must return at once."""
    memory: str | None = None
    """File that keeps what the compensator must know after a restart, relative to the site file's
    folder; LOOP.compensator.json unless given."""
    retry_after: float = Field(default=28800.0, gt=0)
    """Seconds after which a model that was given up may be tried again: one shift."""
    gain_sign: Literal[-1, 0, 1] = 0
    """Sign of the process gain that the PLC's controller counts on; 0 when it is not known."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.enabled and self.op_out is None:
            raise ValueError("enabled = true needs op_out; name the tag that takes OP")
        if not self.low < self.high:
            raise ValueError(
                f"low = {self.low:g} is not below high = {self.high:g}; exchange or correct them"
            )
        return self
