from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import trustme

from fieldlink.site import Site
from tests.links.fake_device import FakeDevice
from tests.links.opcua_server import write_site
from tests.serial_lines import serial_line as joined_ends


@pytest.fixture
async def new_device() -> AsyncIterator[Callable[..., FakeDevice]]:
    made = []

    def make(**settings: Any) -> FakeDevice:
        device = FakeDevice(**settings)
        made.append(device)
        return device

    yield make
    for device in made:
        await device.stop()


@pytest.fixture
async def device(new_device: Callable[..., FakeDevice]) -> FakeDevice:
    running = new_device()
    await running.start()
    return running


@pytest.fixture
def certificates(tmp_path: Path) -> Callable[[str], Path]:
    """Write a CA, a PLC's and a client's certificate, and a stranger's; return paths by name."""
    authority, other = trustme.CA(), trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    other.cert_pem.write_to_path(tmp_path / "other_ca.pem")
    for name, certificate in {
        "plc": authority.issue_cert("127.0.0.1", "plc.plant.test"),
        "named": authority.issue_cert("plc.plant.test"),
        "client": authority.issue_cert("fieldlink.plant.test"),
        "stranger": other.issue_cert("fieldlink.plant.test"),
    }.items():
        certificate.private_key_pem.write_to_path(tmp_path / f"{name}.key")
        certificate.cert_chain_pems[0].write_to_path(tmp_path / f"{name}.pem")
    return lambda name: tmp_path / name


@pytest.fixture
async def serial_line(tmp_path: Path) -> AsyncIterator[tuple[str, str]]:
    async with joined_ends(tmp_path) as ends:
        yield ends


@pytest.fixture
def make_opcua_site(tmp_path: Path) -> Callable[..., Site]:
    return partial(write_site, tmp_path)
