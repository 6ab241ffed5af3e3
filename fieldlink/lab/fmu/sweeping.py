"""A sweep as a table: one row a run, with its parameters, figures and, if wanted, signals."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from fieldlink.lab.fmu.errors import FmuError
from fieldlink.lab.fmu.experiment import choose_step, choose_stop, divide
from fieldlink.lab.fmu.recorder import check_ending, write_frame
from fmu_models import FmuSummary, Sweep, run_sweep

__all__ = ["plan_steps", "sweep_to_file"]


def plan_steps(fmu: FmuSummary, steps: int | None, step: float | None) -> tuple[int, float]:
    """Return number and seconds of the steps of a run, by the FMU's default experiment.

    Raises:
        FmuError: neither ``steps`` nor the FMU says how long a run is.
    """
    if steps is not None and (step is not None or fmu.step_size):
        period = step or fmu.step_size
        assert period is not None  # one of the two is there
        return steps, period
    stop = choose_stop(fmu, None)
    if steps is not None:
        return steps, (stop - fmu.start_time) / steps
    period, _note = choose_step(fmu, stop, step)
    return divide(fmu.start_time, stop, period, variable=False).count, period


def sweep_to_file(
    sweep: Sweep,
    file: Path,
    *,
    signals: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[tuple[int, str]]:
    """Run a sweep into a table; return number and error of the runs that failed.

    What is done is kept in ``FILE.journal`` until the table is complete; an interrupted sweep goes
    on from there.

    Args:
        sweep: the plan.
        file: the table, .csv or .parquet.
        signals: add the recorded signals as columns, each a list a run (Parquet only).
        workers: processes; None takes the machine's cores, 0 none.
        progress: called with the runs done and all of them.

    Raises:
        FmuError: the file cannot be written, or signals are wanted in a CSV file.
        PlantError: the plan does not fit the plant, or the journal is of another sweep.
    """
    if signals and file.suffix != ".parquet":
        raise FmuError(f"{file}: signals go into a file that ends in .parquet")
    check_ending(file)
    journal = file.with_name(f"{file.name}.journal")
    rows: list[dict[str, Any]] = []
    try:
        for run in run_sweep(
            sweep, journal=journal, workers=workers, keep_signals=signals, progress=progress
        ):
            rows.append(
                {"run": run.number, **run.parameters, **run.figures}
                | {"error": run.error or "", "ended": run.ended or ""}
                | {name: values.tolist() for name, values in run.signals.items()}
            )
    except OSError as error:
        raise FmuError(
            f"{journal}: the journal cannot be written: {error.strerror or error}"
        ) from error
    write_frame(pd.DataFrame(rows), file)
    journal.unlink()
    return [(row["run"], row["error"]) for row in rows if row["error"]]
