"""A serial port that is none or goes away, and a device that is silent on its line."""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from fieldlink.links import SystemClock
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device

PORT_REMEDY = "check serial_port, that its adapter is plugged in, and that this user may open it"


def link_on(port: str | Path) -> ModbusLink:
    device = Device(
        link="modbus-rtu",
        serial_port=str(port),
        parity="none",
        timeout=0.1,
        register_map=Path("map.csv"),
    )
    backoff = BackoffSettings(first=1e-6, cap=1e-6)
    plan = plan_reads([Tag("T", Table.HOLDING, 0, DataType.UINT16)])
    return ModbusLink(ModbusSettings("plc", device, backoff=backoff), plan, SystemClock())


async def failure_of(link: ModbusLink) -> str:
    return str((await link.scan()).failures[0])


@pytest.fixture
def line() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal: the file descriptor of its far end, and the port."""
    far, near = os.openpty()
    tty.setraw(near)
    name = os.ttyname(near)
    os.close(near)
    yield far, name
    os.close(far)


@pytest.mark.parametrize(
    ("port", "why"),
    [
        ("/dev/nowhere", "No such file or directory"),
        ("/dev/null", "Inappropriate ioctl for device"),
        ("/dev", "Is a directory"),
    ],
)
async def test_a_port_that_cannot_be_opened_is_no_matter_of_addresses(port: str, why: str) -> None:
    link = link_on(port)
    said = await failure_of(link)
    await link.close()
    assert f"{why}; {PORT_REMEDY}" in said


async def test_a_port_that_goes_away_is_told_in_our_words(line: tuple[int, str]) -> None:
    far, port = line
    link = link_on(port)
    assert "did not answer" in await failure_of(link)
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, far)
    os.close(null)
    said = await failure_of(link)
    await link.close()
    assert said.endswith(f"{PORT_REMEDY} (as a rule as a member of the group dialout)")
    assert "readiness" not in said


async def test_silence_on_a_line_may_be_of_its_settings(line: tuple[int, str]) -> None:
    link = link_on(line[1])
    said = await failure_of(link)
    await link.close()
    assert (
        "check the unit id, the line's baud rate, parity and stop bits, and its two wires" in said
    )
