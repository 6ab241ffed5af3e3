"""How fast the plants are, and what isolation and pacing cost.

    python -m benchmarks.fmu [--seconds 60] [--beside CHECKOUT] [--out docs/benchmarks]

1. Lockstep: a plant with its controller inside, windows of 1,000 samples collected as an estimator
   takes them, isolated and in this process; beside it the simulated PLC, whose controller and
   registers stand between every two samples, and the same in batches (`BatchedPlc`: PLC and plants
   in one process of their own). One core (pinned where the system can). With --beside a second
   checkout of this project is measured in turn with this one, each the best of three, so that the
   load of the machine is the same for both.
2. The link over a bare loop of FMPy in the same process, alternating, FMI 2 and FMI 3.
3. 64 isolated plants behind one served PLC at a scan of 1 s: processor time and memory of the PLC
   and all its plants (proportional set size) over --seconds.
4. `physical` against the same model that takes every step of its grid of 0.1 ms: 72 runs with OP
   given (four S, two J, three lags of the actuator; a walk, steps, a wave), and when two closed
   loops begin to differ: their cycle is chaotic, so the reference also differs from a run of its
   own that begins 1e-12 % off.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import fmpy
import psutil
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from benchmarks.physical_grid import compare_grids
from benchmarks.report import heading, keep, machine, table
from benchmarks.second_checkout import measure_in_turn
from fieldlink.lab.plc import BatchedPlc, VirtualPlc
from fieldlink.site import load_site
from fmu_models import collect_windows, fmu_path, open_plant

__all__ = ["main"]

_PLANTS = 64
_SCANS = "example1 in the simulated PLC, PI and registers between samples"
_SITE_HEAD = """
[site]
name = "bench"
data_dir = "data"
[devices.plc]
link = "{link}"
{host}unit = 1
register_map = "map.csv"
"""
_LOOP = """
[loops.L{number}]
device = "plc"
op = "L{number}.OP"
pv = "L{number}.PV"
period = 1.0
window = 200
estimate_every = 100.0
[loops.L{number}.plant]
fmu = "{fmu}"
controller = "pi"
pi = {{ gain = 0.8, integral_time = 10.0 }}
seed = {number}
setpoint = [[0.0, 50.0]]
"""


def _write_site(folder: Path, count: int, *, served: bool) -> Path:
    host = 'host = "127.0.0.1"\nport = 15020\nspeed = 1.0\n' if served else ""
    link = "modbus-tcp" if served else "fmu"
    text = _SITE_HEAD.format(link=link, host=host)
    rows = ["tag,table,address,type"]
    for number in range(count):
        text += _LOOP.format(number=number, fmu="example1")
        rows += [f"L{number}.OP,holding,{4 * number},float32"]
        rows += [f"L{number}.PV,holding,{4 * number + 2},float32"]
    (folder / "map.csv").write_text("\n".join(rows) + "\n")
    site = folder / "site.toml"
    site.write_text(text)
    return site


def _rate(action: Callable[[int], object], samples: int, repeats: int = 5) -> float:
    """Samples per second of ``action(samples)``: the best of some runs."""
    best = float("inf")
    for _ in range(repeats):
        begun = time.perf_counter()
        action(samples)
        best = min(best, time.perf_counter() - begun)
    return samples / best


def _collected(name: str, isolated: bool) -> float:
    parameters = {"controller": 1, "op_start": 40.0}
    with open_plant(name, parameters=parameters, isolated=isolated) as plant:
        windows = collect_windows(plant, 1000)

        def collect(samples: int) -> None:
            for _ in range(samples // 1000):
                next(windows)

        return _rate(collect, 40_000)


def _lockstep() -> list[list[Any]]:
    rows: list[list[Any]] = []
    for name in ("example1", "flow", "heat", "ph", "physical"):
        samples = [_collected(name, isolated) for isolated in (True, False)]
        rows.append([f"{name}, controller inside", *samples])
    with tempfile.TemporaryDirectory() as folder:
        site = load_site(_write_site(Path(folder), 1, served=False))
        scans = []
        for isolated in (True, False):
            with VirtualPlc(site, "plc", isolated=isolated) as plc:
                scans.append(_rate(lambda n, plc=plc: [plc.scan() for _ in range(n)], 2000, 3))
        with BatchedPlc(site, "plc") as batched:
            tags = ["L0.OP", "L0.PV"]
            in_batches = _rate(lambda n: batched.record(n, tags), 10_000, 3)
    rows.append([_SCANS, *scans])
    rows.append(["the same in batches, registers read after every sample", in_batches, math.nan])
    return rows


def _bare(version: int, folder: Path) -> Callable[[int], None]:
    """FMPy's own calls, nothing else: set OP, step, get PV, stem and the OP as applied."""
    file = fmu_path("example1", 2 if version == 2 else 3)
    description = fmpy.read_model_description(str(file))
    fmpy.extract(str(file), str(folder))
    kind = FMU2Slave if version == 2 else FMU3Slave
    fmu = kind(
        guid=description.guid,
        modelIdentifier=description.coSimulation.modelIdentifier,
        unzipDirectory=str(folder),
        instanceName="bare",
    )
    fmu.instantiate()
    if version == 2:
        fmu.setupExperiment()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    reference = {v.name: v.valueReference for v in description.modelVariables}
    inputs, outputs = [reference["op"]], [reference[n] for n in ("pv", "stem", "op_out")]
    put, get = (fmu.setReal, fmu.getReal) if version == 2 else (fmu.setFloat64, fmu.getFloat64)
    clock = [0]

    def loop(samples: int) -> None:
        for k in range(samples):
            put(inputs, [50.0 + k % 7])
            fmu.doStep(float(clock[0]), 1.0)
            clock[0] += 1
            get(outputs)

    return loop


