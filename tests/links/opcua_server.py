"""The OPC UA server of node-opcua as a process; see tests/interop/node/opcua_server.js."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fieldlink.site import Site, load_site
from tests.upward.mosquitto import free_port

NODE = Path(__file__).resolve().parents[1] / "interop" / "node"


class OpcuaServer:
    """Started, killed, paused; holds what tests set."""

    def __init__(self, **options: Any) -> None:
        if shutil.which("node") is None or not (NODE / "node_modules" / "node-opcua").is_dir():
            pytest.skip("node-opcua is not installed (npm install --prefix tests/interop/node)")
        self.port = free_port()
        self.options = {"port": self.port} | options
        self.hello: dict[str, Any] = {}
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        self._process = await asyncio.create_subprocess_exec(
            "node",
            str(NODE / "opcua_server.js"),
            json.dumps(self.options),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=2**20,
        )
        self.hello = await self._answer()

    async def _answer(self) -> dict[str, Any]:
        assert self._process is not None
        assert self._process.stdout is not None
        while line := await asyncio.wait_for(self._process.stdout.readline(), 60.0):
            if line.startswith(b"{"):
                return dict(json.loads(line))
        pytest.fail("node-opcua ended")

    async def tell(self, **command: Any) -> list[int]:
        """Give a command; return the array's words after it."""
        assert self._process is not None
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(command).encode() + b"\n")
        return list((await self._answer())["words"])

    def pause(self) -> None:
        assert self._process is not None
        os.kill(self._process.pid, signal.SIGSTOP)

    def resume(self) -> None:
        assert self._process is not None
        os.kill(self._process.pid, signal.SIGCONT)

    async def kill(self) -> None:
        assert self._process is not None
        if self._process.returncode is None:
            self.resume()
            self._process.kill()
        await self._process.communicate()


def write_site(
    folder: Path,
    port: int,
    *,
    opcua: str = "",
    loop: str = "",
    rows: str = "",
    loops: int = 3,
    period: float = 0.2,
) -> Site:
    """Write and load a site whose loops are those of the server."""
    names = "".join(f"L{n}.OP,ns=1;s=L{n}.OP\nL{n}.PV,ns=1;s=L{n}.PV\n" for n in range(loops))
    (folder / "nodes.csv").write_text(f"tag,node\n{names}{rows}")
    parts = [
        '[site]\nname = "test"\n[devices.plc]\nlink = "opcua"\nhost = "127.0.0.1"\n'
        f'port = {port}\nregister_map = "nodes.csv"\ntimeout = 2.0\nretry_after_max = 0.05\n'
        f"[devices.plc.opcua]\n{opcua}\n"
    ]
    parts += [
        f'[loops.L{n}]\ndevice = "plc"\nop = "L{n}.OP"\npv = "L{n}.PV"\nperiod = {period}\n{loop}\n'
        for n in range(loops)
    ]
    (folder / "site.toml").write_text("\n".join(parts))
    return load_site(folder / "site.toml")


async def scan_until(link: Any, condition: Callable[[Any], bool], what: str) -> Any:
    """Scan until a condition holds and return that scan; ``what`` names it if it never does."""
    for _ in range(400):
        scan = await link.scan()
        if condition(scan):
            return scan
        await asyncio.sleep(0.02)
    pytest.fail(f"never happened: {what}; {scan.failures}")
