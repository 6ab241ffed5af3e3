"""The OPC UA link against a foreign stack: values, status codes, and every way to lose a server."""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from fieldlink.links import LinkState, Quality, SystemClock, open_link
from fieldlink.links.errors import AccessRefusedError, LinkError
from fieldlink.links.single_values import Point, read_points
from fieldlink.site import Site, check
from tests.links.opcua_server import OpcuaServer, scan_until, write_site

LOOPS = 3
pytestmark = pytest.mark.asyncio(loop_scope="module")


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def server() -> AsyncIterator[OpcuaServer]:
    running = OpcuaServer(loops=LOOPS)
    await running.start()
    yield running
    await running.kill()


@pytest.mark.parametrize("mode", ["read", "subscribe"])
async def test_op_and_pv_come_with_their_status(
    server: OpcuaServer, make_opcua_site: Callable[..., Site], mode: str
) -> None:
    rows = "TEXT,ns=1;s=Text\nNONE,ns=1;s=Nothing\n"
    link = open_link(make_opcua_site(server.port, opcua=f'mode = "{mode}"', rows=rows), "plc")
    await link.open()
    try:
        await server.tell(step=40)
        await scan_until(
            link, lambda s: s["L2.PV"].value == -42.0 and s["L0.OP"].value == 40.0, "values"
        )
        scan = await link.scan()
        assert [scan[f"L{n}.OP"].value for n in range(LOOPS)] == [40.0, 41.0, 42.0]
        assert scan["TEXT"].quality is Quality.NO_SCALAR
        assert scan["NONE"].quality is Quality.QUARANTINED
        assert link.state is LinkState.DEGRADED
        assert link.quarantined == ("NONE",)
        assert "BadNodeIdUnknown" in str(scan.failures[0])
        await server.tell(set="L0.PV", value=5.0, status="BadSensorFailure")
        await server.tell(set="L1.PV", value=5.0, status="UncertainLastUsableValue")
        await server.tell(set="L2.PV", value="NaN")
        scan = await scan_until(
            link, lambda s: s["L2.PV"].quality is Quality.NOT_A_NUMBER, "bad values"
        )
        assert [scan[f"L{n}.PV"].quality for n in (0, 1)] == [Quality.BAD_STATUS] * 2
        assert scan["L0.PV"].status == "BadSensorFailure"
        assert scan["L1.PV"].status == "UncertainLastUsableValue"
        assert all(math.isnan(scan[f"L{n}.PV"].value) for n in range(LOOPS))
        assert scan["L0.OP"].value == 40.0
    finally:
        await link.close()


@pytest.mark.parametrize("mode", ["read", "subscribe"])
async def test_a_namespace_that_the_server_has_not_costs_its_node_alone(
    server: OpcuaServer, make_opcua_site: Callable[..., Site], mode: str
) -> None:
    rows = "LOST,nsu=urn:other;s=L0.PV\n"
    link = open_link(make_opcua_site(server.port, opcua=f'mode = "{mode}"', rows=rows), "plc")
    try:
        await server.tell(step=40)
        scan = await scan_until(link, lambda s: s["L2.PV"].value == -42.0, "values")
        assert scan["LOST"].quality is Quality.QUARANTINED
        assert "because the server has no namespace urn:other" in str(scan.failures[0])
        assert link.state is LinkState.DEGRADED
        assert link.connects == 1
    finally:
        await link.close()


async def test_a_password_file_that_is_gone_is_named(tmp_path: Path) -> None:
    for name in ("pw", "cert.pem", "key.pem", "server.pem"):
        (tmp_path / name).write_text("secret")
    files = 'cert = "cert.pem"\nkey = "key.pem"\nserver_cert = "server.pem"\npassword_file = "pw"'
    security = 'security = "Basic256Sha256"\nusername = "me"'
    site = write_site(tmp_path, 1, opcua=f"{security}\n{files}")
    (tmp_path / "pw").unlink()
    link = open_link(site, "plc")
    try:
        scan = await link.scan()
    finally:
        await link.close()
    assert "the file" in str(scan.failures[0])
    assert "pw cannot be read: No such file or directory; check its path" in str(scan.failures[0])


