"""How an FMU is run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fieldlink.lab.fmu.inputs import InputSeries
from fieldlink.lab.fmu.recorder import TableFile
from fmu_models import Master, StartValue

__all__ = ["RunSettings"]


@dataclass(frozen=True, slots=True)
class RunSettings:
    """How to run.

    Attributes:
        stop: second at which the run ends; None takes the default experiment's.
        step: seconds a step; None takes the map's, the default experiment's, or a round one.
        start_values: numbers by variable, in the FMU's units, and texts of string variables; they
            win over the map's parameters.
        inputs: recorded inputs, by tag or variable.
        watch: further variables to record.
        kind: "co-simulation" or "model exchange"; None takes the first that is offered.
        speed: plant seconds a second; None runs as fast as it can.
        isolated: run the FMU in a process of its own.
        timeout: seconds that one step may take.
        master: of a system, "gauss-seidel" or "jacobi"; None takes its own.
        intermediate: a CSV for the outputs between the ends of a step; None for none.
        table: the rows go there as they are computed.
        load: a state file to begin from.
        save: a state file to write.
        save_at: the second at which it is written; None means the end.
    """

    stop: float | None = None
    step: float | None = None
    start_values: Mapping[str, StartValue] = field(default_factory=dict)
    inputs: InputSeries | None = None
    watch: tuple[str, ...] = ()
    kind: str | None = None
    speed: float | None = None
    isolated: bool = True
    timeout: float = 60.0
    master: Master | None = None
    intermediate: Path | None = None
    table: TableFile | None = None
    load: Path | None = None
    save: Path | None = None
    save_at: float | None = None
