"""Keep a run as a system of FMUs (SSP 1.0) that repeats it, with its recordings inside."""

from __future__ import annotations

from pathlib import Path

from fieldlink.lab.fmu.recorder import RunResult
from fmu_models import FmuSummary, Master, RunExport, export_run

__all__ = ["export_system"]


def export_system(
    fmu: FmuSummary, result: RunResult, target: Path, master: Master | None = None
) -> None:
    """Write an ``.ssp`` that repeats a run, with ``run.csv`` and the recorded inputs inside.

    Args:
        fmu: what was run, without a map: tags have no place in a system.
        result: of the run.
        target: the file.
        master: that was asked for.

    Raises:
        PlantError: the file cannot be written.
    """
    table = result.frame()
    recordings = {"run.csv": table.to_csv(index=False).encode()}
    if result.inputs:
        inputs = table[["time", *result.inputs]]
        recordings["inputs.csv"] = inputs.to_csv(index=False).encode()
    run = RunExport(
        start_values=result.start_values,
        start=float(result.time[0]),
        stop=float(result.time[-1]),
        step=result.step,
        master=master,
        recordings=recordings,
    )
    export_run(fmu, target, run)
