"""A whole site for a browser: simulated PLC, daemon and pages, each in a process of its own."""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import httpx
import pytest

from fieldlink.lab.demo.plc_process import PlcProcess
from fieldlink.lab.demo.site_files import simulated_scene

PATIENCE = 300.0
"""Seconds for what happens by itself on a machine that has other work."""

DEAD = """
[devices.dead]
link = "modbus-tcp"
host = "127.0.0.1"
port = {closed}
register_map = "registers.csv"
timeout = 0.2

[loops.{name}]
device = "dead"
op = "FC101.OP"
pv = "FC101.PV"
period = 1.0
"""


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


class Program:
    """A ``fieldlink`` command that runs until it is ended."""

    def __init__(self, *arguments: object) -> None:
        self._log = tempfile.TemporaryFile("w+")  # noqa: SIM115  (closed by end)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "fieldlink.cli", *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )

    def line(self) -> str:
        """The next line that it prints."""
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE)
        assert ready, "the program printed nothing"
        return self.process.stdout.readline()

    def end(self, how: signal.Signals = signal.SIGTERM) -> str:
        """End it; return what it has logged."""
        if self.process.poll() is None:
            self.process.send_signal(how)
        self.process.communicate(timeout=PATIENCE)
        with self._log:
            self._log.seek(0)
            return self._log.read()


class LiveSite:
    """A sticky loop under an MPC with compensator, a device that is not there, and the daemon."""

    def __init__(self, folder: Path) -> None:
        scene = simulated_scene(folder, seed=1)
        scene.write(502)
        self.plc = PlcProcess(scene.file, scene.loop)
        self.site = scene.write(self.plc.start())
        self.port = free_port()
        text = scene.file.read_text().replace("[web]\nport = 0", f"[web]\nport = {self.port}")
        scene.file.write_text(text + DEAD.format(closed=free_port(), name="'LIC <b>7</b>'"))
        self.file = scene.file
        self.address = f"http://127.0.0.1:{self.port}"
        self.daemon = Program("run", self.file)

    @property
    def token(self) -> str:
        return (self.site.data_dir / "operator-token").read_text().strip()

    def get(self, path: str) -> dict[str, object]:
        found: dict[str, object] = httpx.get(self.address + path, timeout=PATIENCE).json()
        return found

    def wait_for_page(self) -> None:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            try:
                if httpx.get(self.address + "/api/loops", timeout=5.0).status_code == 200:
                    return
            except httpx.TransportError:
                pass
            time.sleep(0.1)
        pytest.fail("the page never answered")

    def kill_daemon(self) -> None:
        self.daemon.end(signal.SIGKILL)

    def start_daemon(self) -> None:
        self.daemon = Program("run", self.file)

    def close(self) -> None:
        self.daemon.end()
        self.plc.close()
