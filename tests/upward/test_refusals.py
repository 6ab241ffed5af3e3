"""Brokers that refuse: messages by their access rules, MQTT 5, many messages at once."""

from __future__ import annotations

import asyncio
import gc
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from tests.upward.conftest import event, sample, until
from tests.upward.mosquitto import Mosquitto
from tests.upward.test_outages import JSON_ONLY, acknowledged
from tests.upward.wiretap import WireTap


async def test_what_access_rules_forbid_waits_until_they_allow_it(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    rules = tmp_path / "rules"
    rules.write_text("topic write plant/#\n")
    broker = Mosquitto(tmp_path, extra=f"acl_file {rules}")
    await broker.start()
    tap = WireTap(broker=broker.port)
    await tap.start()
    async with bench(tap.port, JSON_ONLY) as running:
        running.put(*(sample("FC101", number) for number in range(20)))
        await until(lambda: "mqtt.lost" in running.kinds(), "the event")
        assert running.events[0][2].endswith(
            "refuses messages on fieldlink/mill 4/online: Not authorized; give our user the right "
            "to publish there"
        )
        assert running.waiting == 20
        rules.write_text("topic write fieldlink/#\n")
        broker.reload()
        await until(lambda: running.waiting == 0, "everything delivered")
    assert acknowledged(tap) == list(range(1, 21))
    await tap.stop()
    await broker.kill()


async def test_a_password_that_is_put_right_is_used_for_the_next_connection(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    users, password = tmp_path / "users", tmp_path / "password"
    users.write_text("edge:s3cret-word\n")
    subprocess.run(["mosquitto_passwd", "-U", str(users)], check=True)
    password.write_text("wrong\n")
    password.chmod(0o600)
    broker = Mosquitto(tmp_path, extra=f"password_file {users}")
    await broker.start()
    table = f'{JSON_ONLY}\nusername = "edge"\npassword_file = "password"'
    async with bench(broker.port, table) as running:
        running.put(*(sample("FC101", number) for number in range(5)))
        await until(lambda: "mqtt.lost" in running.kinds(), "the refusal")
        assert "Not authorized; check user, password" in running.events[0][2]
        password.unlink()
        await asyncio.sleep(0.5)
        password.write_text("s3cret-word\n")
        password.chmod(0o600)
        await until(lambda: running.waiting == 0, "everything delivered")
    await broker.kill()


async def test_a_topic_that_is_forbidden_alone_holds_no_other_up(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    rules = tmp_path / "rules"
    rules.write_text("topic write fieldlink/#\ntopic deny fieldlink/mill 4/events\n")
    broker = Mosquitto(tmp_path, extra=f"acl_file {rules}")
    await broker.start()
    tap = WireTap(broker=broker.port)
    await tap.start()
    async with bench(tap.port, JSON_ONLY) as running:
        running.put(sample("FC101", 0), event("defect", "daemon", "x"), sample("FC101", 1))
        await until(lambda: running.waiting == 1, "the samples")
        assert running.publishing.report().formats["json"].skipped == 1
        assert "mqtt.skipped" in running.kinds()
    assert acknowledged(tap) == [1, 3]
    await tap.stop()
    await broker.kill()


@dataclass
class OldBroker(WireTap):
    """A broker that serves MQTT 3.1.1 only, and says so or does not."""

    answer: bytes = b""

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = await reader.readexactly(9)
        if head[8] == 4:
            rest = asyncio.StreamReader()
            rest.feed_data(head)
            passing = asyncio.create_task(_feed(reader, rest))
            await super().serve(rest, writer)
            passing.cancel()
            return
        writer.write(self.answer)
        await writer.drain()
        writer.close()
        await writer.wait_closed()


async def _feed(source: asyncio.StreamReader, target: asyncio.StreamReader) -> None:
    while data := await source.read(10_000):
        target.feed_data(data)
    target.feed_eof()


@pytest.mark.parametrize(
    "answer",
    [
        b"\x20\x02\x00\x01",
        b"",
        b"\x20\x03\x00\x9a\x00",
        b"\x20\x05\x00\x00\x02\x25\x00",
    ],
    ids=["version", "closed", "retain refused", "no retain"],
)
async def test_a_broker_that_serves_mqtt_3_1_1_only_is_served_without_a_word(
    bench: Callable[..., Any], broker_process: Mosquitto, answer: bytes
) -> None:
    old = OldBroker(broker=broker_process.port, answer=answer)
    await old.start()
    async with bench(old.port, JSON_ONLY) as running:
        running.put(*(sample("FC101", number) for number in range(20)))
        await until(lambda: running.waiting == 0, "everything delivered")
        assert running.kinds() == ["mqtt.connected"]
    assert acknowledged(old) == list(range(1, 21))
    assert {connection.level for connection in old.connections} == {4}
    await old.stop()


async def test_no_more_is_under_way_than_the_broker_takes(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    broker = Mosquitto(tmp_path, extra="max_inflight_messages 3")
    await broker.start()
    tap = WireTap(broker=broker.port)
    await tap.start()
    async with bench(tap.port, JSON_ONLY) as running:
        running.put(*(sample("FC101", number) for number in range(200)))
        await until(lambda: running.waiting == 0, "everything delivered")
    assert acknowledged(tap) == list(range(1, 201))
    (connection,) = tap.connections
    assert connection.level == 5
    assert connection.most_under_way <= 3
    await tap.stop()
    await broker.kill()


async def _started_with(certificate: Any, folder: Path) -> Mosquitto:
    """A broker that shows a certificate."""
    certificate.cert_chain_pems[0].write_to_path(folder / "server.pem")
    certificate.private_key_pem.write_to_path(folder / "server.key")
    broker = Mosquitto(
        folder, listener=f"certfile {folder}/server.pem\nkeyfile {folder}/server.key\n"
    )
    await broker.start()
    return broker


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    ("fault", "remedy"),
    [
        ("another name", "write the host as the certificate names it"),
        ("another authority", "name the file of its authority in mqtt.tls.ca"),
        ("expired", "renew it there, or check this machine's clock"),
    ],
)
async def test_a_broker_with_a_wrong_certificate_gets_nothing(
    bench: Callable[..., Any], tmp_path: Path, fault: str, remedy: str
) -> None:
    import trustme

    authority, other = trustme.CA(), trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    named = authority.issue_cert("broker.example")
    server = other.issue_cert("127.0.0.1")
    if fault == "another name":
        server = named
    elif fault == "expired":
        server = authority.issue_cert("127.0.0.1", not_after=datetime(2020, 1, 1, tzinfo=UTC))
    broker = await _started_with(server, tmp_path)
    async with bench(broker.port, f'{JSON_ONLY}\n[mqtt.tls]\nca = "ca.pem"') as running:
        running.put(sample("FC101", 1))
        await until(lambda: "mqtt.lost" in running.kinds(), "the event")
        assert remedy in running.events[0][2]
        assert "_ssl" not in running.events[0][2]
        assert running.waiting == 1
    assert "PUBLISH" not in broker.log
    await broker.kill()
    # paho does not close the socket of a handshake that failed.
    gc.collect()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
async def test_a_broker_that_does_not_trust_us_is_told_with_the_remedy(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    import trustme

    authority, other = trustme.CA(), trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    for name, of in {"server": authority, "our": other}.items():
        certificate = of.issue_cert("127.0.0.1")
        certificate.cert_chain_pems[0].write_to_path(tmp_path / f"{name}.pem")
        certificate.private_key_pem.write_to_path(tmp_path / f"{name}.key")
    broker = Mosquitto(
        tmp_path,
        listener=f"cafile {tmp_path}/ca.pem\ncertfile {tmp_path}/server.pem\n"
        f"keyfile {tmp_path}/server.key\nrequire_certificate true\n",
    )
    await broker.start()
    tls = '[mqtt.tls]\nca = "ca.pem"\ncert = "our.pem"\nkey = "our.key"\n'
    async with bench(broker.port, f"{JSON_ONLY}\n{tls}") as running:
        running.put(sample("FC101", 1))
        await until(lambda: "mqtt.lost" in running.kinds(), "the event")
        assert "a mqtt.tls.cert that is still valid" in running.events[0][2]
        assert running.waiting == 1
    await broker.kill()
    gc.collect()


async def test_certificates_that_are_of_no_use_at_the_start_hold_up_nothing_but_the_broker(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    import trustme

    authority = trustme.CA()
    (tmp_path / "ca.pem").write_text("no certificate\n")
    server = authority.issue_cert("127.0.0.1")
    broker = await _started_with(server, tmp_path)
    async with bench(broker.port, f'{JSON_ONLY}\n[mqtt.tls]\nca = "ca.pem"') as running:
        running.put(*(sample("FC101", number) for number in range(5)))
        await until(lambda: "mqtt.lost" in running.kinds(), "the event")
        assert "a certificate or key cannot be used" in running.events[0][2]
        assert "give PEM files" in running.events[0][2]
        said = CliRunner().invoke(app, ["check", str(tmp_path / "site.toml")])
        assert said.exit_code == 0
        assert "nothing can be published: " in said.output
        authority.cert_pem.write_to_path(tmp_path / "ca.pem")
        await until(lambda: running.waiting == 0, "everything delivered")
        said = CliRunner().invoke(app, ["check", str(tmp_path / "site.toml")])
        assert "nothing can be published" not in said.output
    await broker.kill()
