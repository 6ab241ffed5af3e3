"""What tests of a live daemon share: a plant in a fake device, sites for it, running daemons."""

from __future__ import annotations

import asyncio
import struct
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fieldlink.daemon import Daemon, PoolSettings
from fieldlink.daemon.estimation.fork_server import worker_context
from fieldlink.daemon.estimation.pool import EstimatorPool, _nothing
from fieldlink.site import Site, load_site
from fieldlink.store import HistorianSettings

STORE = HistorianSettings(linger=0.02)
# What is tested must not depend on how much a busy machine leaves to what stands back.
POOL = PoolSettings(workers=1, limit=600.0, stands_back=False)
PERIOD_WALL = 0.02
PATIENCE, PATIENCE_OF_WRITERS = 60.0, 4.0
"""Seconds: a busy machine must not look like a silent device; what a heartbeat has to wait for is
bounded by the rules of the site file."""
MAP = """tag,table,address,type
OP,holding,0,float32
PV,holding,2,float32
SCAN,holding,4,uint16
"""


class UnrehearsedPool(EstimatorPool):
    """Its workers load a kernel when a window needs it, not all of them beforehand.

    The rehearsal takes three seconds of a processor for each daemon that a test starts, and most
    judge no window or one. `test_pool` and the tests of whole commands rehearse.
    """

    def __init__(self, settings: PoolSettings) -> None:
        super().__init__(settings, prepare=_nothing)


@cache
def load_fork_server() -> None:
    """Begin the fork server of this process, with kernels loaded once for the workers it forks.

    A daemon that stops while its first worker waits for that ends the server: the next one would
    begin again.
    """
    context = worker_context()
    known = ["fieldlink.daemon.estimation.worker_imports", "tests.daemon.loaded_kernels"]
    context.set_forkserver_preload(known)
    process = context.Process(target=_nothing)  # type: ignore[attr-defined]
    process.start()
    process.join()
    process.close()


@contextmanager
def unrehearsed_pools() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fieldlink.daemon.estimation.judging.EstimatorPool", UnrehearsedPool)
        yield


class Plant:
    """A sticky loop in a fake device: OP ramps up and down, PV follows the stem."""

    def __init__(self, device: Any, plc: Any | None = None) -> None:
        self.device = device
        self.plc = plc
        self.cycle = 0
        self.stem = 50.0
        self.pv = 50.0
        self._rng = np.random.default_rng(3)

    def step(self) -> None:
        op = 50.0 + 6.0 * abs((self.cycle / 40.0) % 2.0 - 1.0)
        if op - self.stem > 2.5:
            self.stem = op - 1.5
        elif self.stem - op > 2.5:
            self.stem = op + 1.5
        pv = self.pv + 0.02 * self._rng.standard_normal()
        self.pv += 0.3 * (self.stem - self.pv)
        self.cycle += 1
        self.device.words[0:5] = [
            *struct.unpack(">2H", struct.pack(">f", op)),
            *struct.unpack(">2H", struct.pack(">f", pv)),
            self.cycle & 0xFFFF,
        ]
        if self.plc is not None:
            self.plc.scan()

    async def run(self) -> None:
        deadline = time.monotonic()
        while True:
            self.step()
            # A machine that stands still for a moment holds up the plant, too: no cycle is made up
            # for, which a poll could not have seen.
            now, deadline = time.monotonic(), deadline + PERIOD_WALL
            if deadline < now + 0.5 * PERIOD_WALL:
                deadline = now + PERIOD_WALL
            await asyncio.sleep(deadline - now)


@asynccontextmanager
async def plant_on(device: Any, plc: Any | None = None) -> AsyncIterator[Plant]:
    plant = Plant(device, plc)
    plant.step()
    task = asyncio.create_task(plant.run())
    try:
        yield plant
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def site_for(
    folder: Path,
    ports: dict[str, int],
    loop_extra: str = "",
    timeout: float | None = None,
    **loop: Any,
) -> Site:
    """Write and load a site; each device has one loop, named like it in capitals."""
    if timeout is None:
        timeout = PATIENCE_OF_WRITERS if "writeback" in loop_extra else PATIENCE
    keys = {"period": 1.0, "window": 50, "estimate_every": 20.0} | loop
    parts = ['[site]\nname = "test"\n']
    for name, port in ports.items():
        parts.append(
            f'[devices.{name}]\nlink = "modbus-tcp"\nhost = "127.0.0.1"\nport = {port}\n'
            f'register_map = "map.csv"\ntimeout = {timeout}\nspeed = {1.0 / PERIOD_WALL}\n'
            f'[loops.{name.upper()}]\ndevice = "{name}"\nop = "OP"\npv = "PV"\nscan = "SCAN"\n'
            + "".join(f"{key} = {value}\n" for key, value in keys.items())
            + loop_extra.replace("LOOP", name.upper())
        )
    (folder / "map.csv").write_text(MAP)
    (folder / "site.toml").write_text("\n".join(parts))
    return load_site(folder / "site.toml")


@asynccontextmanager
async def running(site: Site, **options: Any) -> AsyncIterator[Daemon]:
    daemon = Daemon(site, store=STORE, pool=POOL, **options)
    stop = asyncio.Event()
    await asyncio.to_thread(load_fork_server)
    with unrehearsed_pools():
        task = asyncio.create_task(daemon.run(stop=stop))
        try:
            yield daemon
            stop.set()
            await task
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


async def until(condition: Callable[[], bool], what: str, tries: int = 30_000) -> None:
    for _ in range(tries):
        if condition():
            return
        await asyncio.sleep(0.01)
    pytest.fail(f"never happened: {what}")
