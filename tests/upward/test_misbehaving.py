"""Brokers that end every connection, and messages from above that are not commands."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from typing import Any

import pytest

from fieldlink.upward import connections
from fieldlink.upward.packets import LONGEST_COMMAND
from fieldlink.upward.sparkplug_payload import DataType, Metric, Payload, encode
from tests.upward.client import Client
from tests.upward.conftest import documents, sample, until
from tests.upward.mosquitto import Mosquitto
from tests.upward.wiretap import WireTap

JSON_ONLY = 'formats = ["json"]\ncommands = ["estimate_now"]\n'
TOPIC = "fieldlink/mill 4/U1%2Feast/FC101/command/estimate_now"
CONNACK = {4: b"\x20\x02\x00\x00", 5: b"\x20\x03\x00\x00\x00"}
"""Accepted, for each protocol level."""


@asynccontextmanager
async def ending_broker(port: int, answers: Mapping[int, bytes]) -> AsyncIterator[list[int]]:
    """A broker that takes every connection, gives the answer of its level, and ends it."""
    begun: list[int] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        # Behind the fixed header and the name of the protocol (3.1.2.2).
        begun.append((await reader.read(1000))[8])
        writer.write(answers[begun[-1]])
        await writer.drain()
        # The client answers CONNACK with its first messages.
        await reader.read(1000)
        writer.close()
        await writer.wait_closed()

    server = await asyncio.start_server(serve, "127.0.0.1", port)
    try:
        yield begun
    finally:
        server.close()
        await server.wait_closed()


async def test_a_broker_that_ends_every_connection_fills_no_log_and_loses_nothing(
    bench: Callable[..., Any], tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    broker = Mosquitto(tmp_path)
    async with bench(broker.port, JSON_ONLY) as running:
        running.put(*(sample("FC101", number) for number in range(20)))
        async with ending_broker(broker.port, CONNACK) as begun:
            await until(lambda: len(begun) > 8, "nine connections")
        told = running.kinds()
        assert told.count("mqtt.lost") <= 4
        assert told.count("mqtt.connected") <= 3
        assert running.waiting == 20
        monkeypatch.setattr(connections, "STEADY", 0.1)
        await broker.start()
        await until(lambda: running.waiting == 0, "everything delivered")
        await until(lambda: running.kinds()[-1] == "mqtt.connected", "the steady connection")
    await broker.kill()


async def read_packet(reader: asyncio.StreamReader) -> tuple[int, bytes]:
    """Read one MQTT packet: its type with flags, and what follows the fixed header."""
    kind, length, shift = (await reader.readexactly(1))[0], 0, 0
    while True:
        byte = (await reader.readexactly(1))[0]
        length |= (byte & 127) << shift
        shift += 7
        if not byte & 128:
            return kind, await reader.readexactly(length)


@asynccontextmanager
async def broker_of_strange_topics(port: int) -> AsyncIterator[list[int]]:
    """A broker that follows a subscription with a message whose topic is not UTF-8."""
    begun: list[int] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while True:
                kind, body = await read_packet(reader)
                if kind >> 4 == 1:
                    begun.append(body[6])
                    writer.write(CONNACK[begun[-1]])
                elif kind >> 4 == 8:
                    none = b"\0" if begun[-1] == 5 else b""
                    filters = body[2:].count(b"fieldlink/")
                    suback = body[:2] + none + b"\1" * filters
                    writer.write(bytes([0x90, len(suback)]) + suback)
                    message = b"\0\4a/\xff\xfe" + none + b"{}"
                    writer.write(bytes([0x30, len(message)]) + message)
                await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError):
            writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", port)
    try:
        yield begun
    finally:
        server.close()


async def test_a_topic_that_is_no_text_ends_the_connection_and_no_thread(
    bench: Callable[..., Any], tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    fallen: list[Any] = []
    monkeypatch.setattr(threading, "excepthook", fallen.append)
    port = Mosquitto(tmp_path).port
    async with broker_of_strange_topics(port) as begun, bench(port, JSON_ONLY) as running:
        await until(lambda: len(begun) > 2, "a third connection")
        said = [message for kind, _, message in running.events if kind == "mqtt.lost"]
    assert not fallen
    assert any("a topic that is not UTF-8" in message for message in said)


async def test_two_clients_of_one_name_are_told_once(
    bench: Callable[..., Any], broker_process: Mosquitto
) -> None:
    port = broker_process.port
    async with bench(port, JSON_ONLY) as running:
        report = running.publishing.report
        for _ in range(connections.SHORT_LIVED):
            await until(lambda: report().formats["json"].connected, "the connection")
            before = report().formats["json"].connects
            async with Client(port, client_id="fieldlink-mill 4-json"):
                await until(
                    lambda before=before: report().formats["json"].connects > before, "the next one"
                )
        said = [message for kind, _, message in running.events if kind == "mqtt.unsteady"]
        assert len(said) == 1
        assert "another client has the name fieldlink-mill 4-json" in said[0]
        running.put(sample("FC101", 1))
        await until(lambda: running.waiting == 0, "the delivery")


GARBAGE = (
    b"[" * 5000,
    b"\xff\xfe\x00",
    b'{"reason": "\\ud800", "request": "\\ud800"}',
    b'{"request": NaN}',
    b'{"request": 1e999, "reason": {"a": 1}}',
    b"x" * (LONGEST_COMMAND + 1),
    b"7" * 9000,
)


async def test_a_retained_command_is_refused_once_in_a_connection(
    bench: Callable[..., Any], broker_process: Mosquitto
) -> None:
    extra = 'formats = ["sparkplug"]\ncommands = ["withdraw"]\n'
    metric = Metric("Command/Withdraw", None, DataType.STRING, "of a former life", 1)
    topic = "spBv1.0/mill 4/DCMD/fieldlink/FC101"
    async with Client(broker_process.port) as host:
        host.publish(topic, encode(Payload((metric,), 1, None)), retain=True)
        async with bench(broker_process.port, extra) as running:
            # each delivery is confirmed by a subscription, which brings what is retained again
            for number in range(5):
                running.put(sample("FC101", number))
                await until(lambda: running.waiting == 0, "the delivery")
            assert running.kinds().count("command.refused") == 1
            # the same words without the flag are a command
            host.publish(topic, encode(Payload((metric,), 1, None)))
            await until(lambda: running.commands, "the command")
    assert running.commands == [("withdraw", "FC101", "of a former life")]


async def test_no_message_from_above_holds_up_the_delivery(
    bench: Callable[..., Any], tap: WireTap, broker_process: Mosquitto
) -> None:
    async with Client(broker_process.port, f"{TOPIC}/result") as host:
        host.publish(TOPIC, GARBAGE[0], retain=True)
        async with bench(tap.port, JSON_ONLY) as running:
            await until(lambda: len(host.received) == 1, "the answer to the retained one")
            assert running.commands == []
            for payload in GARBAGE:
                host.publish(TOPIC, payload)
            await until(lambda: len(host.received) == 1 + len(GARBAGE), "all answers")
            running.put(sample("FC101", 1))
            await until(lambda: running.waiting == 0, "the delivery")
            assert "mqtt.lost" not in running.kinds()
    answers = [json.loads(data) for _, data, _ in host.received]
    assert "without the retain flag" in answers[0]["message"]
    assert [answer["accepted"] for answer in answers[1:]] == [True] * 5 + [False, True]
    assert f"{LONGEST_COMMAND + 1} bytes" in answers[6]["message"]
    assert len(running.commands) == 6
    assert all(reason.isprintable() and len(reason) <= 200 for _, _, reason in running.commands)
    assert len(documents(tap, "sample")) == 1
