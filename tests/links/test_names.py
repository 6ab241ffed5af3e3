"""Names of hosts that no name server knows cost nothing but their own devices."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from fieldlink.links import SystemClock
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.links.names import find_addresses
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device, Tls
from tests.links.fake_device import FakeDevice
from tests.links.patience import PATIENCE, SHORT
from tests.links.test_transports import secured, served, tls_device

TAGS = [Tag("level", Table.HOLDING, 0, DataType.UINT16)]


@dataclass
class Resolver:
    """Gives names that end in .test their address, and the others nothing until ``answers``."""

    known: dict[str, list[str]] = field(default_factory=dict)
    answers: threading.Event = field(default_factory=threading.Event)
    asked: list[str] = field(default_factory=list)
    real: Callable[..., Any] = socket.getaddrinfo

    def getaddrinfo(self, host: str, port: Any, *rest: Any, **more: Any) -> list[Any]:
        if not str(host).endswith(".test"):
            return self.real(host, port, *rest, **more)
        self.asked.append(host)
        if host not in self.known:
            self.answers.wait()
        if not self.known.get(host):
            raise socket.gaierror(socket.EAI_AGAIN, "Temporary failure in name resolution")
        return [
            place
            for address in self.known[host]
            for place in self.real(address, port, *rest, **more)
        ]


@pytest.fixture
def resolver(monkeypatch: pytest.MonkeyPatch) -> Iterator[Resolver]:
    fake = Resolver()
    monkeypatch.setattr(socket, "getaddrinfo", fake.getaddrinfo)
    yield fake
    fake.answers.set()


def link_to(host: str, port: int, timeout: float) -> ModbusLink:
    device = Device(
        link="modbus-tcp", host=host, port=port, timeout=timeout, register_map=Path("map.csv")
    )
    soon = BackoffSettings(first=0.001, cap=0.002)
    return ModbusLink(ModbusSettings("plc", device, backoff=soon), plan_reads(TAGS), SystemClock())


async def test_names_that_nobody_answers_hold_up_nothing_else(
    device: FakeDevice, resolver: Resolver
) -> None:
    dead = [link_to(f"plc{number}.dead.test", 502, PATIENCE) for number in range(40)]
    waiting = [asyncio.create_task(link.scan()) for link in dead]
    while len(resolver.asked) < len(dead):
        await asyncio.sleep(0)
    # The threads that the store and the pages use are free, and so is the way to other devices.
    assert await asyncio.to_thread(lambda: 7) == 7
    resolver.known["plc.alive.test"] = ["127.0.0.1"]
    alive = link_to("plc.alive.test", device.port, PATIENCE)
    assert (await alive.scan()).failures == ()
    resolver.answers.set()
    said = {str((await scan).failures[0]).split(": ", 2)[2] for scan in waiting}
    assert said == {
        "Temporary failure in name resolution; check that the device is on, its address, and the "
        "cable or network between"
    }
    for link in (*dead, alive):
        await link.close()


async def test_an_answer_that_comes_after_the_time_out_serves_the_next_attempt(
    device: FakeDevice, resolver: Resolver
) -> None:
    link = link_to("plc.slow.test", device.port, SHORT)
    assert "no name server answered within 0.05 s" in str((await link.scan()).failures[0])
    resolver.known["plc.slow.test"] = ["127.0.0.1"]
    resolver.answers.set()
    while (await link.scan()).failures:
        await asyncio.sleep(0.001)
    assert resolver.asked == ["plc.slow.test"]
    await link.close()


async def test_the_second_address_is_tried_where_the_first_does_not_answer(
    device: FakeDevice, resolver: Resolver
) -> None:
    resolver.known["plc.two.test"] = ["127.0.0.9", "127.0.0.1"]
    link = link_to("plc.two.test", device.port, PATIENCE)
    assert (await link.scan()).failures == ()
    await link.close()


async def test_a_certificate_has_to_name_the_host_and_not_its_address(
    certificates: Callable[[str], Path], resolver: Resolver
) -> None:
    resolver.known["plc.plant.test"] = resolver.known["plc.other.test"] = ["127.0.0.1"]
    tls = Tls(
        ca=certificates("ca.pem"), cert=certificates("client.pem"), key=certificates("client.key")
    )
    async with served(secured(certificates, "named")) as port:
        for host, fits in (("plc.plant.test", True), ("plc.other.test", False)):
            device = tls_device(port, tls).model_copy(update={"host": host})
            link = ModbusLink(
                ModbusSettings("plc", device),
                plan_reads([Tag("count", Table.INPUT, 5, DataType.UINT16)]),
                SystemClock(),
            )
            assert (await link.scan()).answered is fits
            await link.close()


async def test_an_address_is_its_own_and_is_not_looked_up(resolver: Resolver) -> None:
    for address in ("192.0.2.7", "2001:db8::7", "fe80::7%1"):
        assert await find_addresses(address) == (address,)
    assert resolver.asked == []
