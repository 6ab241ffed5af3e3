from __future__ import annotations

import math
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Any

import pytest

import tests.daemon.live
from fieldlink.daemon.estimation.estimating import Findings, Interval
from fieldlink.registers import BlockReader, ExchangeLayout, ReaderState, Refusal
from loop_model import LoopModel, ProcessModel, ValveModel
from tests.daemon.bench import Bench, benches
from tests.links.fake_device import FakeDevice

LAYOUT = ExchangeLayout.at(100)


@pytest.fixture(scope="session")
def live() -> Any:
    """What the tests of the live daemon share: sites, plants, running daemons."""
    return tests.daemon.live


@pytest.fixture(autouse=True, scope="module")
def _unrehearsed() -> Iterator[None]:
    with tests.daemon.live.unrehearsed_pools():
        yield


@pytest.fixture
async def new_device() -> AsyncIterator[Callable[..., Any]]:
    made = []

    def make(**settings: Any) -> Any:
        device = FakeDevice(**settings)
        made.append(device)
        return device

    yield make
    for device in made:
        await device.stop()


@pytest.fixture
async def device(new_device: Callable[..., Any]) -> Any:
    running = new_device()
    await running.start()
    return running


class PlcProgram:
    """The PLC's side of the exchange, run on the words of a fake device."""

    def __init__(self, words: list[int], loop_id: int = 101) -> None:
        self.words = words
        self.reader = BlockReader(loop_id)
        self.now = 0.0
        self.state = ReaderState()
        self.refusal: Refusal | None = None
        words[LAYOUT.enable] = 1

    def scan(self, seconds: float = 1.0) -> ReaderState:
        self.now += seconds
        view = LAYOUT.view(lambda address, count: self.words[address : address + count])
        self.state = self.reader.scan(view, self.now)
        for address, word in self.state.reply(LAYOUT, self.refusal).items():
            self.words[address] = word
        return self.state


@pytest.fixture
def plc(device: Any) -> PlcProgram:
    return PlcProgram(device.words)


@pytest.fixture
def layout() -> ExchangeLayout:
    return LAYOUT


def _findings(
    stick_band: float = 7.0, slip_jump: float = 4.0, verdict: str = "stiction", **changes: Any
) -> Findings:
    valve = ValveModel(stick_band, slip_jump)
    process = ProcessModel(a=(-0.9,), b=(0.1,), dead_time=1, offset=0.5, period=1.0)
    values = {
        "verdict": verdict,
        "reasons": ("because",),
        "score": 30.0,
        "stick_band": Interval(stick_band, 0.98 * stick_band, 1.02 * stick_band),
        "slip_jump": Interval(slip_jump, 0.0, 1.2 * slip_jump),
        "static_friction": Interval(valve.static_friction, math.nan, math.nan),
        "dynamic_friction": Interval(valve.dynamic_friction, math.nan, math.nan),
        "confidence": 0.9,
        "r2": 0.95,
        "criterion": "oe",
        "samples": 800,
        "seconds": 0.1,
        "model": LoopModel(valve, process) if verdict == "stiction" else None,
        "document": {"verdict": verdict},
    }
    return Findings(**values | changes)


@pytest.fixture
def findings() -> Callable[..., Findings]:
    return _findings


@pytest.fixture
async def bench(
    device: Any, plc: PlcProgram, layout: ExchangeLayout
) -> AsyncIterator[Callable[..., Bench]]:
    async with benches(device, plc, layout) as make:
        yield make
