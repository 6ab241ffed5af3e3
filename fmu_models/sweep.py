"""Parameter sweeps and Monte Carlo over a plant: many runs in a pool of processes, resumable.

    plan = Sweep("example1", steps=2000, grid={"stick_band": (2, 4, 8)}, runs=10)
    for run in run_sweep(plan, journal=Path("sweep.jsonl")):
        identify(run.signals["op"], run.signals["pv"], period=run.period)

Every run is decided by the plan and its number alone, so that it is the same in any order and after
a restart. What is done stands in the journal, one line a run; a run cut short is done again.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .archive import parse_description
from .catalogue import LoopVariables, catalogue, fmu_path
from .errors import PlantError, PlantInputError, PlantNameError, nearest
from .stepping import open_plant
from .variables import is_settable
from .windows import collect_windows

__all__ = ["Sweep", "SweepRun", "run_sweep"]

_AHEAD = 4
"""Runs a worker that wait for it: enough to keep it busy, few to lose."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """What to run.

    Attributes:
        model: a plant of the catalogue, with its controller inside.
        steps: of each run.
        grid: values to combine, by parameter.
        random: low and high of values drawn evenly, by parameter, anew for each run.
        fixed: parameters of every run; ``controller`` is 1 and the plant rests at OP 40 % at the
            start unless they say otherwise, so that a valve that sticks shows it soon.
        runs: for each point of the grid, each with a noise of its own.
        seed: of the whole sweep.
        loop: number of the loop that is recorded, from 0, where the plant has several.
    """

    model: str
    steps: int
    grid: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    random: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    runs: int = 1
    seed: int = 1
    loop: int = 0

    def __post_init__(self) -> None:
        if self.model not in catalogue:
            raise PlantNameError(
                f"the catalogue has no plant {self.model!r}; {nearest(self.model, catalogue)}"
            )
        if self.steps < 1 or self.runs < 1:
            raise PlantInputError(
                f"a sweep needs at least one step and one run; got {self.steps}, {self.runs}"
            )
        if not 0 <= self.loop < len(catalogue[self.model].loops):
            raise PlantInputError(
                f"{self.model} has {len(catalogue[self.model].loops)} loops; loop {self.loop} is "
                "none of them (the first is 0)"
            )
        for name, values in self.grid.items():
            if not values or not all(map(math.isfinite, values)):
                raise PlantInputError(f"{name}: give at least one finite value; got {values}")
        for name, (low, high) in self.random.items():
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise PlantInputError(f"{name}: give low <= high, finite; got {low}, {high}")
        twice = [n for n in (*self.random, *self.fixed) if n in self.grid]
        twice += [n for n in self.random if n in self.fixed]
        if twice:
            raise PlantInputError(f"{', '.join(twice)}: given more than once in the sweep")

    @property
    def count(self) -> int:
        """How many runs it has."""
        return math.prod(len(values) for values in self.grid.values()) * self.runs

    @property
    def names(self) -> LoopVariables:
        """The variables of the loop that is recorded."""
        return catalogue[self.model].loops[self.loop]

    def parameters(self, number: int) -> dict[str, float]:
        """Return the parameters of run ``number``, from 0."""
        point, _ = divmod(number, self.runs)
        values = next(itertools.islice(itertools.product(*self.grid.values()), point, None))
        draw = np.random.default_rng([self.seed, number])
        chosen: dict[str, float] = {"seed": float(1 + (self.seed * 1_000_003 + number) % 2**31)}
        for loop in catalogue[self.model].loops:
            chosen |= {loop.controller: 1.0, f"{loop.op}_start": 40.0}
        chosen |= self.fixed
        chosen |= zip(self.grid, map(float, values), strict=True)
        return chosen | {n: float(draw.uniform(*bounds)) for n, bounds in self.random.items()}


@dataclass(frozen=True, slots=True)
class SweepRun:
    """One run of a sweep.

    Attributes:
        number: from 0.
        parameters: all that were set.
        period: seconds from sample to sample.
        signals: ``op`` (as applied), ``pv``, ``sp`` and ``stem`` by sample, aligned as a controller
            sees them: OP of a sample was computed from its PV. Empty when they were not kept.
        figures: of the run without its first fifth: mean and standard deviation of PV, standard
            deviation of OP, travel and reversals of the stem per 100 samples.
        error: why it failed; None when it did not.
    """

    number: int
    parameters: dict[str, float]
    period: float
    signals: dict[str, NDArray[np.float64]]
    figures: dict[str, float]
    error: str | None


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
        PlantInputError: the journal is of another sweep, or is no journal.
    """
    # A wrong name is told before any process is started; a stale FMU is built here, once.
    description = parse_description(fmu_path(sweep.model))
    _check(sweep, {v.name for v in description.modelVariables if is_settable(v)})
    done = _Journal(journal, sweep, keep_signals)
    yield from _in_order(sweep, done, workers, keep_signals, progress or (lambda *_: None))