async def test_one_request_has_op_and_pv_and_slow_loops_rest(
    server: OpcuaServer, make_opcua_site: Callable[..., Site]
) -> None:
    site = make_opcua_site(server.port, opcua="max_nodes = 5")
    # three loops do not fit into five nodes, and no loop is torn apart
    assert [len(request.tags) for request in site.requests("plc")] == [4, 2]
    report = check(site)
    assert [loop.op_pv_together for loop in report.loops] == [True] * LOOPS
    assert report.devices[0].address == f"opc.tcp://127.0.0.1:{server.port}"
    site = site.with_loop("L1", period=0.8)
    await server.tell(step=1)
    link = open_link(site, "plc")
    first, second = await link.scan(), await link.scan()
    await link.close()
    assert (first.requests, second.requests) == (2, 1)
    assert second["L1.PV"].quality is Quality.NOT_DUE
    assert second["L0.PV"].good


@pytest.mark.slow
async def test_a_server_that_is_paused_killed_and_started_again(
    make_opcua_site: Callable[..., Site],
) -> None:
    """A value is either of this moment or not given; the link comes back by itself."""
    own = OpcuaServer(few_nodes=True, loops=1)
    await own.start()
    links = []
    for mode in ("read", "subscribe"):
        site = make_opcua_site(own.port, opcua=f'mode = "{mode}"', loops=1)
        links.append(open_link(site.with_device("plc", timeout=0.5), "plc", SystemClock()))

    async def wait_for_value(step: int, what: str) -> None:
        await own.tell(step=step)
        for link in links:
            await scan_until(link, lambda s: s["L0.PV"].value == -float(step), what)

    async def wait_for_loss() -> None:
        for link in links:
            lost = await scan_until(link, lambda s: bool(s.failures), "the loss")
            assert not lost["L0.PV"].good
            assert link.state is LinkState.DEMOTED

    try:
        await wait_for_value(7, "the first value")
        own.pause()
        await wait_for_loss()
        own.resume()
        await wait_for_value(8, "the value after the pause")
        await own.kill()
        await wait_for_loss()
        await own.start()
        await wait_for_value(9, "the value after the restart")
        # a short pause need not cost the session, the restart does
        assert all(link.connects >= 2 for link in links)
    finally:
        for link in links:
            await link.close()
        await own.kill()


async def test_a_tag_is_read_by_hand(
    server: OpcuaServer, make_opcua_site: Callable[..., Site]
) -> None:
    site = make_opcua_site(server.port, opcua='mode = "subscribe"')
    await server.tell(step=20)
    point = Point("plc", site.devices["plc"], site.maps["plc"]["L1.PV"], site)
    assert [reading.value for reading in await read_points([point])] == [-21.0]
    assert point.where == f"ns=1;s=L1.PV of plc (opc.tcp://127.0.0.1:{server.port})"


async def test_the_exchange_array_is_written_only_where_the_site_allows(
    server: OpcuaServer, make_opcua_site: Callable[..., Site]
) -> None:
    back = "[loops.L0.writeback]\nenabled = true\nloop_id = 7\nbase = 10\n"
    site = make_opcua_site(
        server.port, opcua='exchange_node = "ns=1;s=Exchange"', loop=back, loops=1
    )
    layout = site.loops["L0"].writeback.exchange
    assert layout is not None
    link: Any = open_link(site, "plc")
    try:
        await link.write_registers(layout.bank_a, [1, 2, 65535])
        await link.write_register(layout.commit, 77)
        assert await link.read_registers(layout.bank_a, 3) == [1, 2, 65535]
        words = await server.tell()
        assert words[layout.bank_a : layout.bank_a + 3] == [1, 2, 65535]
        assert words[layout.commit] == 77
        assert sum(map(bool, words)) == 4
        with pytest.raises(AccessRefusedError, match="not allowed by the site file"):
            await link.write_register(layout.enable, 1)
        with pytest.raises(LinkError, match=r"the array is too short|index ranges"):
            await link.read_registers(5000, 2)
        with pytest.raises(LinkError, match="the array is too short"):
            await link.read_registers(198, 4)
        assert link.connects == 1
    finally:
        await link.close()


