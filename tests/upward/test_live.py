"""The running daemon publishes, and takes the commands that its site file names."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from asyncua import Client as OpcuaClient

from fieldlink.errors import MissingExtraError
from fieldlink.opcua_server import serving
from fieldlink.opcua_server.serving import opcua_server
from fieldlink.site import SiteError, check, load_site
from fieldlink.store import read_estimates
from fieldlink.upward import Publishing
from fieldlink.web import live_source
from tests.daemon import live
from tests.links.fake_device import FakeDevice
from tests.upward.client import Client
from tests.upward.conftest import until
from tests.upward.mosquitto import Mosquitto


async def test_verdicts_reach_broker_and_opcua_clients_and_commands_the_loop(
    broker_process: Mosquitto, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serving, "EVERY", 0.1)
    device = FakeDevice()
    await device.start()
    site = live.site_for(tmp_path, {"plc": device.port}, estimate_every=1e6)
    with (tmp_path / "site.toml").open("a") as file:
        file.write(
            f'[mqtt]\nhost = "127.0.0.1"\nport = {broker_process.port}\n'
            'formats = ["json"]\ncommands = ["estimate_now", "withdraw"]\n'
            "[opcua_server]\nport = 0\n"
        )
    site = load_site(tmp_path / "site.toml")
    base = "fieldlink/test/plant/PLC"
    async with (
        live.plant_on(device),
        Client(broker_process.port, "fieldlink/#") as host,
        live.running(site) as daemon,
        live_source(daemon) as source,
        opcua_server(site, daemon, source) as server,
    ):

        def received(topic: str) -> list[dict[str, Any]]:
            return [json.loads(data) for name, data, _ in host.received if name == topic]

        await until(lambda: received("fieldlink/test/online"), "the connection")
        host.publish(f"{base}/command/withdraw", '{"reason": "valve replaced"}')
        await until(lambda: received(f"{base}/command/withdraw/result"), "the answer")
        answer = received(f"{base}/command/withdraw/result")[0]
        assert answer["accepted"] is False
        assert answer["message"].endswith("so nothing is written; an order cannot change that")
        await until(lambda: daemon.status().loops["PLC"].filled == 1.0, "a full window")
        host.publish(f"{base}/command/estimate_now", '{"reason": "round trip"}')
        await until(lambda: received(f"{base}/estimate"), "the estimate")
        await until(
            lambda: any(found["event"] == "command.accepted" for found in received(EVENTS)),
            "the event",
        )
        assert server is not None
        await server.listening.wait()
        found = received(f"{base}/estimate")[0]
        assert found["outcome"] in ("estimated", "refused")
        # A machine that misses samples may have a window without a verdict.
        shown = await shown_to_a_client(server.port, has_verdict=found["verdict"] is not None)
    assert ("operator.estimate", "MQTT broker: round trip") in [
        (found["event"], found["message"]) for found in received(EVENTS)
    ]
    stored = read_estimates(site.historian_url).iloc[-1]
    for name, column in (("Verdict", "verdict"), ("Score", "score"), ("StickBand", "stick_band")):
        assert shown[name] == (None if found["verdict"] is None else stored[column])
    assert shown["DeviceHealth"] == {"stiction": 4, "no_stiction": 0}.get(stored["verdict"])
    assert shown["BlockState"] == "not written"
    assert found["loop"] == "PLC"
    await device.stop()


async def shown_to_a_client(port: int | None, *, has_verdict: bool) -> dict[str, Any]:
    """The loop's values in the OPC UA server, once there is a verdict where there will be one."""
    async with OpcuaClient(f"opc.tcp://127.0.0.1:{port}", timeout=60.0) as client:
        verdict = client.get_node("ns=1;s=Loops/PLC/Verdict")
        while (
            has_verdict
            and not (await verdict.read_data_value(raise_on_bad_status=False)).StatusCode.is_good()
        ):
            await asyncio.sleep(0.05)
        names = ("Verdict", "Score", "StickBand", "DeviceHealth", "BlockState")
        nodes = [client.get_node(f"ns=1;s=Loops/PLC/{name}") for name in names]
        return dict(zip(names, await client.read_values(nodes), strict=True))


EVENTS = "fieldlink/test/events"


def _ignore(*_: object, **__: object) -> None:
    """Nothing is told in these tests."""


def test_without_the_package_the_daemon_says_what_to_install(
    make_site: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fieldlink.upward.publishing.find_spec", lambda _: None)
    with pytest.raises(MissingExtraError) as caught:
        Publishing(make_site(1), health=dict, actions={}, tell=_ignore, defect=_ignore)
    assert str(caught.value).endswith(
        "the table [mqtt] needs google.protobuf and paho; "
        "pip install 'fieldlink[mqtt]', or remove the table"
    )


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        ('username = "me"', "username and password_file belong together"),
        ('password_file = "none"\nusername = "me"', "there is no file"),
        ('topic = "a/#"', "which MQTT reserves"),
        ('group = "a/b"', "which MQTT reserves"),
        ('topic = "$SYS"', "begins with $"),
        ('commands = ["write"]', "'write' is unknown"),
        ('[mqtt.tls]\nca = "none.pem"', "there is no file"),
        ("[mqtt.spool]\nmegabytes = 0", "megabytes"),
    ],
)
def test_a_wrong_table_is_one_sentence(
    make_site: Callable[..., Any], extra: str, said: str
) -> None:
    with pytest.raises(SiteError) as caught:
        make_site(1, extra)
    assert said in str(caught.value)
    assert len(caught.value.problems) == 1


def test_a_password_does_not_cross_a_network_unencrypted(
    make_site: Callable[..., Any], tmp_path: Path
) -> None:
    make_site(1)
    (tmp_path / "pw").write_text("x")
    text = (tmp_path / "site.toml").read_text()
    head, mqtt = text.split("[mqtt]")
    text = head + "[mqtt]" + mqtt.replace("127.0.0.1", "192.0.2.7")
    (tmp_path / "site.toml").write_text(f'{text}\nusername = "me"\npassword_file = "pw"\n')
    with pytest.raises(SiteError, match="cross the network unencrypted"):
        load_site(tmp_path / "site.toml")


def test_check_says_what_is_published(make_site: Callable[..., Any]) -> None:
    site = make_site(1883, 'commands = ["withdraw"]')
    assert check(site).upward == (
        "estimates, writebacks, events, findings, health, samples as json and sparkplug to "
        "127.0.0.1:1883 (not encrypted); commands withdraw"
    )
