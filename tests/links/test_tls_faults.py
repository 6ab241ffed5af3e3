"""Modbus Security: wrong certificates, renewed ones, and units that share a connection."""

from __future__ import annotations

import asyncio
import errno
import os
import shutil
import socket
import ssl
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from fieldlink.links import LinkState, SystemClock
from fieldlink.links.backoff import BackoffSettings
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.registers import DataType, Table, Tag, plan_reads
from fieldlink.site import Device, Quirks, Tls, check, load_site
from fieldlink.tls_words import tls_words
from tests.links.fake_device import FakeDevice
from tests.links.patience import PATIENCE
from tests.links.test_few_connections import Gateway

Files = Callable[[str], Path]

TRUST = "give it a tls.cert that is still valid and that it trusts"


def plc_context(files: Files) -> ssl.SSLContext:
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=files("ca.pem"))
    context.load_cert_chain(files("plc.pem"), files("plc.key"))
    context.verify_mode = ssl.CERT_REQUIRED
    return context


@contextmanager
def refusing(context: ssl.SSLContext | None) -> Iterator[int]:
    """A server that tells at once, with an alert, what it does not like; without TLS it hangs up.

    One in asyncio goes away without the alert.
    """
    with socket.create_server(("127.0.0.1", 0)) as server:

        def take() -> None:
            while True:
                try:
                    client, _ = server.accept()
                except OSError:
                    return
                with client:
                    if context is None:
                        client.recv(300)
                        client.sendall(b"\x15\x01 not TLS")
                        continue
                    secured = context.wrap_socket(client, True, do_handshake_on_connect=False)
                    with suppress(OSError):
                        secured.do_handshake()
                    # A socket that is closed over unread bytes takes the alert back.
                    with socket.socket(fileno=secured.detach()) as bare, suppress(OSError):
                        bare.shutdown(socket.SHUT_WR)
                        while bare.recv(300):
                            pass

        thread = threading.Thread(target=take)
        thread.start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)
        thread.join()


def unit_of(port: int, files: Files, who: str | None = "client", unit: int = 1) -> ModbusLink:
    device = Device(
        link="modbus-tls",
        host="127.0.0.1",
        port=port,
        unit=unit,
        timeout=PATIENCE,
        register_map=Path("map.csv"),
        tls=Tls(
            ca=files("ca.pem"),
            cert=files(f"{who}.pem") if who else None,
            key=files(f"{who}.key") if who else None,
        ),
        quirks=Quirks(close_after_scan=True),
    )
    tags = [Tag(f"T{i}", Table.HOLDING, i * 300, DataType.UINT16) for i in range(2)]
    backoff = BackoffSettings(first=1e-6, cap=1e-6)
    settings = ModbusSettings(f"u{unit}", device, backoff=backoff)
    return ModbusLink(settings, plan_reads(tags), SystemClock())


async def failure_of(port: int, files: Files, who: str | None = "client") -> str:
    link = unit_of(port, files, who)
    try:
        return str((await link.scan()).failures[0])
    finally:
        await link.close()


@pytest.fixture
async def plc(certificates: Files) -> AsyncIterator[FakeDevice]:
    device = FakeDevice(tls=plc_context(certificates))
    await device.start()
    yield device
    await device.stop()


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
@pytest.mark.parametrize("who", ["stranger", None])
async def test_a_device_that_does_not_trust_us_is_no_matter_of_cables(
    certificates: Files, version: ssl.TLSVersion, who: str | None
) -> None:
    context = plc_context(certificates)
    context.maximum_version = version
    with refusing(context) as port:
        said = await failure_of(port, certificates, who)
    assert said.endswith(TRUST)
    assert "it ends TLS" in said
    assert "cable" not in said


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
async def test_a_device_that_goes_without_a_word_may_not_trust_us(
    plc: FakeDevice, certificates: Files, version: ssl.TLSVersion
) -> None:
    assert plc.tls is not None
    plc.tls.maximum_version = version
    said = await failure_of(plc.port, certificates, "stranger")
    assert said.endswith(TRUST)
    assert "Error" not in said


async def test_a_port_without_tls_is_named_so(certificates: Files) -> None:
    with refusing(None) as port:
        assert "its port is not for TLS" in await failure_of(port, certificates)


async def test_a_renewed_certificate_is_used_for_the_next_connection(
    plc: FakeDevice, certificates: Files
) -> None:
    for kind in ("pem", "key"):
        shutil.copy(certificates(f"stranger.{kind}"), certificates(f"ours.{kind}"))
    link = unit_of(plc.port, certificates, "ours")
    assert (await link.scan()).failures
    for kind in ("pem", "key"):
        shutil.copy(certificates(f"client.{kind}"), certificates(f"ours.{kind}"))
    assert not (await link.scan()).failures
    await link.close()


async def test_a_certificate_that_is_being_replaced_is_told_and_read_again(
    plc: FakeDevice, certificates: Files
) -> None:
    link = unit_of(plc.port, certificates)
    assert not (await link.scan()).failures
    key = certificates("client.key")
    key.rename(certificates("away"))
    scan = await link.scan()
    assert "client.key: No such file or directory" in str(scan.failures[0])
    assert link.state is LinkState.DEMOTED
    certificates("away").rename(key)
    assert not (await link.scan()).failures
    await link.close()


async def test_units_at_one_address_take_turns_over_tls_too(certificates: Files) -> None:
    gateway = Gateway(tls=plc_context(certificates))
    await gateway.start()
    links = [unit_of(gateway.port, certificates, unit=unit) for unit in (1, 2, 3)]
    scans = await asyncio.gather(*(link.scan() for link in links))
    assert [scan["T0"].value for scan in scans] == [1.0, 2.0, 3.0]
    assert gateway.connections == 1
    for link in links:
        await link.close()
    await gateway.stop()


def test_check_warns_of_files_that_do_not_belong_together(certificates: Files) -> None:
    folder = certificates("site.toml").parent
    (folder / "map.csv").write_text("tag,address,type\nOP,0,uint16\nPV,1,uint16\n")
    (folder / "site.toml").write_text(
        '[site]\nname = "case"\n[devices.plc]\nlink = "modbus-tls"\nhost = "192.0.2.1"\n'
        'register_map = "map.csv"\n'
        'tls = { ca = "ca.pem", cert = "client.pem", key = "plc.key" }\n'
        '[loops.A]\ndevice = "plc"\nop = "OP"\npv = "PV"\nperiod = 1.0\n'
    )
    warnings = check(load_site(folder / "site.toml")).warnings
    assert any(
        "device plc: tls: the key does not belong to the certificate" in one for one in warnings
    )


def test_a_file_that_is_closed_to_us_is_named(
    certificates: Files, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenSSL says no more than that some file is closed."""
    files = [certificates(name) for name in ("ca.pem", "client.pem", "client.key")]
    monkeypatch.setattr(os, "access", lambda file, _: file != files[2])
    said = tls_words(PermissionError(errno.EACCES, "Permission denied"), files)
    assert said == f"{files[2]}: Permission denied"
