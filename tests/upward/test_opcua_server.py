"""The read-only OPC UA server: what clients see, what they are refused, and what ends it."""

from __future__ import annotations

import asyncio
import contextlib
import re
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio
from asyncua import Client, ua
from asyncua.crypto import security_policies
from asyncua.ua.uaerrors import UaError

from benchmarks.web_store import fill_store
from fieldlink.errors import FieldlinkError
from fieldlink.links.backoff import BackoffSettings
from fieldlink.opcua_keys import KeyFileError
from fieldlink.opcua_server import serving
from fieldlink.opcua_server.document import loop_values
from fieldlink.opcua_server.names import LOOP_VARIABLES
from fieldlink.opcua_server.process import read_keys
from fieldlink.opcua_server.serving import opcua_server, read_password
from fieldlink.site import SiteError, check, load_site
from fieldlink.web import live_source
from fieldlink.web.analyst import Analyst
from fieldlink.web.view.fleet_view import FleetView
from fieldlink.web.view.store_queries import StoreQueries
from tests.daemon import live
from tests.links.opcua_certificates import write_certificate
from tests.upward.conftest import until
from tests.upward.mosquitto import free_port
from tests.upward.opcua_process import DEVICE, LOOP, Served, look_from_outside, served

DI = "http://opcfoundation.org/UA/DI/"
PADIM = "http://opcfoundation.org/UA/PADIM/"
of_one_server = pytest.mark.asyncio(loop_scope="module")


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def server() -> AsyncIterator[Served]:
    """For the tests that need no settings of their own: its start takes two seconds.

    At its end it must have written nothing into the log, see `served`.
    """
    async with served() as running:
        yield running


@of_one_server
async def test_a_foreign_client_reads_and_changes_nothing(server: Served) -> None:
    await server.show({"FC101": LOOP, "U1/T2": LOOP | {"DeviceHealth": [4, "uncertain"]}})
    nodes = ["Loops/FC101/StickBand", "Loops/FC101/DeviceHealth", "Loops/FC101/DaysToLimit"]
    nodes += ["Loops/U1%2FT2/DeviceHealth", "Devices/plc/DeviceHealth"]
    nodes += ["Loops/FC101/SignalSet/SlipJump/AnalogSignal"]
    found = await look_from_outside(server.address, nodes)
    # What a client may not write has not changed either.
    async with Client(server.address, timeout=60.0) as client:
        assert await client.get_node("ns=1;s=Loops/FC101/StickBand").read_value() == 2.5
    await server.show({"FC101": LOOP | {"StickBand": 3.5}})
    async with Client(server.address, timeout=60.0) as client:
        assert await client.get_node("ns=1;s=Loops/FC101/StickBand").read_value() == 3.5
        loops = await client.get_node("ns=1;s=Loops").get_children()
        assert [loop.nodeid.Identifier for loop in loops] == ["Loops/FC101"]
    assert set(found["refused"].values()) == {"BadUserAccessDenied"}
    assert len(found["refused"]) == 5
    assert found["namespaces"] == [
        "http://opcfoundation.org/UA/",
        "urn:fieldlink:server",
        DI,
        PADIM,
    ]
    tree = found["tree"]
    assert set(tree) == {"2:DeviceSet", "1:Loops", "1:Devices", "1:UpdatedAt"}
    assert set(tree["2:DeviceSet"]) == {"1:FC101", "1:U1/T2", "1:plc"}
    companion = {"AssetId", "DeviceHealth", "ComponentName"}
    for names, shown in (
        (LOOP, tree["1:Loops"]["1:FC101"]),
        (DEVICE, tree["1:Devices"]["1:plc"]),
    ):
        own = {f"{2 if name in companion else 1}:{name}" for name in names}
        assert set(shown) - {"3:SignalSet"} == own
    values = found["values"]
    stick_band = values["Loops/FC101/StickBand"]
    assert (stick_band["value"], stick_band["status"]) == (2.5, "Good")
    assert stick_band["time"] == "2023-11-14T22:13:20.000Z"  # the end of its window
    assert found["reported"] == 2.5
    assert found["health"][4] == "MAINTENANCE_REQUIRED"
    health = values["Loops/FC101/DeviceHealth"]
    assert (health["value"], health["status"], health["type"]) == (4, "Good", "Int32")
    assert values["Loops/U1%2FT2/DeviceHealth"]["status"] == "Uncertain"
    assert values["Loops/FC101/DaysToLimit"]["status"] == "BadWaitingForInitialData"
    assert values["Devices/plc/DeviceHealth"]["value"] == 1
    assert values["Loops/FC101/SignalSet/SlipJump/AnalogSignal"]["value"] == 1.0


