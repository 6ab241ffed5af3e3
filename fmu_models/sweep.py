"""Parameter sweeps and Monte Carlo over a plant or any FMU: many runs side by side, resumable.

    if __name__ == "__main__":          # in a script: the pool's processes import it again
        plan = Sweep("example1", steps=2000, grid={"stick_band": (4, 6, 8)}, runs=10)
        for run in run_sweep(plan, journal=Path("sweep.jsonl")):
            identify(run.signals["op"], run.signals["pv"], period=run.period)

What is done stands in the journal, one line a run; a run cut short is done again. Plants of the
catalogue run inside a pool of processes. Any other FMU runs isolated, each run in a process of its
own that threads wait for, so that a crash is the result of one run.
"""

from __future__ import annotations

import hashlib
import itertools
import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import (
    FIRST_COMPLETED,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .archive import parse_description, read_description
from .catalogue import fmu_path
from .errors import PlantEndedError, PlantError, PlantNameError, nearest
from .start_values import StartValue, list_texts, sort_start_values
from .stepping import open_plant
from .sweep_journal import SweepJournal
from .sweep_plan import Sweep
from .variables import VariableAccess
from .windows import collect_windows

__all__ = ["Sweep", "SweepRun", "run_sweep"]

_AHEAD = 4
"""Runs a worker that wait for it: enough to keep it busy, few to lose."""


@dataclass(frozen=True, slots=True)
class SweepRun:
    """One run of a sweep.

    Attributes:
        number: from 0.
        parameters: all that were set.
        period: seconds from sample to sample.
        signals: of a plant of the catalogue ``op`` (as applied), ``pv``, ``sp`` and ``stem`` by
            sample, aligned as a controller sees them: OP of a sample was computed from its PV. Of
            another FMU every output, the start included. Empty when they were not kept.
        figures: of a plant of the catalogue, without its first fifth: mean and standard deviation
            of PV, standard deviation of OP, travel and reversals of the stem per 100 samples. Of
            another FMU mean, standard deviation, lowest, highest and last value of every output.
        error: why it failed; None when it did not.
        ended: how the FMU ended the run before its last step; None when it did not.
    """

    number: int
    parameters: dict[str, StartValue]
    period: float
    signals: dict[str, NDArray[np.float64]]
    figures: dict[str, float]
    error: str | None
    ended: str | None


def run_sweep(
    sweep: Sweep,
    *,
    journal: Path | None = None,
    workers: int | None = None,
    keep_signals: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[SweepRun]:
    """Run a sweep and yield its runs in the order of their numbers.

    Args:
        sweep: the plan.
        journal: a file that keeps what is done; a second call with the same plan goes on from it.
        workers: processes; None takes the machine's cores, 0 runs in this process.
        keep_signals: yield (and keep in the journal) the signals too, not the figures alone.
        progress: called with the runs done and all of them.

    Raises:
        PlantNameError: a parameter does not exist.
        PlantInputError: the journal is of another sweep, or is not a journal.
    """
    # A wrong name is reported before any run begins; a stale FMU is built here, once.
    ours = sweep.plant is not None
    file = fmu_path(sweep.model) if ours else sweep.file
    description = parse_description(file) if ours else read_description(file, sweep.kind)[0]
    sweep = replace(sweep, whole=_check(sweep, description))
    plan = asdict(sweep) | {"keep": keep_signals}
    if not ours:
        plan["fmu"] = hashlib.sha256(file.read_bytes()).hexdigest()
    done = SweepJournal(journal, plan)
    for row in _in_order(sweep, done, workers, keep_signals, progress or (lambda *_: None)):
        signals = {name: np.array(values) for name, values in row["signals"].items()}
        yield SweepRun(**(row | {"signals": signals}))


def _check(sweep: Sweep, description: Any) -> tuple[str, ...]:
    """Refuse names that cannot be set; return those of whole numbers."""
    starts = sort_start_values(description, sweep.fixed)
    variables = VariableAccess(description, structural=starts.structural)
    known = (*variables.roles.parameters, *variables.structural, *list_texts(description))
    for name in (*sweep.grid, *sweep.random, *sweep.fixed):
        if name not in known:
            raise PlantNameError(f"{sweep.model} has no parameter {name!r}; {nearest(name, known)}")
        if name in sweep.random and name in list_texts(description):
            raise PlantNameError(f"{sweep.model}: {name!r} takes text, which cannot be drawn")
    return tuple(name for name in sweep.random if variables.is_whole(name))


def _in_order(
    sweep: Sweep,
    journal: SweepJournal,
    workers: int | None,
    keep: bool,
    progress: Callable[[int, int], None],
) -> Iterator[dict[str, Any]]:
    todo = iter([n for n in range(sweep.count) if n not in journal.rows])
    count = workers if workers is not None else os.cpu_count() or 1
    finished = len(journal.rows)
    progress(finished, sweep.count)
    if count == 0:
        for number in range(sweep.count):
            if number not in journal.rows:
                journal.add(_one(sweep, number, keep))
                finished += 1
                progress(finished, sweep.count)
            yield journal.take(number)
        return
    with _executor(sweep, count) as pool:
        running: set[Future[dict[str, Any]]] = set()
        try:
            for number in range(sweep.count):
                while number not in journal.rows:
                    for fresh in itertools.islice(todo, max(0, count * _AHEAD - len(running))):
                        running.add(pool.submit(_one, sweep, fresh, keep))
                    ready, running = wait(running, return_when=FIRST_COMPLETED)
                    for future in ready:
                        journal.add(future.result())
                        finished += 1
                        progress(finished, sweep.count)
                yield journal.take(number)
        finally:
            pool.shutdown(cancel_futures=True)


def _executor(sweep: Sweep, count: int) -> Executor:
    if sweep.plant is None:  # the threads wait for the processes of the isolated plants
        return ThreadPoolExecutor(count)
    context = multiprocessing.get_context("forkserver" if os.name == "posix" else "spawn")
    return ProcessPoolExecutor(count, mp_context=context)


def _one(sweep: Sweep, number: int, keep: bool) -> dict[str, Any]:
    """Do one run; a refusal of the plant is its result."""
    parameters = sweep.parameters(number)
    row: dict[str, Any] = {"number": number, "parameters": parameters, "error": None, "ended": None}
    try:
        done = _ours(sweep, parameters) if sweep.plant is not None else _any(sweep, parameters)
    except PlantError as error:
        period = sweep.period or (sweep.plant.period if sweep.plant is not None else 0.0)
        return row | {"error": str(error), "signals": {}, "figures": {}, "period": period}
    period, signals, figures, ended = done
    kept = {name: values.tolist() for name, values in signals.items()} if keep else {}
    return row | {"period": period, "figures": figures, "signals": kept, "ended": ended}


_Signals = dict[str, NDArray[np.float64]]
_Done = tuple[float, _Signals, dict[str, float], str | None]


def _ours(sweep: Sweep, parameters: Mapping[str, StartValue]) -> _Done:
    names = sweep.names
    with open_plant(
        sweep.model, parameters=parameters, watch=[names.sp], period=sweep.period, isolated=False
    ) as plant:
        signals = next(collect_windows(plant, sweep.steps, names))
        return plant.info.period, signals, _figures(signals), None


def _any(sweep: Sweep, parameters: Mapping[str, StartValue]) -> _Done:
    ended = None
    with open_plant(
        sweep.file,
        parameters=parameters,
        period=sweep.period,
        kind=sweep.kind,
        timeout=sweep.timeout,
    ) as plant:
        rows = {name: [np.array([value])] for name, value in plant.outputs().items()}
        try:
            for piece in plant.run_pieces(sweep.steps, {}):
                for name, values in piece.columns.items():
                    rows[name].append(values)
        except PlantEndedError as error:
            ended = str(error)
        period = plant.info.period
    signals = {name: np.concatenate(parts) for name, parts in rows.items()}
    figures: dict[str, float] = {}
    for name, values in signals.items():
        figures |= {
            f"{name}_mean": float(values.mean()),
            f"{name}_std": float(values.std()),
            f"{name}_min": float(values.min()),
            f"{name}_max": float(values.max()),
            f"{name}_last": float(values[-1]),
        }
    return period, signals, figures, ended


def _figures(signals: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    skip = signals["pv"].size // 5
    pv, op, stem = (signals[name][skip:] for name in ("pv", "op", "stem"))
    moves = np.diff(stem)
    moves = moves[moves != 0.0]
    hundreds = max(stem.size, 1) / 100.0
    return {
        "pv_mean": float(pv.mean()),
        "pv_std": float(pv.std()),
        "op_std": float(op.std()),
        "travel": float(np.abs(moves).sum() / hundreds),
        "reversals": float(np.count_nonzero(moves[1:] * moves[:-1] < 0.0) / hundreds),
    }
