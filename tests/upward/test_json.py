"""Plain JSON on readable topics: what a dashboard reads, and commands by name."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

import pytest

from fieldlink.site import load_site
from fieldlink.upward.sparkplug_payload import DataType, Metric, Payload, encode
from tests.upward.client import Client
from tests.upward.conftest import documents, event, finding, sample, until, verdict
from tests.upward.mosquitto import Mosquitto
from tests.upward.wiretap import WireTap

LOOP = "fieldlink/mill 4/U1%2Feast/FC101"


async def test_a_dashboard_that_comes_later_sees_the_last_verdict(
    bench: Callable[..., Any], tap: WireTap
) -> None:
    async with bench(tap.port, 'formats = ["json"]') as running:
        running.put(verdict("FC101", 2.5), verdict("FC101", 2.75), sample("FC101", 1))
        running.put(event("device.demoted", "plc", "gone"))
        await until(lambda: running.waiting == 0, "everything delivered")
        async with Client(tap.broker, "fieldlink/#") as late:
            await until(lambda: len(late.received) == 3, "the retained messages")
            received = {topic: json.loads(payload) for topic, payload, _ in late.received}
            assert set(received) == {
                "fieldlink/mill 4/online",
                "fieldlink/mill 4/health",
                f"{LOOP}/estimate",
            }
            assert received[f"{LOOP}/estimate"]["stick_band"] == 2.75
            assert received["fieldlink/mill 4/online"]["online"] is True
            assert received["fieldlink/mill 4/health"]["devices"][0]["state"] == "good"
            running.put(sample("FC101", 2, pv=float("nan"), quality=1))
            running.put(event("device.demoted", "plc", "gone again"))
            await until(lambda: len(late.received) == 5, "the new messages")
            (_, reading, _), (place, told, _) = late.received[3:]
            found = json.loads(reading)
            assert (found["op"], found["pv"], found["quality"]) == (-1.0, None, 1)
            assert (found["loop"], found["area"], found["id"]) == ("FC101", "U1/east", 5)
            assert place == "fieldlink/mill 4/events"
            assert json.loads(told)["event"] == "device.demoted"
        running.states["plc"] = "demoted"
        async with Client(tap.broker, "fieldlink/mill 4/health") as late:
            await until(
                lambda: any(b'"demoted"' in payload for _, payload, _ in late.received), "the state"
            )
    async with Client(tap.broker, "fieldlink/mill 4/online") as late:
        await until(lambda: late.received, "the farewell")
        assert json.loads(late.received[0][1])["online"] is False


async def test_an_open_finding_is_retained_and_a_closed_one_leaves_the_broker(
    bench: Callable[..., Any], tap: WireTap
) -> None:
    topic = "fieldlink/mill 4/findings/F-7"
    async with bench(tap.port, 'formats = ["json"]') as running:
        running.put(finding("confirmed", loop=""))
        await until(lambda: running.waiting == 0, "everything delivered")
        async with Client(tap.broker, topic) as late:
            await until(lambda: late.received, "the retained finding")
            told = json.loads(late.received[0][1])
            assert (told["state"], told["cause"], told["candidate"]) == (
                "confirmed", "sticky_valve", None
            )  # fmt: skip
            assert told["loops"] == ["FC101", "FC102"]
            running.put(finding("closed"))
            await until(lambda: len(late.received) == 3, "its end")
            assert json.loads(late.received[1][1])["candidate"] == "FC101"
        async with Client(tap.broker, topic, "fieldlink/mill 4/online") as later:
            await until(lambda: later.received, "a retained message")
            assert [place for place, _, _ in later.received] == ["fieldlink/mill 4/online"]


async def test_what_a_loop_left_behind_leaves_the_broker(
    bench: Callable[..., Any], tap: WireTap
) -> None:
    base = "fieldlink/mill 4"

    async def keeps(*places: str) -> None:
        """Wait until these topics are retained beside those of the site."""
        wanted = {"/online", "/health", *places}
        found: set[str] = set()
        for _ in range(100):
            async with Client(tap.broker, f"{base}/#") as late:
                await asyncio.sleep(0.1)
                found = {topic.removeprefix(base) for topic, _, _ in late.received}
            if found == wanted:
                return
        pytest.fail(f"{found} instead of {wanted}")

    async with bench(tap.port, 'formats = ["json"]') as running:
        running.put(verdict("FC101", 1.0), verdict("FC102", 2.0))
        await until(lambda: running.waiting == 0, "the verdicts")
        await keeps("/U1%2Feast/FC101/estimate", "/plant/FC102/estimate")
        # A reload of the site file: one loop gets another area, the other one is taken out.
        text = running.site.path.read_text().replace("U1/east", "U2")
        head, _, rest = text.partition("[loops.FC102]")
        running.site.path.write_text(f"{head}[mqtt]{rest.partition('[mqtt]')[2]}")
        running.site = load_site(running.site.path)
        running.publishing.follow(running.site)
        running.put(verdict("FC101", 3.0))
        await until(lambda: documents(tap, "left"), "the farewell")
        await until(lambda: running.waiting <= -1, "everything")
        await keeps("/U2/FC101/estimate")
    (told,) = documents(tap, "left")
    assert told["topics"] == [
        f"{base}{place}/{kind}"
        for place in ("/U1%2Feast/FC101", "/plant/FC102")
        for kind in ("estimate", "writeback")
    ]
    # The same while the daemon is down: the site file is as it was at first.
    async with bench(tap.port, 'formats = ["json"]') as running:
        running.put(verdict("FC102", 2.0))
        await until(lambda: len(documents(tap, "left")) == 2, "the farewell")
        await until(lambda: running.waiting <= -1, "everything")
        await keeps("/plant/FC102/estimate")
    numbers = [told["id"] for told in documents(tap) if "id" in told]
    assert numbers == list(range(1, len(numbers) + 1))


async def test_a_daemon_that_dies_is_offline_by_its_will(
    bench: Callable[..., Any], tap: WireTap
) -> None:
    async with (
        bench(tap.port, 'formats = ["json"]') as running,
        Client(tap.broker, "fieldlink/mill 4/online") as watching,
    ):
        await until(lambda: watching.received, "online")
        await tap.stop()
        await until(lambda: len(watching.received) == 2, "the will")
        assert [json.loads(payload)["online"] for _, payload, _ in watching.received] == [
            True,
            False,
        ]
        await until(lambda: "mqtt.lost" in running.kinds(), "the event")
        await tap.start()


@pytest.mark.parametrize(
    ("command", "retained", "accepted", "said"),
    [
        ("FC101/command/estimate_now", False, True, "accepted"),
        ("FC101/command/withdraw", False, False, "the site file does not allow it"),
        ("FC101/command/estimate_now", True, False, "without the retain flag"),
        ("FC999/command/estimate_now", False, False, "the site has no such loop"),
    ],
)
async def test_commands_are_those_of_the_site_file_and_events(
    bench: Callable[..., Any],
    tap: WireTap,
    command: str,
    retained: bool,
    accepted: bool,
    said: str,
) -> None:
    topic = f"fieldlink/mill 4/U1%2Feast/{command}"
    extra = 'formats = ["json"]\ncommands = ["estimate_now"]'
    async with Client(tap.broker, f"{topic}/result") as operator:
        if retained:
            operator.publish(topic, '{"reason": "old"}', retain=True)
        async with bench(tap.port, extra) as running:
            await until(lambda: "mqtt.connected" in running.kinds(), "the connection")
            if not retained:
                operator.publish(topic, '{"reason": "night shift", "request": 7}')
            await until(lambda: operator.received, "the answer")
    answer = json.loads(operator.received[0][1])
    assert answer["accepted"] is accepted
    assert said in answer["message"]
    kinds = [kind for kind in running.kinds() if kind.startswith("command.")]
    assert kinds == ["command.accepted" if accepted else "command.refused"]
    assert running.commands == ([("estimate_now", "FC101", "night shift")] if accepted else [])


async def test_without_a_list_no_command_is_even_heard(
    bench: Callable[..., Any], tap: WireTap
) -> None:
    async with bench(tap.port) as running, Client(tap.broker) as operator:
        await until(lambda: running.kinds().count("mqtt.connected") == 2, "the connections")
        operator.publish(f"{LOOP}/command/withdraw", "{}")
        metric = Metric("Command/Withdraw", None, DataType.STRING, "go", 1)
        operator.publish("spBv1.0/mill 4/DCMD/fieldlink/FC101", encode(Payload((metric,), 1, None)))
        await until(lambda: "command.refused" in running.kinds(), "the refusal")
    assert running.commands == []
    assert [packet for found in tap.of("-json") for packet in found.sent if packet.topics] == []


async def test_sparkplug_hosts_command_by_name_or_alias(
    bench: Callable[..., Any], tap: WireTap
) -> None:
    extra = 'formats = ["sparkplug"]\ncommands = ["withdraw", "estimate_now"]'
    async with bench(tap.port, extra) as running, Client(tap.broker) as host:
        await until(lambda: "mqtt.connected" in running.kinds(), "the connection")
        for metric in (
            Metric("Command/Withdraw", None, DataType.STRING, "valve serviced", 1),
            Metric("Command/Estimate Now", None, DataType.BOOLEAN, True, 1),
        ):
            data = encode(Payload((metric,), 1, None))
            host.publish("spBv1.0/mill 4/DCMD/fieldlink/FC102", data)
        await until(lambda: len(running.commands) == 2, "the commands")
        host.publish("spBv1.0/mill 4/NCMD/fieldlink", b"\xff no payload")
        await until(lambda: "command.refused" in running.kinds(), "the refusal")
    assert running.commands == [
        ("withdraw", "FC102", "valve serviced"),
        ("estimate_now", "FC102", "no reason given"),
    ]


async def test_tls_user_and_password_come_from_files_and_are_shown_nowhere(
    bench: Callable[..., Any], tmp_path: Any
) -> None:
    import subprocess

    import trustme

    authority = trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    server = authority.issue_cert("127.0.0.1")
    server.cert_chain_pems[0].write_to_path(tmp_path / "server.pem")
    server.private_key_pem.write_to_path(tmp_path / "server.key")
    ours = authority.issue_cert("fieldlink.example")
    ours.cert_chain_pems[0].write_to_path(tmp_path / "our.pem")
    ours.private_key_pem.write_to_path(tmp_path / "our.key")
    (tmp_path / "password").write_text("s3cret-word\n")
    (tmp_path / "users").touch(mode=0o600)
    broker = Mosquitto(
        tmp_path,
        extra=f"password_file {tmp_path}/users",
        listener=(
            f"cafile {tmp_path}/ca.pem\ncertfile {tmp_path}/server.pem\n"
            f"keyfile {tmp_path}/server.key\nrequire_certificate true\n"
        ),
    )
    subprocess.run(
        ["mosquitto_passwd", "-b", str(tmp_path / "users"), "edge", "s3cret-word"], check=True
    )
    await broker.start()
    extra = (
        'username = "edge"\npassword_file = "password"\nformats = ["json"]\n'
        '[mqtt.tls]\nca = "ca.pem"\ncert = "our.pem"\nkey = "our.key"\n'
    )
    async with bench(broker.port, extra) as running:
        running.put(verdict("FC101", 2.5))
        await until(lambda: running.waiting == 0, "the delivery")
        assert "s3cret" not in repr(vars(running.publishing))
    (tmp_path / "password").write_text("wrong\n")
    async with bench(broker.port, extra) as running:
        await until(lambda: "mqtt.lost" in running.kinds(), "the refusal")
    message = next(message for kind, _, message in running.events if kind == "mqtt.lost")
    assert "Not authorized" in message
    assert "wrong" not in message
    await broker.kill()