def test_what_the_pages_show_becomes_values_of_every_kind(tmp_path: Path) -> None:
    url = fill_store(
        tmp_path / "history.sqlite",
        now_ms=round(time.time() * 1000.0),
        loops=10,
        days=5,
        samples=10,
        long_samples=10,
    )
    queries, analyst = StoreQueries(url), Analyst()
    view = FleetView(queries, lambda: None, analyst)
    try:
        fleet = view.look(None)
    finally:
        view.close()
        analyst.close()
        queries.close()
    values = loop_values(fleet)
    for row in fleet.rows:
        health = {"stiction": 4, "no_stiction": 0}.get(row["verdict"])
        doubted = row["uncertain"] and health is not None
        shown = values[row["name"]]["DeviceHealth"]
        assert shown == ([health, "uncertain"] if doubted else health)
    assert {row["verdict"] for row in fleet.rows} == {"stiction", "no_stiction", "not_assessable"}
    assert any(row["uncertain"] for row in fleet.rows)
    # Every variable has a value of its type, one that is known or one that is not.
    types: dict[str, Any] = {"Double": float | int, "String": str, "Boolean": bool}
    types |= {"DateTime": float, "DeviceHealth": int | list, "UInt32": int}
    for found in values.values():
        assert set(found) == {entry.name for entry in LOOP_VARIABLES}
        for entry in LOOP_VARIABLES:
            assert isinstance(found[entry.name], types[entry.kind] | None), entry.name


async def connect(address: str, folder: Path | None, user: tuple[str, str] | None = None) -> float:
    """Read a value with a certificate of a folder, or without encryption."""
    client = Client(address, timeout=60.0)
    client.application_uri = "urn:fieldlink:client"
    if folder is not None:
        await client.set_security(
            security_policies.SecurityPolicyBasic256Sha256,
            str(folder / "our.pem"),
            str(folder / "our.key.pem"),
            server_certificate=str(folder.parent / "server" / "our.pem"),
        )
    if user is not None:
        client.set_user(user[0])
        client.set_password(user[1])
    async with client:
        return float(await client.get_node("ns=1;s=Loops/FC101/StickBand").read_value())


async def test_only_the_trusted_client_with_the_password_is_let_in(tmp_path: Path) -> None:
    for name, uri in (("server", "server"), ("known", "client"), ("stranger", "client")):
        (tmp_path / name).mkdir()
        write_certificate(tmp_path / name, f"urn:fieldlink:{uri}")
    known, right = tmp_path / "known", ("scada", "a long password")
    async with served(
        cert=str(tmp_path / "server" / "our.pem"),
        key=str(tmp_path / "server" / "our.key.pem"),
        trusted=[str(known / "our.pem")],
        username=right[0],
        password=right[1],
    ) as server:
        await server.show({"FC101": LOOP})
        assert await connect(server.address, known, right) == 2.5
        for folder, user in (
            (None, right),
            (known, None),
            (known, ("scada", "a wrong password")),
            (known, ("other", right[1])),
            (tmp_path / "stranger", right),
        ):
            with pytest.raises((UaError, ConnectionError, TimeoutError)):
                await connect(server.address, folder, user)


def test_a_certificate_that_cannot_be_used_is_one_sentence(tmp_path: Path) -> None:
    for name in ("mine", "other"):
        (tmp_path / name).mkdir()
        write_certificate(tmp_path / name, "urn:mine")
    cert, key = (str(tmp_path / "mine" / name) for name in ("our.pem", "our.key.pem"))
    read_keys(cert, key, "urn:mine")
    for given, said in (
        ((cert, key, "urn:x"), "names urn:mine and the server is urn:x; make them agree"),
        ((cert, cert, "urn:mine"), "holds no private key; give the key as PEM or DER file"),
        ((key, key, "urn:mine"), "holds no certificate; give a certificate as PEM or DER file"),
        ((cert, str(tmp_path / "other" / "our.key.pem"), "urn:mine"), "does not belong to"),
    ):
        with pytest.raises(KeyFileError, match=said):
            read_keys(*given)


class Taker:
    """Part of asyncua's interface."""

    def __init__(self) -> None:
        self.taken = asyncio.Event()

    def datachange_notification(self, *_: object) -> None:
        self.taken.set()

    def status_change_notification(self, _: object) -> None:
        pass


