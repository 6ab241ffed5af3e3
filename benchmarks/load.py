"""Five hundred loops at one second: processor, memory, lateness and missed samples of the daemon.

    python -m benchmarks.load                   # a minute of each layout, beside a busy estimator
    python -m benchmarks.load --minutes 10
    python -m benchmarks.load --minutes 1 --browsers 5 --opcua-clients 5

Two layouts: one PLC with 500 loops, and 50 PLCs with 10 loops each. PLC, daemon and estimator are
processes of their own. The measurement begins when the windows are full, so that the estimator's
pool has more to do than it can: 500 windows wait all the time.

The daemon runs with the priority that the systemd unit gives it, and the PLC, which stands for
another machine, with a higher one, where the system allows that (root does). What else the machine
had to do is in the table: its load, of which one is the estimator's.

With ``--browsers`` or ``--opcua-clients`` each layout is measured twice in one run of one daemon:
first alone, then while so many real browsers (Chromium, on this machine, too) show its pages and so
many OPC UA clients watch all loops. That run is kept as a page of its own, ``load_watched``.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from benchmarks.load_plc import REGISTERS_A_LOOP
from benchmarks.report import heading, keep, machine, table
from fieldlink.store import read_estimates, read_samples, read_slots

__all__ = ["Load", "Watching", "main", "measure"]

WINDOW = 50
LAYOUTS = {"1 PLC x 500 loops": (1, 500), "50 PLCs x 10 loops": (50, 10)}
START = 20.0
"""Seconds for the daemon to start and for the estimator to load its kernels."""

DAEMON_NICENESS, PLC_NICENESS = -5, -10

TICKS = 100.0
"""Clock ticks a second in /proc (sysconf SC_CLK_TCK on Linux)."""


@dataclass(frozen=True)
class Load:
    """What one layout took; the fields are the table's columns. ``missed`` counts the whole run."""

    layout: str
    seconds: float
    daemon_core_share: float
    children_core_share: float
    daemon_mb: float
    all_mb: float
    late_p50_ms: float
    late_p99_ms: float
    late_max_ms: float
    samples: int
    missed: int
    windows_judged: int
    load_average: float
    load_max: float
    raised_priority: bool


@dataclass(frozen=True)
class Watching:
    """Who looks meanwhile."""

    browsers: int
    clients: int

    def __str__(self) -> str:
        return f"{self.browsers} browsers, {self.clients} OPC UA clients"


@dataclass(frozen=True)
class _Phase:
    """Figures of the processes, with watchers or without."""

    name: str
    since: datetime
    until: datetime
    seconds: float
    daemon_core_share: float
    children_core_share: float
    daemon_mb: float
    all_mb: float
    loads: list[float]


def measure(
    layout: str, seconds: float, folder: Path, watching: Watching | None = None
) -> list[Load]:
    """Run the daemon on a layout and measure it for ``seconds``; twice where somebody looks."""
    ports, loops = LAYOUTS[layout]
    plc = [sys.executable, "-m", "benchmarks.load_plc", str(ports), str(loops)]
    with _process(plc, stdout=subprocess.PIPE) as served:
        assert served.stdout is not None
        raised = _give_priority(served.pid, PLC_NICENESS)
        numbers = list(map(int, served.stdout.readline().split()))
        page, opcua = _free_port(), _free_port()
        site = _write_site(folder, numbers, loops, page, opcua if watching else None)
        log = (folder / "daemon.log").open("wb")
        command = [sys.executable, "-m", "fieldlink.cli", "run", str(site)]
        with log, _process(command, stdout=log, stderr=log) as daemon:
            raised &= _give_priority(daemon.pid, DAEMON_NICENESS)
            time.sleep(START + WINDOW)
            phases = [_measure_phase(layout, daemon.pid, seconds)]
            if watching is not None:
                looking = [sys.executable, "-m", "benchmarks.load_watchers"]
                looking += [f"http://127.0.0.1:{page}/", str(watching.browsers), str(opcua)]
                looking += [str(watching.clients)]
                with _process(looking, stdout=subprocess.PIPE) as watchers:
                    assert watchers.stdout is not None
                    if not watchers.stdout.readline():
                        raise RuntimeError("the browsers or OPC UA clients found no page")
                    name = f"{layout}, {watching}"
                    phases.append(_measure_phase(name, daemon.pid, seconds))
                    if watchers.poll() is not None:
                        raise RuntimeError("the browsers or OPC UA clients ended early")
            daemon.terminate()
            if daemon.wait(timeout=90) != 0:
                raise RuntimeError((folder / "daemon.log").read_text()[-3000:])
    return [_as_load(phase, f"sqlite:///{folder}/data/history.sqlite", raised) for phase in phases]


def _measure_phase(name: str, daemon: int, seconds: float) -> _Phase:
    since, begin = datetime.now(UTC), time.monotonic()
    before = {pid: _cpu(pid) for pid in _family(daemon)}
    own, everything, loads = [], [], []
    while time.monotonic() - begin < seconds:
        time.sleep(1.0)
        own.append(_pss(daemon))
        everything.append(sum(map(_pss, _family(daemon))))
        loads.append(os.getloadavg()[0])
    elapsed = time.monotonic() - begin
    spent = {pid: _cpu(pid) - start for pid, start in before.items()}
    return _Phase(
        name,
        since,
        datetime.now(UTC),
        elapsed,
        daemon_core_share=spent.pop(daemon) / elapsed,
        children_core_share=sum(spent.values()) / elapsed,
        daemon_mb=max(own),
        all_mb=max(everything),
        loads=loads,
    )


