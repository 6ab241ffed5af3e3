"""The running daemon publishes, and takes the commands that its site file names."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fieldlink.site import SiteError, check, load_site
from fieldlink.upward import Publishing, UpwardError
from tests.daemon import live
from tests.links.fake_device import FakeDevice
from tests.upward.client import Client
from tests.upward.conftest import until
from tests.upward.mosquitto import Mosquitto


async def test_verdicts_reach_the_broker_and_commands_the_loop(
    broker_process: Mosquitto, tmp_path: Path
) -> None:
    device = FakeDevice()
    await device.start()
    site = live.site_for(tmp_path, {"plc": device.port}, estimate_every=1e6)
    with (tmp_path / "site.toml").open("a") as file:
        file.write(
            f'[mqtt]\nhost = "127.0.0.1"\nport = {broker_process.port}\n'
            'formats = ["json"]\ncommands = ["estimate_now", "withdraw"]\n'
        )
    site = load_site(tmp_path / "site.toml")
    base = "fieldlink/test/plant/PLC"
    async with (
        live.plant_on(device),
        Client(broker_process.port, "fieldlink/#") as host,
        live.running(site) as daemon,
    ):

        def received(topic: str) -> list[dict[str, Any]]:
            return [json.loads(data) for name, data, _ in host.received if name == topic]

        await until(lambda: received("fieldlink/test/online"), "the connection")
        host.publish(f"{base}/command/withdraw", '{"reason": "valve replaced"}')
        await until(lambda: received(f"{base}/command/withdraw/result"), "the answer")
        answer = received(f"{base}/command/withdraw/result")[0]
        assert answer["accepted"] is False
        assert "writeback is not enabled" in answer["message"]
        await until(lambda: daemon.status().loops["PLC"].filled == 1.0, "a full window")
        host.publish(f"{base}/command/estimate_now", '{"reason": "round trip"}')
        await until(lambda: received(f"{base}/estimate"), "the estimate")
        await until(
            lambda: any(found["event"] == "command.accepted" for found in received(EVENTS)),
            "the event",
        )
    found = received(f"{base}/estimate")[0]
    assert found["outcome"] in ("estimated", "refused")
    assert found["loop"] == "PLC"
    await device.stop()


EVENTS = "fieldlink/test/events"


def _ignore(*_: object, **__: object) -> None:
    """Nothing is told in these tests."""


def test_without_the_package_the_daemon_says_what_to_install(
    make_site: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fieldlink.upward.publishing.find_spec", lambda _: None)
    with pytest.raises(UpwardError) as caught:
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
        "estimates, writebacks, events, health, samples as json and sparkplug to 127.0.0.1:1883 "
        "(not encrypted); commands withdraw"
    )