@of_one_server
async def test_clients_that_leave_without_a_word_write_nothing_into_the_log(server: Served) -> None:
    for _ in range(2):
        await server.show({"FC101": LOOP})
        client, taker = Client(server.address, timeout=60.0), Taker()
        await client.connect()
        subscription = await client.create_subscription(10.0, taker)
        node = client.get_node("ns=1;s=Loops/FC101/StickBand")
        await subscription.subscribe_data_change(node)
        await asyncio.wait_for(taker.taken.wait(), 300.0)
        # Its socket is gone, with a publish request still open at the server.
        client.uaclient.protocol.transport.abort()
        with contextlib.suppress(ConnectionError, TimeoutError, UaError):
            await client.disconnect()
        await server.show({"FC101": LOOP | {"StickBand": 3.0}})


@of_one_server
async def test_a_flood_of_connections_leaves_the_client_that_is_there_alone(server: Served) -> None:
    async with Client(server.address, timeout=60.0) as client:
        await server.show({"FC101": LOOP})
        flood = [await asyncio.open_connection("127.0.0.1", server.port) for _ in range(40)]
        for number, (_, writer) in enumerate(flood):
            # A header that promises gigabytes, nonsense, or nothing at all.
            writer.write((b"HELF\xff\xff\xff\x7f", b"GET / HTTP/1.1\r\n\r\n", b"")[number % 3])
        ended = [asyncio.create_task(reader.read()) for reader, _ in flood]
        await asyncio.wait(ended, return_when=asyncio.FIRST_COMPLETED)
        # With the client that was there: no more than may be.
        assert await server.show({"FC101": LOOP | {"StickBand": 3.0}}) <= 5
        assert await client.get_node("ns=1;s=Loops/FC101/StickBand").read_value() == 3.0
        for _, writer in flood:
            writer.close()
        await asyncio.gather(*ended, return_exceptions=True)
        async with Client(server.address, timeout=60.0) as other:
            with pytest.raises(UaError):
                await other.nodes.objects.add_folder(1, "mine")
            assert await other.get_node("ns=1;s=Loops/FC101/StickBand").read_value() == 3.0


@pytest.mark.parametrize("loops", [0, 1, 200, 201, 1000])
def test_a_fleet_is_told_in_parts_that_an_answer_has_time_for(loops: int) -> None:
    changed = {f"L{number}": {"Score": float(number)} for number in range(loops)}
    whole = {
        "time": 1.0,
        "loops": {"names": [*changed, "unchanged"], "changed": changed},
        "devices": {"names": ["plc"], "changed": {"plc": DEVICE}},
    }
    parts = list(serving.parts_of(whole))
    for kind in ("loops", "devices"):
        told = [one for part in parts for one in part[kind]["changed"].items()]
        assert told == list(whole[kind]["changed"].items())  # type: ignore[index]
        assert all(part[kind]["names"] == whole[kind]["names"] for part in parts)  # type: ignore[index]
    sizes = [sum(len(part[kind]["changed"]) for kind in ("loops", "devices")) for part in parts]
    assert max(sizes) <= serving.AT_ONCE
    nothing = {kind: {"names": ["a"], "changed": {}} for kind in ("loops", "devices")}
    assert list(serving.parts_of({"time": 1.0, **nothing})) == [{"time": 1.0, **nothing}]


@of_one_server
async def test_a_loop_that_leaves_the_site_ends_its_values_and_may_come_back(
    server: Served,
) -> None:
    said: asyncio.Queue[tuple[Any, str]] = asyncio.Queue()

    class Handler:
        def datachange_notification(self, _node: Any, value: Any, data: Any) -> None:
            said.put_nowait((value, data.monitored_item.Value.StatusCode.name))

    await server.show(dict.fromkeys(("A", "B", "C", "D"), LOOP))
    async with Client(server.address, timeout=60.0) as client:
        subscription = await client.create_subscription(50, Handler())
        await subscription.subscribe_data_change(
            client.get_node("ns=1;s=Loops/A/SignalSet/StickBand/AnalogSignal")
        )
        assert await said.get() == (2.5, "Good")
        await server.show({"D": LOOP})
        assert await said.get() == (None, "BadNodeIdUnknown")
        devices = client.get_node(f"ns={await client.get_namespace_index(DI)};i=5001")
        for folder, names in (("ns=1;s=Loops", ["D"]), (devices.nodeid, ["plc", "D"])):
            shown = await client.get_node(folder).get_children()
            assert {(await node.read_browse_name()).Name for node in shown} == set(names)
        await server.show({"A": LOOP | {"StickBand": 9.0}}, names=["A", "D"])
        assert await said.get() == (9.0, "Good")
        shown = await client.get_node("ns=1;s=Loops").get_children()
        assert [node.nodeid.Identifier for node in shown] == ["Loops/D", "Loops/A"]


