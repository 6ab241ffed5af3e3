"""systemd hears what it wants to hear, over a real socket."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fieldlink.daemon import Notifier, supervised


@pytest.fixture(params=["path", "abstract"])
def systemd(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    """The service manager's end, and its address as systemd writes it."""
    name = str(tmp_path / "notify") if request.param == "path" else f"@fieldlink-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("\0" + name[1:] if name[0] == "@" else name)
        listener.setblocking(False)
        yield listener, name


async def hear(listener: socket.socket, wanted: str) -> dict[str, str]:
    async with asyncio.timeout(20.0):
        while True:
            data = await asyncio.get_running_loop().sock_recv(listener, 4096)
            fields = dict(line.split("=", 1) for line in data.decode().split("\n"))
            if wanted in fields:
                return fields


async def test_started_alive_and_stopping(
    systemd: tuple[socket.socket, str], device: Any, tmp_path: Path, live: Any
) -> None:
    listener, address = systemd
    notifier = Notifier({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "150000"})
    site = live.site_for(tmp_path, {"plc": device.port})
    async with live.plant_on(device), live.running(site) as daemon, supervised(daemon, notifier):
        ready = await hear(listener, "READY")
        assert "1 loops" in ready["STATUS"]
        for _ in range(3):
            alive = await hear(listener, "WATCHDOG")
        assert "store ok" in alive["STATUS"]
        # A part that hangs is named, and the watchdog is left hungry.
        daemon.stuck = lambda: ("device plc",)
        stuck = await hear(listener, "STATUS")
        while "stuck" not in stuck["STATUS"]:
            stuck = await hear(listener, "STATUS")
        assert stuck == {"STATUS": "stuck: device plc"}
    assert await hear(listener, "STOPPING") == {"STOPPING": "1"}


def test_a_watchdog_of_another_process_is_not_ours() -> None:
    settings = {"NOTIFY_SOCKET": "@x", "WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "1"}
    assert Notifier(settings).watchdog is None
    assert Notifier(settings | {"WATCHDOG_PID": str(os.getpid())}).watchdog == 3.0


def test_without_systemd_nothing_is_sent() -> None:
    notifier = Notifier({})
    assert not notifier.wanted
    notifier.send(READY=1)


async def test_a_daemon_whose_parts_hang_says_which(device: Any, tmp_path: Path, live: Any) -> None:
    site = live.site_for(tmp_path, {"plc": device.port})
    async with live.plant_on(device), live.running(site) as daemon:
        await live.until(lambda: daemon.status().loops["PLC"].counts.read >= 5, "samples")
        assert daemon.stuck() == ()
        daemon._devices.tasks["plc"]._turn -= 1000.0
        # Until its next turn, which comes at once here.
        assert daemon.stuck() == ("device plc",)
        await live.until(lambda: daemon.stuck() == (), "its turn")