def _check(sweep: Sweep, known: set[str]) -> None:
    for name in (*sweep.grid, *sweep.random, *sweep.fixed):
        if name not in known:
            raise PlantNameError(f"{sweep.model} has no parameter {name!r}; {nearest(name, known)}")


def _in_order(
    sweep: Sweep,
    journal: _Journal,
    workers: int | None,
    keep: bool,
    progress: Callable[[int, int], None],
) -> Iterator[SweepRun]:
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
    context = multiprocessing.get_context("forkserver" if os.name == "posix" else "spawn")
    with ProcessPoolExecutor(count, mp_context=context) as pool:
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


def _one(sweep: Sweep, number: int, keep: bool) -> dict[str, Any]:
    """Do one run; a refusal of the plant is its result."""
    parameters = sweep.parameters(number)
    names = sweep.names
    row: dict[str, Any] = {"number": number, "parameters": parameters, "error": None}
    try:
        with open_plant(
            sweep.model, parameters=parameters, watch=[names.sp], isolated=False
        ) as plant:
            signals = next(collect_windows(plant, sweep.steps, names))
            row["period"] = plant.info.period
    except PlantError as error:
        period = catalogue[sweep.model].period
        return row | {"error": str(error), "signals": {}, "figures": {}, "period": period}
    row["figures"] = _figures(signals)
    row["signals"] = {name: values.tolist() for name, values in signals.items()} if keep else {}
    return row


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


class _Journal:
    """The runs that are done, in memory and, where there is a file, on disk."""

    def __init__(self, file: Path | None, sweep: Sweep, keep: bool) -> None:
        plan = json.dumps({**asdict(sweep), "keep": keep}, sort_keys=True)
        self._head = {"sweep": hashlib.sha256(plan.encode()).hexdigest(), "plan": json.loads(plan)}
        self._file = file
        self.rows: dict[int, dict[str, Any]] = {}
        if file is None:
            return
        if file.exists():
            self._read(file)
        else:
            file.write_text(json.dumps(self._head) + "\n", encoding="ascii")

    def _read(self, file: Path) -> None:
        lines = file.read_bytes().split(b"\n")
        try:
            head = json.loads(lines[0])
            known = head["sweep"]
        except (ValueError, KeyError, TypeError) as error:
            raise PlantInputError(f"{file}: it is no journal of a sweep; name another") from error
        if known != self._head["sweep"]:
            raise PlantInputError(
                f"{file}: it is the journal of another sweep; name another file, or remove it to "
                "begin anew"
            )
        whole = len(lines[0]) + 1
        for line in lines[1:-1]:  # the last has no end of line: empty, or cut short
            row = json.loads(line)
            self.rows[row["number"]] = row
            whole += len(line) + 1
        if lines[-1]:
            os.truncate(file, whole)

    def add(self, row: dict[str, Any]) -> None:
        self.rows[row["number"]] = row
        if self._file is not None:
            with self._file.open("a", encoding="ascii") as stream:
                stream.write(json.dumps(row) + "\n")

    def take(self, number: int) -> SweepRun:
        """Return a run; its signals are let go of here."""
        row = self.rows[number]
        self.rows[number] = {"number": number}
        signals = {name: np.array(values) for name, values in row["signals"].items()}
        return SweepRun(**(row | {"signals": signals}))
