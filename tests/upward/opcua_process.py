"""The process of the OPC UA server, given what to show by a test."""

from __future__ import annotations

import asyncio
import json
import shutil
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from fieldlink.opcua_server.serving import _end, _exchange

PROCESS = (
    sys.executable,
    "-P",
    "-c",
    "from fieldlink.opcua_server import process; process.NICENESS = 0; process.main()",
)
"""The server's process, but for its priority: behind the other tests it would be waited for."""
NODE = Path(__file__).resolve().parents[1] / "interop" / "node"

LOOP = {
    "AssetId": "FC101",
    "DeviceHealth": 4,
    "Verdict": "stiction",
    "Doubtful": False,
    "Score": 31.5,
    "StickBand": 2.5,
    "StickBandLow": 2.25,
    "StickBandHigh": 2.75,
    "StickBandLimit": 20.0,
    "SlipJump": 1.0,
    "SlipJumpLow": 0.5,
    "SlipJumpHigh": 1.5,
    "Confidence": 0.9,
    "TrendPerWeek": None,
    "DaysToLimit": None,
    "JudgedAt": 1_700_000_000.0,
    "Message": "",
    "Compensated": True,
    "BlockState": "in use",
    "BlockReason": "the PLC's controller uses the model",
    "BlockSequence": 7,
    "Device": "plc",
    "DataQuality": 0.99,
}
DEVICE = {
    "ComponentName": "plc",
    "DeviceHealth": 1,
    "State": "demoted",
    "Reason": "no answer",
    "Address": "127.0.0.1:502",
    "Requests": 12,
    "MissedSamples": 3,
}
SETTINGS = {
    "site": "test",
    "version": "1",
    "host": "127.0.0.1",
    "port": 0,
    "application_uri": "urn:fieldlink:server",
    "cert": None,
    "key": None,
    "trusted": [],
    "username": None,
    "password": None,
    "max_clients": 5,
}


class Served:
    """A running process."""

    def __init__(self, process: asyncio.subprocess.Process, port: int) -> None:
        self._process = process
        self.pid = process.pid
        self.port = port
        self.address = f"opc.tcp://127.0.0.1:{port}/fieldlink"

    async def show(self, loops: dict[str, Any], *, names: list[str] | None = None) -> int:
        """Show loops and one device; return the number of clients."""
        document = {
            "time": time.time(),
            "loops": {"names": names or list(loops), "changed": loops},
            "devices": {"names": ["plc"], "changed": {"plc": DEVICE}},
        }
        return int((await _exchange(self._process, document))["clients"])


@asynccontextmanager
async def served(**settings: Any) -> AsyncIterator[Served]:
    """Run the process; whatever its clients do, it writes nothing into the daemon's log."""
    pipe = asyncio.subprocess.PIPE
    with tempfile.TemporaryFile() as log:
        process = await asyncio.create_subprocess_exec(
            *PROCESS, stdin=pipe, stdout=pipe, stderr=log
        )
        try:
            answer = await _exchange(process, SETTINGS | settings)
            assert "port" in answer, answer
            yield Served(process, answer["port"])
        finally:
            await _end(process)
        log.seek(0)
        assert log.read().decode() == ""


async def look_from_outside(address: str, nodes: list[str]) -> dict[str, Any]:
    """What node-opcua sees of a server, and what it may not do there."""
    if shutil.which("node") is None or not (NODE / "node_modules" / "node-opcua").is_dir():
        pytest.skip("node-opcua is not installed (npm install --prefix tests/interop/node)")
    process = await asyncio.create_subprocess_exec(
        "node",
        str(NODE / "opcua_client.js"),
        json.dumps({"endpoint": address, "nodes": nodes}),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    out, error = await process.communicate()
    assert process.returncode == 0, error.decode()
    return dict(json.loads(out.splitlines()[-1]))