def _as_load(phase: _Phase, url: str, raised: bool) -> Load:
    samples = read_samples(url, since=phase.since, until=phase.until)
    late = samples["late_ms"].to_numpy(float)
    return Load(
        layout=phase.name,
        seconds=round(phase.seconds, 1),
        daemon_core_share=phase.daemon_core_share,
        children_core_share=phase.children_core_share,
        daemon_mb=phase.daemon_mb,
        all_mb=phase.all_mb,
        late_p50_ms=float(np.percentile(late, 50)),
        late_p99_ms=float(np.percentile(late, 99)),
        late_max_ms=float(late.max()),
        samples=len(samples),
        missed=int(read_slots(url)["missed"].sum()),
        windows_judged=len(read_estimates(url, since=phase.since, until=phase.until)),
        load_average=float(np.mean(phase.loads)),
        load_max=max(phase.loads),
        raised_priority=raised,
    )


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def _write_site(folder: Path, ports: list[int], loops: int, page: int, opcua: int | None) -> Path:
    rows = ["tag,table,address,type"]
    for i in range(loops):
        base = REGISTERS_A_LOOP * i
        rows += [f"L{i}.OP,holding,{base},float32", f"L{i}.PV,holding,{base + 2},float32"]
    (folder / "map.csv").write_text("\n".join(rows) + "\n")
    parts = [f'[site]\nname = "load"\n[web]\nport = {page}\n']
    if opcua is not None:
        parts.append(f"[opcua_server]\nport = {opcua}\n")
    for number, port in enumerate(ports):
        parts.append(
            f'[devices.plc{number}]\nlink = "modbus-tcp"\nhost = "127.0.0.1"\nport = {port}\n'
            'register_map = "map.csv"\n'
        )
        for i in range(loops):
            parts.append(
                f'[loops."P{number}L{i}"]\ndevice = "plc{number}"\nop = "L{i}.OP"\n'
                f'pv = "L{i}.PV"\nperiod = 1.0\nwindow = {WINDOW}\nestimate_every = 10.0\n'
            )
    site = folder / "site.toml"
    site.write_text("\n".join(parts))
    return site


@contextmanager
def _process(command: list[str], **options: object) -> Iterator[subprocess.Popen[bytes]]:
    # A session of its own, as every service has: Linux may share processors out by session.
    process = subprocess.Popen(command, start_new_session=True, **options)  # type: ignore[call-overload]
    try:
        yield process
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait(timeout=60)


def _give_priority(pid: int, niceness: int) -> bool:
    """Set a process's nice value, and that of its session's group where there are such groups."""
    try:
        os.setpriority(os.PRIO_PROCESS, pid, niceness)
    except PermissionError:
        return False
    with suppress(FileNotFoundError):
        Path(f"/proc/{pid}/autogroup").write_text(f"{niceness}\n")
    return True


def _family(pid: int) -> list[int]:
    """A process and all its descendants that are there now."""
    found, rest = [], [pid]
    while rest:
        one = rest.pop()
        found.append(one)
        for task in Path(f"/proc/{one}/task").glob("*/children"):
            rest.extend(map(int, task.read_text().split()))
    return found


def _cpu(pid: int) -> float:
    """Seconds of processor time, system calls included."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / TICKS


def _pss(pid: int) -> float:
    """Megabytes of memory; what processes share is counted once among them."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return next(int(line.split()[1]) / 1000.0 for line in lines if line.startswith("Pss:"))


def main() -> None:
    """Run the benchmark, print its table, and store it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument(
        "--minutes", type=float, default=1.0, help="minutes measured for each layout"
    )
    parser.add_argument("--layout", choices=LAYOUTS, default=None, help="measure this layout only")
    parser.add_argument("--out", type=Path, default=None, help="folder for Markdown and JSON")
    parser.add_argument(
        "--browsers", type=int, default=0, help="browsers on the pages in a second phase"
    )
    parser.add_argument(
        "--opcua-clients", type=int, default=0, help="OPC UA clients in the second phase"
    )
    options = parser.parse_args()
    watching = None
    if options.browsers or options.opcua_clients:
        watching = Watching(options.browsers, options.opcua_clients)
    loads = []
    for layout in LAYOUTS if options.layout is None else [options.layout]:
        with tempfile.TemporaryDirectory() as folder:
            loads += measure(layout, 60.0 * options.minutes, Path(folder), watching)
    text = as_table(loads)
    print(text)
    page = heading("load", __doc__, None) + "\n\n" + text
    name = "load" if watching is None else "load_watched"
    keep(options.out, name, page, {"loads": [vars(load) for load in loads], "machine": machine()})


def as_table(loads: Sequence[Load]) -> str:
    """Return a column a layout."""
    names = list(vars(loads[0]))
    return table(
        ("", *(load.layout for load in loads)),
        [(name.replace("_", " "), *(getattr(load, name) for load in loads)) for name in names[1:]],
    )


if __name__ == "__main__":
    main()
