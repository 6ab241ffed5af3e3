"""A sweep as a table: one row a run, with its parameters, figures and, if wanted, signals."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from fieldlink.lab.fmu.errors import FmuError
from fieldlink.lab.fmu.recorder import write_frame
from fmu_models import Sweep, run_sweep

__all__ = ["sweep_to_file"]


def sweep_to_file(
    sweep: Sweep,
    file: Path,
    *,
    signals: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> int:
    """Run a sweep into a table; return how many runs failed.

    What is done is kept in ``FILE.journal`` until the table is complete; an interrupted sweep goes
    on from there.

    Args:
        sweep: the plan.
        file: the table, .csv or .parquet.
        signals: add the columns op, pv, sp and stem, each a list a run (Parquet only).
        workers: processes; None takes the machine's cores, 0 none.
        progress: called with the runs done and all of them.

    Raises:
        FmuError: the file cannot be written, or signals are wanted in a CSV file.
        PlantError: the plan does not fit the plant, or the journal is of another sweep.
    """
    if signals and file.suffix != ".parquet":
        raise FmuError(f"{file}: signals go into a file that ends in .parquet")
    if file.suffix not in (".csv", ".parquet"):
        raise FmuError(f"{file}: name a file that ends in .csv or .parquet")
    journal = file.with_name(f"{file.name}.journal")
    rows: list[dict[str, Any]] = []
    try:
        for run in run_sweep(
            sweep, journal=journal, workers=workers, keep_signals=signals, progress=progress
        ):
            rows.append(
                {"run": run.number, **run.parameters, **run.figures, "error": run.error or ""}
                | {name: values.tolist() for name, values in run.signals.items()}
            )
    except OSError as error:
        raise FmuError(f"{journal}: the journal cannot be written: {error}") from error
    write_frame(pd.DataFrame(rows), file)
    journal.unlink()
    return sum(bool(row["error"]) for row in rows)