def _overhead(version: int) -> dict[str, float]:
    """Median over alternating runs of the time of our ways over that of the bare loop."""
    ratios: dict[str, list[float]] = {"step": [], "run": []}
    samples = 5000
    with (
        tempfile.TemporaryDirectory() as folder,
        open_plant(fmu_path("example1", 2 if version == 2 else 3), isolated=False) as plant,
    ):
        bare = _bare(version, Path(folder))
        column = [50.0 + k % 7 for k in range(samples)]

        def steps(count: int) -> None:
            for k in range(count):
                plant.step({"op": 50.0 + k % 7})

        for _ in range(15):
            reference = _rate(bare, samples, 1)
            ratios["step"].append(reference / _rate(steps, samples, 1))
            ratios["run"].append(
                reference / _rate(lambda n: plant.run(n, {"op": column}), samples, 1)
            )
    return {name: statistics.median(values) for name, values in ratios.items()}


def _family(process: psutil.Process) -> list[psutil.Process]:
    return [process, *process.children(recursive=True)]


def _spent(processes: Sequence[psutil.Process]) -> float:
    return sum(times.user + times.system for times in (p.cpu_times() for p in processes))


def _served(seconds: float) -> dict[str, float]:
    """Cores used, and memory, of a served PLC with its plants."""
    with tempfile.TemporaryDirectory() as folder:
        site = _write_site(Path(folder), _PLANTS, served=True)
        command = [sys.executable, "-m", "fieldlink.cli", "plant", str(site), "--port", "0"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
            assert program.stdout is not None
            line = program.stdout.readline()
            if not line.startswith("serving"):
                raise SystemExit(f"the PLC did not start: {line!r}")
            try:
                time.sleep(3.0)
                family = _family(psutil.Process(program.pid))
                before, begun = _spent(family), time.monotonic()
                time.sleep(seconds)
                cores = (_spent(family) - before) / (time.monotonic() - begun)
                memory = sum(p.memory_full_info().pss for p in family)
            finally:
                program.terminate()
                tail = program.stdout.read()
    late = int(tail.split(" late")[0].split()[-1]) if " late" in tail else -1
    return {
        "processes": len(family),
        "cores": cores,
        "memory / MB": memory / 2**20,
        "scans late": late,
    }


def _ratios(rows: list[list[Any]]) -> list[str]:
    if not rows:
        return []
    head = ["plant, isolated", "here", "second checkout", "ratio"]
    return ["Samples per second of both checkouts, measured in turn:", table(head, rows)]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="seconds for which the PLC is served"
    )
    parser.add_argument("--beside", type=Path, help="folder of a second checkout to measure too")
    parser.add_argument("--out", type=Path, help="folder for the result")
    options = parser.parse_args(arguments)
    served = _served(options.seconds)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    lockstep = _lockstep()
    beside = [] if options.beside is None else measure_in_turn(options.beside, _SCANS)
    overhead = {version: _overhead(version) for version in (2, 3)}
    with tempfile.TemporaryDirectory() as folder:
        grids = compare_grids(Path(folder))
    text = "\n\n".join(
        [
            "Plant samples per second on one core, windows of 1,000 collected:",
            table(
                ["plant", "isolated", "in this process"],
                [
                    [name, *("" if math.isnan(r) else f"{round(r, -2):,.0f}" for r in rates)]
                    for name, *rates in lockstep
                ],
            ),
            *_ratios(beside),
            "Time of a sample over that of a bare FMPy loop, in this process (limit 1.3):",
            table(
                ["FMI", "one step at a time", "columns"],
                [[version, ratio["step"], ratio["run"]] for version, ratio in overhead.items()],
            ),
            f"{_PLANTS} isolated plants behind one served PLC at 1 s, {options.seconds:g} s long "
            "(limits 0.3 cores, 1,500 MB):",
            table(list(served), [list(served.values())]),
            "`physical` against every step of its grid (limit 1 % of S with OP given):",
            table(
                [
                    "S / %",
                    "lag / s",
                    "runs with OP given",
                    "largest difference of the stem / % of S",
                    "closed loop: 1 % of S apart at / s",
                    "the reference from itself / s",
                ],
                grids,
            ),
        ]
    )
    print(text)
    figures = {"lockstep": lockstep, "overhead": overhead, "served": served, "physical": grids}
    figures |= {"beside": beside, "machine": machine()}
    about = heading("fmu", __doc__, arguments)
    keep(options.out, "fmu", f"{about}\n\n{text}", figures)


if __name__ == "__main__":
    main()
