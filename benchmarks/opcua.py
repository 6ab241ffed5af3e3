"""100 loops over OPC UA from a foreign server: missed slots, wrong values, share of a core.

    python -m benchmarks.opcua [--loops 100] [--seconds 60] [--out FOLDER]

The server is node-opcua (tests/interop/node), a process of its own. With every step it sets OP of
loop n to k + n and PV to -(k + n) at one time, so that an OP and a PV of two moments or loops are
found; OP changes four times a second, so that a value of before is found too (stale). The daemon
runs with its store; no window is full, so that nothing but sampling is measured. In the runs with
a fault the server is paused for five seconds in the middle.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import signal
import socket
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmarks.report import heading, keep, table
from fieldlink.daemon import Daemon
from fieldlink.site import Site, load_site
from fieldlink.store import read_samples

NODE = Path(__file__).resolve().parents[1] / "tests" / "interop" / "node"
PAUSE = 5.0
"""Seconds for which the server is paused."""

STEP = 0.25
"""Seconds between two steps of the server: several in a period, so that a stale pair shows."""


def make_site(folder: Path, port: int, loops: int, mode: str) -> Site:
    """Return a site whose loops are those of the server, at 1 s."""
    folder.mkdir()
    rows = "".join(f"L{n}.OP,ns=1;s=L{n}.OP\nL{n}.PV,ns=1;s=L{n}.PV\n" for n in range(loops))
    (folder / "nodes.csv").write_text(f"tag,node\n{rows}")
    tables = "".join(
        f'[loops.L{n}]\ndevice = "plc"\nop = "L{n}.OP"\npv = "L{n}.PV"\nperiod = 1.0\n'
        for n in range(loops)
    )
    (folder / "site.toml").write_text(
        '[site]\nname = "bench"\n[devices.plc]\nlink = "opcua"\nhost = "127.0.0.1"\n'
        f'port = {port}\nregister_map = "nodes.csv"\ntimeout = 0.9\n[devices.plc.opcua]\n'
        f'mode = "{mode}"\n{tables}[web]\nenabled = false\n'
    )
    return load_site(folder / "site.toml")


async def drive(process: asyncio.subprocess.Process) -> None:
    """Step the server."""
    assert process.stdin is not None
    assert process.stdout is not None
    step = 0
    while True:
        step += 1
        process.stdin.write(json.dumps({"step": step}).encode() + b"\n")
        await process.stdout.readline()
        await asyncio.sleep(STEP)


async def pause(process: asyncio.subprocess.Process, after: float) -> None:
    """Stop the server for a while."""
    await asyncio.sleep(after)
    process.send_signal(signal.SIGSTOP)
    await asyncio.sleep(PAUSE)
    process.send_signal(signal.SIGCONT)


async def measure(
    folder: Path, loops: int, seconds: float, mode: str, *, fault: bool
) -> dict[str, Any]:
    """Run the daemon on the server; return its counts."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    process = await asyncio.create_subprocess_exec(
        "node",
        str(NODE / "opcua_server.js"),
        json.dumps({"port": port, "loops": loops}),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        limit=2**20,
    )
    assert process.stdout is not None
    await process.stdout.readline()
    driving = asyncio.create_task(drive(process))
    site = make_site(folder, port, loops, mode)
    daemon = Daemon(site)
    pausing: asyncio.Task[None] | None = None
    try:
        running = asyncio.create_task(daemon.run(duration=seconds))
        await daemon.started.wait()
        if fault:
            pausing = asyncio.create_task(pause(process, 0.4 * seconds))
        cpu, began = time.process_time(), time.monotonic()
        status = await running
        cpu, passed = time.process_time() - cpu, time.monotonic() - began
    finally:
        if pausing is not None:
            await pausing
        driving.cancel()
        with suppress(asyncio.CancelledError):
            await driving
        process.kill()
        await process.wait()
    samples = read_samples(site.historian_url)
    good = samples[samples["quality"] == 0]
    # A loop's PV is its OP with the other sign, at every moment; values before the first step too.
    wrong = int((good["op"] + good["pv"]).abs().gt(1e-9).sum())
    ordered = good.sort_values(["loop", "slot"])
    follows = (ordered["loop"] == ordered["loop"].shift()) & (ordered["slot"].diff() == 1)
    stale = int((follows & (ordered["op"].diff() == 0)).sum())
    counts = [loop.counts for loop in status.loops.values()]
    return {
        "expected": sum(found.expected for found in counts),
        "missed": sum(found.missed for found in counts),
        "bad": sum(found.bad for found in counts),
        "wrong": wrong,
        "stale": stale,
        "core_percent": 100.0 * cpu / passed,
        "latest_ms": 1000.0 * status.devices["plc"].lateness.largest,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--loops", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    found: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for mode in ("read", "subscribe"):
            for fault in (False, True):
                name = f"{mode}, server paused" if fault else mode
                found[name] = asyncio.run(
                    measure(Path(folder) / name, given.loops, given.seconds, mode, fault=fault)
                )
    columns = ["run", "slots", "missed", "bad", "wrong", "stale", "% of a core", "latest, ms"]
    rows = [
        [
            mode,
            f"{figures['expected']}",
            f"{figures['missed']}",
            f"{figures['bad']}",
            f"{figures['wrong']}",
            f"{figures['stale']}",
            f"{figures['core_percent']:.1f}",
            f"{figures['latest_ms']:.0f}",
        ]
        for mode, figures in found.items()
    ]
    text = f"{heading('opcua', __doc__, None)}\n\n{table(columns, rows)}"
    print(text)
    keep(given.out, "opcua", text, found)


if __name__ == "__main__":
    main()
