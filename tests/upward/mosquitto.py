"""A real mosquitto as a process: started, killed, paused, full."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import socket
from pathlib import Path

import pytest

PROGRAM = shutil.which("mosquitto") or "/usr/sbin/mosquitto"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Mosquitto:
    """A broker on one port of the loopback interface, as often as it is started."""

    def __init__(self, folder: Path, extra: str = "", listener: str = "") -> None:
        if not Path(PROGRAM).exists():
            pytest.skip("mosquitto is not installed (Debian package mosquitto)")
        self.port = free_port()
        self.folder = folder
        self.config = folder / "mosquitto.conf"
        self.config.write_text(
            f"user root\nlistener {self.port} 127.0.0.1\n{listener}"
            f"{'' if 'password_file' in extra else 'allow_anonymous true'}\n{extra}\n"
        )
        self._starts = 0
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        with (self.folder / "mosquitto.log").open("ab") as log:
            self._process = await asyncio.create_subprocess_exec(
                PROGRAM, "-c", str(self.config), stdout=log, stderr=log
            )
        # Its log tells when it listens: a connection to find out would be counted as a client.
        self._starts += 1
        for _ in range(1000):
            if self.log.count(" running\n") == self._starts:
                return
            assert self._process.returncode is None, self.log
            await asyncio.sleep(0.01)
        pytest.fail(f"mosquitto does not listen: {self.log}")

    @property
    def log(self) -> str:
        return (self.folder / "mosquitto.log").read_text(errors="replace")

    async def kill(self) -> None:
        assert self._process is not None
        if self._process.returncode is None:
            os.kill(self._process.pid, signal.SIGCONT)
            self._process.kill()
        await self._process.wait()

    def reload(self) -> None:
        """Have it read its access rules again."""
        assert self._process is not None
        os.kill(self._process.pid, signal.SIGHUP)

    def pause(self) -> None:
        assert self._process is not None
        os.kill(self._process.pid, signal.SIGSTOP)

    def resume(self) -> None:
        assert self._process is not None
        os.kill(self._process.pid, signal.SIGCONT)
