"""A broker, a tap before it, and what publishes to it."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from fieldlink.links.backoff import BackoffSettings
from fieldlink.site import Site, load_site
from fieldlink.store import EstimateRecord, EventRecord, FindingRecord, Record, SampleRecord
from fieldlink.upward import Publishing, broker, connections, delivery, publishing
from tests.upward.mosquitto import Mosquitto
from tests.upward.wiretap import WireTap

SITE = """
[site]
name = "mill 4"
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
register_map = "map.csv"
[devices.other]
link = "modbus-tcp"
host = "127.0.0.1"
port = 503
register_map = "map.csv"
[loops.FC101]
device = "plc"
area = "U1/east"
op = "OP"
pv = "PV"
period = 1.0
[loops.FC102]
device = "other"
op = "OP"
pv = "PV"
period = 1.0
[mqtt]
host = "127.0.0.1"
port = {port}
publish = ["estimates", "writebacks", "events", "findings", "health", "samples"]
"""
START = round(1000.0 * time.time())


def sample(loop: str, number: int, **changes: Any) -> SampleRecord:
    """A sample whose PV tells its number."""
    values = {"op": -1.0, "pv": float(number), "sp": None, "auto": None, "quality": 0}
    return SampleRecord(loop, START + 1000 * number, number, **values | changes)


def verdict(loop: str, stick_band: float) -> EstimateRecord:
    return EstimateRecord(
        loop, START, START, 0, 799, "estimated", "a reason", "stiction", 30.0, stick_band
    )


def finding(state: str, loop: str = "FC101") -> FindingRecord:
    return FindingRecord(
        "F-7", START, START, state, "sticky_valve", loop, ("FC101", "FC102"), 88.0, 0.9, "seen"
    )


def event(kind: str, source: str, message: str) -> EventRecord:
    return EventRecord(START, kind, source, message)


@dataclass
class Bench:
    """A running `Publishing` with its health, its events and its commands."""

    site: Site
    publishing: Publishing = field(init=False)
    puts: int = 0
    events: list[tuple[str, str, str]] = field(default_factory=list)
    commands: list[tuple[str, str, str]] = field(default_factory=list)
    states: dict[str, str] = field(default_factory=lambda: {"plc": "good", "other": "good"})

    def __post_init__(self) -> None:
        self.publishing = Publishing(
            self.site,
            health=self.health,
            actions={
                name: lambda loop, why, name=name: self.commands.append((name, loop, why))
                for name in ("estimate_now", "withdraw")
            },
            tell=self.note_event,
            defect=self.note_defect,
        )

    def note_event(self, kind: str, source: str, message: str, *, bad: bool = False) -> None:
        self.events.append((kind, source, f"{'warning: ' if bad else ''}{message}"))

    def note_defect(self, source: str, error: Exception, consequence: str) -> None:
        self.events.append(("defect", source, f"{error!r}; {consequence}"))

    def health(self) -> dict[str, object]:
        return {
            "devices": [
                {"name": name, "state": state, "reason": "", "missed": 0}
                for name, state in self.states.items()
            ],
            "loops": {name: self.states[loop.device] for name, loop in self.site.loops.items()},
            "store_failing": False,
        }

    def kinds(self) -> list[str]:
        return [kind for kind, _, _ in self.events]

    def put(self, *records: Record) -> None:
        self.puts += len(records)
        for record in records:
            self.publishing.put(record)

    @property
    def waiting(self) -> int:
        """Messages that some format has not delivered yet."""
        formats = self.publishing.report().formats.values()
        return max(self.puts - found.delivered for found in formats)


@pytest.fixture(autouse=True)
def _short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """What takes seconds in a plant takes tenths of them here; nothing asserts how long."""
    # A busy machine must not look like a broker that is silent.
    monkeypatch.setattr(broker, "ANSWER_WITHIN", 60.0)
    monkeypatch.setattr(connections, "PATIENCE", BackoffSettings(first=0.02, cap=0.1))
    monkeypatch.setattr(delivery, "HEALTH_EVERY", 0.05)
    monkeypatch.setattr(publishing, "LINGER", 0.01)
    monkeypatch.setattr(publishing, "TRIM_EVERY", 0.0)
    monkeypatch.setattr(publishing, "TRY_DISK_EVERY", 0.05)


@pytest.fixture
async def broker_process(tmp_path: Path) -> AsyncIterator[Mosquitto]:
    running = Mosquitto(tmp_path)
    await running.start()
    yield running
    await running.kill()


@pytest.fixture
async def tap(broker_process: Mosquitto) -> AsyncIterator[WireTap]:
    running = WireTap(broker=broker_process.port)
    await running.start()
    yield running
    await running.stop()


@pytest.fixture
def make_site(tmp_path: Path) -> Callable[..., Site]:
    def make(port: int, extra: str = "") -> Site:
        (tmp_path / "map.csv").write_text(
            "tag,table,address,type\nOP,holding,0,float32\nPV,holding,2,float32\n"
        )
        (tmp_path / "site.toml").write_text(SITE.format(port=port) + extra)
        (tmp_path / "data").mkdir(exist_ok=True)
        return load_site(tmp_path / "site.toml")

    return make


@pytest.fixture
def bench(make_site: Callable[..., Site]) -> Callable[..., AbstractAsyncContextManager[Bench]]:
    @asynccontextmanager
    async def run(port: int, extra: str = "") -> AsyncIterator[Bench]:
        found = Bench(make_site(port, extra))
        async with found.publishing.running() as tasks:
            yield found
            assert "defect" not in found.kinds(), found.events
            assert not any(task.done() for task in tasks)

    return run


async def until(condition: Callable[[], object], what: str, tries: int = 12_000) -> None:
    for _ in range(tries):
        if condition():
            return
        await asyncio.sleep(0.01)
    pytest.fail(f"never happened: {what}")


def documents(tap: WireTap, kind: str | None = None) -> list[dict[str, Any]]:
    """The JSON messages that passed the tap, in order; of one kind where it is given."""
    found = [
        json.loads(packet.payload)
        for connection in tap.of("-json")
        for packet in connection.published
        if packet.payload
    ]
    return [document for document in found if kind in (None, document.get("kind"))]
