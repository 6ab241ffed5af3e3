"""Every transport between our link and our simulated PLC's server, over real sockets and lines."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from fieldlink.lab.plc import Listening, serve
from fieldlink.lab.plc.image import RegisterImage
from fieldlink.lab.plc.listening import listen
from fieldlink.lab.plc.modbus_device import modbus_device
from fieldlink.links import LinkState, LinkUnreachableError, SystemClock, open_link
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device, Tls, load_site
from tests.links.patience import PATIENCE, SHORT

HOST = "127.0.0.1"
MAP = Path("map.csv")
SOON = BackoffSettings(first=0.01, cap=0.05)
TAGS = [
    Tag("level", Table.HOLDING, 10, DataType.FLOAT32),
    Tag("count", Table.INPUT, 5, DataType.UINT16),
    Tag("pump", Table.COIL, 19, DataType.BOOL),
]


def image_of(unit: int) -> RegisterImage:
    image = RegisterImage()
    image.define(Table.HOLDING, 10, 2, writable=True)
    image.put(Table.HOLDING, 10, [0x41C8, unit])
    image.define(Table.INPUT, 5, 1)
    image.put(Table.INPUT, 5, [100 + unit])
    image.define(Table.COIL, 19, 1, writable=True)
    image.put(Table.COIL, 19, [unit % 2])
    return image


@asynccontextmanager
async def served(place: Listening, units: tuple[int, ...] = (1,)) -> AsyncIterator[int]:
    server, port = await listen([modbus_device(image_of(unit), unit) for unit in units], place)
    try:
        yield port
    finally:
        await server.shutdown()  # type: ignore[no-untyped-call]
        await asyncio.sleep(0)


def link_to(device: Device, writable: tuple[tuple[int, int], ...] = ()) -> ModbusLink:
    settings = ModbusSettings(
        "plc", device, backoff=SOON, writable=writable, writable_coils=((19, 19),)
    )
    return ModbusLink(settings, plan_reads(TAGS), SystemClock())


async def assert_it_works(device: Device, unit: int = 1) -> None:
    link = link_to(device, writable=((10, 11),))
    try:
        scan = await link.scan()
        assert [str(failure) for failure in scan.failures] == []
        assert scan["count"].value == 100.0 + unit
        assert scan["pump"].value == unit % 2
        assert link.state is LinkState.GOOD
        await link.write_registers(10, [0x4248, 0])
        await link.write_register(11, 0)
        await link.write_coils(19, [1])
        again = await link.scan()
        assert again["level"].value == 50.0
        assert again["pump"].value == 1.0
    finally:
        await link.close()


@pytest.mark.parametrize("kind", ["modbus-tcp", "modbus-rtu-tcp", "modbus-udp"])
async def test_network_transports_read_and_write(kind: str) -> None:
    async with served(Listening(link=kind)) as port:
        device = Device(
            link=kind,  # type: ignore[arg-type]
            host=HOST,
            port=port,
            register_map=MAP,
            timeout=PATIENCE,
        )
        await assert_it_works(device)


def secured(files: Callable[[str], Path], name: str = "plc") -> Listening:
    return Listening(
        link="modbus-tls", cert=files(f"{name}.pem"), key=files(f"{name}.key"), ca=files("ca.pem")
    )


def tls_device(port: int, tls: Tls) -> Device:
    return Device(
        link="modbus-tls", host=HOST, port=port, register_map=MAP, tls=tls, timeout=PATIENCE
    )


async def test_tls_with_client_certificates(certificates: Callable[[str], Path]) -> None:
    async with served(secured(certificates)) as port:
        tls = Tls(
            ca=certificates("ca.pem"),
            cert=certificates("client.pem"),
            key=certificates("client.key"),
        )
        await assert_it_works(tls_device(port, tls))


async def test_tls_with_a_server_that_is_not_pymodbus(
    certificates: Callable[[str], Path], new_device: Callable[..., Any]
) -> None:
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=certificates("ca.pem"))
    context.load_cert_chain(certificates("plc.pem"), certificates("plc.key"))
    context.verify_mode = ssl.CERT_REQUIRED
    device = new_device(tls=context)
    device.words[10:12] = [0x41C8, 0]
    await device.start()
    tls = Tls(
        ca=certificates("ca.pem"),
        cert=certificates("client.pem"),
        key=certificates("client.key"),
    )
    link = link_to(tls_device(device.port, tls))
    scan = await link.scan()
    await link.close()
    assert [str(failure) for failure in scan.failures] == []
    assert scan["level"].value == 25.0


async def test_tls_server_name(certificates: Callable[[str], Path]) -> None:
    async with served(secured(certificates, "named")) as port:
        tls = Tls(
            ca=certificates("ca.pem"),
            cert=certificates("client.pem"),
            key=certificates("client.key"),
        )
        named = tls.model_copy(update={"server_name": "plc.plant.test"})
        await assert_it_works(tls_device(port, named))
        link = link_to(tls_device(port, tls))
        failure = (await link.scan()).failures[0]
        await link.close()
        assert isinstance(failure, LinkUnreachableError)
        assert "its certificate is refused: IP address mismatch" in str(failure)
        assert ".;" not in str(failure)


@pytest.mark.parametrize("who", ["stranger", None])
async def test_tls_refuses_strangers(certificates: Callable[[str], Path], who: str | None) -> None:
    tls = Tls(
        ca=certificates("ca.pem"),
        cert=certificates(f"{who}.pem") if who else None,
        key=certificates(f"{who}.key") if who else None,
    )
    async with served(secured(certificates)) as port:
        link = link_to(tls_device(port, tls))
        scan = await link.scan()
        await link.close()
    assert not scan.answered
    assert isinstance(scan.failures[0], LinkUnreachableError)


async def test_a_plc_of_another_authority_is_refused(certificates: Callable[[str], Path]) -> None:
    tls = Tls(ca=certificates("other_ca.pem"))
    async with served(secured(certificates)) as port:
        link = link_to(tls_device(port, tls))
        failure = (await link.scan()).failures[0]
        await link.close()
    assert "its certificate is refused: self-signed certificate in certificate chain; name" in str(
        failure
    )
    assert "cable" not in str(failure)
    assert ".;" not in str(failure)


async def test_unusable_certificates_are_named(certificates: Callable[[str], Path]) -> None:
    tls = Tls(
        ca=certificates("ca.pem"), cert=certificates("client.pem"), key=certificates("plc.key")
    )
    link = link_to(tls_device(802, tls))
    (failure,) = {str(failure) for failure in (await link.scan()).failures}
    await link.close()
    assert link.state is LinkState.DEMOTED
    assert "client.pem" in failure
    assert "the key does not belong to the certificate; give PEM files that belong together" in (
        failure
    )


def on_line(port: str, unit: int = 1, timeout: float = PATIENCE) -> Device:
    return Device(
        link="modbus-rtu",
        serial_port=port,
        unit=unit,
        parity="none",
        timeout=timeout,
        register_map=MAP,
    )


async def test_a_serial_line(serial_line: tuple[str, str]) -> None:
    plant, here = serial_line
    async with served(Listening(link="modbus-rtu", serial_port=plant)):
        await assert_it_works(on_line(here))


SITE = """\
[site]
name = "line"
[devices.a]
link = "modbus-rtu"
serial_port = "{here}"
plc_serial_port = "{there}"
unit = 1
parity = "none"
timeout = 60.0
register_map = "map.csv"
[devices.b]
link = "modbus-rtu"
serial_port = "{here}"
plc_serial_port = "{there}"
unit = 2
parity = "none"
timeout = 60.0
register_map = "map.csv"
[loops.A]
device = "a"
op = "OP"
pv = "PV"
period = 1.0
plant = {{ recording = "a.csv" }}
[loops.B]
device = "b"
op = "OP"
pv = "PV"
period = 1.0
plant = {{ recording = "b.csv" }}
"""


async def test_a_site_on_one_serial_line_with_its_simulated_plcs(
    serial_line: tuple[str, str], tmp_path: Path
) -> None:
    there, here = serial_line
    (tmp_path / "site.toml").write_text(SITE.format(here=here, there=there))
    (tmp_path / "map.csv").write_text("tag,address,type\nOP,0,float32\nPV,2,float32\n")
    (tmp_path / "a.csv").write_text("op,pv\n" + "10,1\n" * 60)
    (tmp_path / "b.csv").write_text("op,pv\n" + "20,2\n" * 60)
    site = load_site(tmp_path / "site.toml")
    listening, stop = asyncio.Event(), asyncio.Event()
    plant = asyncio.create_task(serve(site, ready=lambda _servers: listening.set(), stop=stop))
    await listening.wait()
    links = [open_link(site, name) for name in ("a", "b")]
    scans = await asyncio.gather(*(link.scan() for link in links))
    for link in links:
        await link.close()
    stop.set()
    await plant
    assert [(scan["OP"].value, scan["PV"].value) for scan in scans] == [(10.0, 1.0), (20.0, 2.0)]


async def test_a_port_that_is_not_there_is_named(tmp_path: Path) -> None:
    link = link_to(on_line(str(tmp_path / "ttyUSB9")))
    failure = (await link.scan()).failures[0]
    await link.close()
    assert isinstance(failure, LinkUnreachableError)
    assert "ttyUSB9" in str(failure)


async def test_a_port_that_another_program_has_is_no_matter_of_a_cable(
    serial_line: tuple[str, str],
) -> None:
    fcntl = pytest.importorskip("fcntl")
    with Path(serial_line[1]).open("rb", buffering=0) as taken:  # noqa: ASYNC230  (a terminal)
        fcntl.flock(taken, fcntl.LOCK_EX | fcntl.LOCK_NB)
        link = link_to(on_line(serial_line[1]))
        said = str((await link.scan()).failures[0])
        await link.close()
    assert "another program uses the port; end it; programs that run beside each other" in said
    assert "cable" not in said


async def test_units_of_one_serial_line_take_turns(serial_line: tuple[str, str]) -> None:
    plant, here = serial_line
    async with served(Listening(link="modbus-rtu", serial_port=plant), units=(1, 2, 3)):
        links = [link_to(on_line(here, unit)) for unit in (1, 2, 3)]
        for _ in range(5):
            scans = await asyncio.gather(*(link.scan() for link in links))
            assert [scan["count"].value for scan in scans] == [101.0, 102.0, 103.0]
        # One of them lets go: the line stays with the others.
        await links[0].close()
        assert (await links[1].scan())["count"].value == 102.0
        for link in links:
            await link.close()


async def test_a_silent_unit_costs_the_others_on_its_line_no_value(
    serial_line: tuple[str, str],
) -> None:
    plant, here = serial_line
    async with served(Listening(link="modbus-rtu", serial_port=plant), units=(1, 2)):
        links = [
            link_to(on_line(here, unit, timeout))
            for unit, timeout in ((1, PATIENCE), (2, PATIENCE), (9, SHORT))
        ]
        for _ in range(6):
            first, second, silent = await asyncio.gather(*(link.scan() for link in links))
            assert first["count"].value == 101.0
            assert second["count"].value == 102.0
            assert not silent.answered
        assert [link.state for link in links] == [
            LinkState.GOOD,
            LinkState.GOOD,
            LinkState.DEMOTED,
        ]
        for link in links:
            await link.close()
