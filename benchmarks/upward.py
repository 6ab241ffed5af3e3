"""What publishing costs, and what an outage of the broker does: 100 loops at 1 s.

    python -m benchmarks.upward [--seconds 3600] [--paced 20] [--out FOLDER]

A mosquitto of this machine is paused. The samples of ``--seconds`` plant seconds of 100 loops are
put, a second's worth at a time, the first ``--paced`` of them at the pace of a plant and the others
a hundred times faster. Then the broker goes on, and what waited is delivered as JSON and as
Sparkplug B. A consumer checks that every number comes, and in order. Meanwhile the event loop,
which is the daemon's too, ticks every 10 ms: how late the ticks are at the pace of a plant, with
the broker there and with the broker paused, is what publishing costs the sampling. A run that is
at the pace of a plant from end to end is kept as a page of its own, ``upward_at_plant_pace``.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import shutil
import signal
import socket
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.report import heading, keep, table
from fieldlink.site import Site, load_site
from fieldlink.store import SampleRecord
from fieldlink.upward import Publishing

LOOPS = 100
BEFORE = 20
"""Plant seconds at the pace of the clock before the outage, for comparison."""
FAST = 100
"""Plant seconds a second after that."""
TICK = 0.01
PROGRAM = shutil.which("mosquitto") or "/usr/sbin/mosquitto"


def make_site(folder: Path, port: int) -> Site:
    """Return a site of 100 loops that publishes samples."""
    (folder / "map.csv").write_text(
        "tag,table,address,type\nOP,holding,0,float32\nPV,holding,2,float32\n"
    )
    loops = "".join(
        f'[loops.L{n}]\ndevice = "plc"\nop = "OP"\npv = "PV"\nperiod = 1.0\n' for n in range(LOOPS)
    )
    (folder / "site.toml").write_text(
        '[site]\nname = "bench"\n[devices.plc]\nlink = "modbus-tcp"\nhost = "127.0.0.1"\n'
        f'register_map = "map.csv"\n{loops}[mqtt]\nhost = "127.0.0.1"\nport = {port}\n'
        'publish = ["samples"]\n'
    )
    (folder / "data").mkdir()
    return load_site(folder / "site.toml")


class Consumer:
    """Counts the JSON samples that the broker gives it, by number."""

    def __init__(self, port: int) -> None:
        from paho.mqtt import client as paho
        from paho.mqtt.enums import CallbackAPIVersion

        self.ids: list[int] = []
        self._client: Any = paho.Client(CallbackAPIVersion.VERSION2)
        self._client.on_message = lambda *args: self.ids.append(json.loads(args[2].payload)["id"])
        self._client.on_connect = lambda *_: self._client.subscribe("fieldlink/+/+/+/sample", 1)
        self._client.connect("127.0.0.1", port, keepalive=3600)
        self._client.loop_start()

    def end(self) -> None:
        """Leave."""
        self._client.disconnect()
        self._client.loop_stop()


def _ignore(*_: object, **__: object) -> None:
    """Take what a benchmark does not tell."""


async def tick(late: list[float]) -> None:
    """Note how late each tick of the event loop is, in seconds."""
    due = time.monotonic()
    while True:
        due += TICK
        await asyncio.sleep(max(0.0, due - time.monotonic()))
        late.append(time.monotonic() - due)
        due = max(due, time.monotonic() - TICK)


async def put(publishing: Publishing, first: int, seconds: int, pace: float) -> None:
    """Put the samples of all loops, second by second."""
    for second in range(first, first + seconds):
        utc_ms = round(1000.0 * time.time())
        for n in range(LOOPS):
            publishing.put(
                SampleRecord(f"L{n}", utc_ms, second, 50.0 + n, second + 0.001 * n, None, None, 0)
            )
        await asyncio.sleep(1.0 / pace)


async def until(condition: Callable[[], bool]) -> float:
    """Wait until the condition holds; return how many seconds that took."""
    began = time.monotonic()
    while not condition():  # noqa: ASYNC110
        await asyncio.sleep(0.05)
    return time.monotonic() - began


def percentiles(late: list[float]) -> list[str]:
    """Return median, 99th percentile and largest in milliseconds."""
    ordered = sorted(1000.0 * value for value in late)
    found = (statistics.median(ordered), ordered[int(0.99 * (len(ordered) - 1))], ordered[-1])
    return [f"{value:.1f}" for value in found]


async def measure(folder: Path, seconds: int, paced: int) -> tuple[str, dict[str, Any]]:
    """Return the page and its figures; ``paced`` seconds of the outage are at a plant's pace."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    config = folder / "mosquitto.conf"
    config.write_text(
        f"user root\nlistener {port} 127.0.0.1\nallow_anonymous true\nmax_queued_messages 0\n"
    )
    broker = subprocess.Popen([PROGRAM, "-c", str(config)], stderr=subprocess.DEVNULL)  # noqa: ASYNC220
    lateness: dict[str, list[float]] = {}
    try:
        await asyncio.sleep(1.0)
        consumer = Consumer(port)
        site = make_site(folder, port)
        states: dict[str, object] = {
            "devices": [{"name": "plc", "state": "good", "reason": "", "missed": 0}],
            "loops": dict.fromkeys(site.loops, "good"),
            "store_failing": False,
        }
        publishing = Publishing(
            site, health=lambda: states, actions={}, tell=_ignore, defect=_ignore
        )

        def done(count: int) -> bool:
            return all(found.delivered >= count for found in publishing.report().formats.values())

        async with publishing.running():
            await until(lambda: all(f.connected for f in publishing.report().formats.values()))
            late = lateness["broker there"] = []
            ticking = asyncio.create_task(tick(late))
            near = BEFORE
            await put(publishing, 0, near, 1.0)
            await until(lambda: done(LOOPS * near))
            ticking.cancel()
            os.kill(broker.pid, signal.SIGSTOP)
            late = lateness["broker paused"] = []
            ticking = asyncio.create_task(tick(late))
            await put(publishing, near, paced, 1.0)
            ticking.cancel()
            await put(publishing, near + paced, seconds - paced, FAST)
            await until(lambda: publishing.report().spooled == LOOPS * (near + seconds))
            if done(LOOPS * (near + seconds)):
                raise RuntimeError("the broker was not paused: nothing waits for it")
            size = sum(file.stat().st_size for file in (folder / "data").glob("mqtt_spool*"))
            os.kill(broker.pid, signal.SIGCONT)
            late = lateness["what waited is delivered"] = []
            ticking = asyncio.create_task(tick(late))
            drained = await until(lambda: done(LOOPS * (near + seconds)))
            ticking.cancel()
            report = publishing.report()
        total = LOOPS * (near + seconds)
        await until(lambda: len(set(consumer.ids)) >= total or not consumer.ids)
        consumer.end()
    finally:
        os.kill(broker.pid, signal.SIGCONT)
        broker.terminate()
        broker.wait()
    first_times = list(dict.fromkeys(consumer.ids))
    lines = [
        heading("upward", __doc__, None),
        "",
        table(
            ["figure", "value"],
            [
                ["samples put during the outage", f"{LOOPS * seconds}"],
                ["of these at the pace of a plant", f"{LOOPS * paced} in {paced} s"],
                ["spool on disk at its end", f"{1e-6 * size:.1f} MB"],
                ["samples lost", f"{total - len(set(consumer.ids)) + report.dropped}"],
                ["in order", "yes" if first_times == sorted(first_times) else "no"],
                ["received more than once", f"{len(consumer.ids) - len(first_times)}"],
                ["delivered after the outage in", f"{drained:.0f} s"],
                ["samples a second, both formats", f"{LOOPS * seconds / drained:.0f}"],
            ],
        ),
        "",
        "How late the event loop's ticks of 10 ms are, in ms:",
        "",
        table(
            ["while", "median", "99 %", "largest"],
            [[name, *percentiles(found)] for name, found in lateness.items()],
        ),
    ]
    figures = {
        "put": LOOPS * seconds,
        "paced_seconds": paced,
        "lost": total - len(first_times) + report.dropped,
        "megabytes": 1e-6 * size,
        "seconds_to_deliver": drained,
        "late_ms": {name: percentiles(found) for name, found in lateness.items()},
    }
    return "\n".join(lines), figures


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=int, default=3600)
    parser.add_argument(
        "--paced", type=int, default=20, help="seconds of the outage at the pace of a plant"
    )
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    if not 0 < given.paced <= given.seconds:
        parser.error("--paced must be at least 1 and at most --seconds")
    with tempfile.TemporaryDirectory() as folder:
        text, figures = asyncio.run(measure(Path(folder), given.seconds, given.paced))
    print(text)
    name = "upward" if given.paced < given.seconds else "upward_at_plant_pace"
    keep(given.out, name, text, figures)


if __name__ == "__main__":
    main()