async def test_the_bound_of_memory_grows_with_the_loops() -> None:
    resource = pytest.importorskip("resource")
    first = {f"A{number}": LOOP for number in range(20)}
    more = first | {f"B{number}": LOOP for number in range(200)}
    async with served() as server:
        status = Path(f"/proc/{server.pid}/status")
        if not status.exists():
            pytest.skip("no /proc")
        used, bound = [], []
        for loops in (first, more):
            await server.show(loops)
            (kilobytes,) = re.findall(r"VmData:\s+(\d+) kB", status.read_text())
            used.append(1024 * int(kilobytes))
            bound.append(resource.prlimit(server.pid, resource.RLIMIT_DATA)[0])
    # what thousands of loops take is there as well, and as much again for those who subscribe
    assert bound[1] - bound[0] >= 1.5 * (used[1] - used[0])
    assert bound[0] >= 3 * used[0]


@pytest.mark.waits
async def test_a_port_in_use_is_tried_again_and_a_killed_server_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serving, "PATIENCE", BackoffSettings(first=0.05, cap=0.1))
    monkeypatch.setattr(serving, "EVERY", 0.05)
    monkeypatch.setattr(serving, "END_WITHIN", 60.0)
    site = live.site_for(tmp_path, {"plc": free_port()}, timeout=0.2)
    taken = await asyncio.start_server(lambda *_: None, "127.0.0.1", 0)
    port = taken.sockets[0].getsockname()[1]
    with site.path.open("a") as file:
        file.write(f"[opcua_server]\nport = {port}\n")
    site = load_site(site.path)
    assert check(site).opcua_server == (
        f"read-only on 127.0.0.1:{port} (not encrypted); anonymous clients"
    )
    async with (
        live.running(site) as daemon,
        live_source(daemon) as source,
        opcua_server(site, daemon, source) as server,
    ):
        assert server is not None
        await until(lambda: server.attempts > 1, "another attempt", tries=6000)
        assert not server.listening.is_set()
        taken.close()
        await taken.wait_closed()
        await asyncio.wait_for(server.listening.wait(), 300.0)
        await until(lambda: daemon.status().devices["plc"].state.name == "DEMOTED", "demoted")
        async with Client(f"opc.tcp://127.0.0.1:{port}", timeout=60.0) as client:
            health = client.get_node("ns=1;s=Devices/plc/DeviceHealth")
            while await health.read_value() != 1:
                await asyncio.sleep(0.05)
            verdict = await client.get_node("ns=1;s=Loops/PLC/Verdict").read_data_value(
                raise_on_bad_status=False
            )
            assert verdict.StatusCode == ua.StatusCode(ua.StatusCodes.BadWaitingForInitialData)
        assert server.process is not None
        server.process.kill()
        await until(lambda: not server.listening.is_set(), "the end")
        await asyncio.wait_for(server.listening.wait(), 300.0)
        async with Client(f"opc.tcp://127.0.0.1:{port}", timeout=60.0) as client:
            assert await client.get_node("ns=1;s=Loops/PLC/AssetId").read_value() == "PLC"
        last = server.process
    assert last.returncode == 0


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        ('host = "0.0.0.0"', "lets other machines in"),
        ('cert = "map.csv"', "cert and key belong together"),
        ('username = "me"', "username and password_file belong together"),
        ('trusted = ["map.csv"]', "add its cert and key"),
        ('password_file = "none"\nusername = "me"', "there is no file"),
    ],
)
def test_a_wrong_table_is_one_sentence(
    make_site: Callable[..., Any], extra: str, said: str
) -> None:
    with pytest.raises(SiteError) as caught:
        make_site(1, f"[opcua_server]\n{extra}\n")
    assert said in str(caught.value)
    assert len(caught.value.problems) == 1


def test_a_short_password_is_refused(tmp_path: Path) -> None:
    (tmp_path / "pw").write_text("short\n")
    with pytest.raises(FieldlinkError, match="holds 5 characters; give at least 12"):
        read_password(tmp_path / "pw")