async def test_security_and_password_come_from_files(
    make_opcua_site: Callable[..., Site], tmp_path: Path
) -> None:
    import base64
    import hashlib
    import ssl

    from tests.links.opcua_certificates import write_certificate

    own = OpcuaServer(
        few_nodes=True,
        loops=1,
        user="edge",
        password="s3cret",
        pki=str(tmp_path / "pki"),
        sessions=1,
    )
    await own.start()
    write_certificate(tmp_path, "urn:fieldlink:client")
    der = base64.b64decode(own.hello["certificate"])
    (tmp_path / "server.pem").write_text(ssl.DER_cert_to_PEM_cert(der))
    (tmp_path / "password").write_text("s3cret\n")
    opcua = (
        'security = "Basic256Sha256"\ncert = "our.pem"\nkey = "our.key.pem"\n'
        'server_cert = "server.pem"\nusername = "edge"\npassword_file = "password"'
    )
    link = open_link(make_opcua_site(own.port, opcua=opcua, loops=1), "plc")
    try:
        await own.tell(step=3)
        await scan_until(link, lambda s: s["L0.OP"].value == 3.0, "an encrypted value")
        other = open_link(make_opcua_site(own.port, opcua=opcua, loops=1), "plc")
        refused = await other.scan()
        assert "BadTooManySessions" in str(refused.failures[0])
        assert "limit of sessions" in str(refused.failures[0])
        assert (await link.scan())["L0.OP"].value == 3.0
    finally:
        await link.close()
    await scan_until(other, lambda s: s["L0.OP"].value == 3.0, "the free session")
    await other.close()
    # The server has another certificate than the one that we were given.
    (tmp_path / "new").mkdir()
    write_certificate(tmp_path / "new", "urn:another:server")
    known = (tmp_path / "server.pem").read_bytes()
    (tmp_path / "server.pem").write_bytes((tmp_path / "new" / "our.pem").read_bytes())
    link = open_link(make_opcua_site(own.port, opcua=opcua, loops=1), "plc")
    scan = await link.scan()
    await link.close()
    assert link.state is LinkState.DEMOTED
    assert "shows another certificate than server.pem" in str(scan.failures[0])
    assert hashlib.sha1(der, usedforsecurity=False).hexdigest() in str(scan.failures[0])
    (tmp_path / "server.pem").write_bytes(known)
    (tmp_path / "password").write_text("wrong\n")
    link = open_link(make_opcua_site(own.port, opcua=opcua, loops=1), "plc")
    scan = await link.scan()
    await link.close()
    await own.kill()
    assert "BadUserAccessDenied" in str(scan.failures[0]) or "BadIdentityToken" in str(
        scan.failures[0]
    )
    assert "wrong" not in str(scan.failures[0])


ACKNOWLEDGE = b"ACKF" + struct.pack("<6I", 28, 0, 65536, 65536, 0, 0)


@pytest.mark.parametrize(
    "answer",
    [
        b"HTTP/1.1 400 Bad Request\r\n\r\n",
        b"ACKF" + struct.pack("<I", 2**31 - 1) + bytes(50),
        ACKNOWLEDGE + b"OPNF" + struct.pack("<I", 60) + b"\xff" * 52,
        b"ERRF" + struct.pack("<IIi", 16, 0x807D0000, 2**30),
    ],
    ids=["http", "without end", "rubbish", "wrong length"],
)
async def test_what_is_no_opcua_server_is_a_reason_of_the_device(
    make_opcua_site: Callable[..., Site], answer: bytes
) -> None:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(100)
        writer.write(answer)
        await reader.read(1000)
        writer.close()

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as listening:
        port = listening.sockets[0].getsockname()[1]
        link = open_link(make_opcua_site(port, loops=1).with_device("plc", timeout=0.05), "plc")
        scan = await link.scan()
        await link.close()
    assert link.state is LinkState.DEMOTED
    assert f"no session with opc.tcp://127.0.0.1:{port}: " in str(scan.failures[0])
