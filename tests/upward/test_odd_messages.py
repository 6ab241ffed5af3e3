"""Messages that cannot go their way, up or down, hold no other up, and are told by name."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fieldlink.upward.messages import Message
from fieldlink.upward.packets import LONGEST_TOPIC
from fieldlink.upward.sparkplug_payload import DataType, Metric, Payload, encode
from fieldlink.upward.spool import Spool
from tests.upward.client import Client
from tests.upward.conftest import event, sample, until, verdict
from tests.upward.mosquitto import Mosquitto
from tests.upward.test_outages import JSON_ONLY
from tests.upward.wiretap import WireTap

SPARKPLUG_ONLY = 'formats = ["sparkplug"]'


async def test_what_is_larger_than_the_broker_takes_costs_no_connection(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    broker = Mosquitto(tmp_path, extra="max_packet_size 800")
    await broker.start()
    tap = WireTap(broker=broker.port)
    await tap.start()
    async with bench(tap.port, JSON_ONLY) as running:
        loops = {f"L{number}": "good" for number in range(100)}
        health = running.health()
        for delivery in running.publishing._deliveries:
            delivery._health = lambda: health | {"loops": loops}
        running.put(
            sample("FC101", 1),
            replace(verdict("FC101", 3.0), message="x" * 900),
            sample("FC101", 2),
        )
        await until(lambda: running.waiting == 0, "everything else")
        assert running.publishing.report().formats["json"].skipped == 2
    assert len(tap.connections) == 1
    sent = [json.loads(packet.payload).get("id") for packet in tap.connections[0].published]
    assert sent == [None, 1, 3, None]  # online, the samples, offline
    ((_, _, said),) = [found for found in running.events if found[0] == "mqtt.skipped"]
    assert "fieldlink/mill 4/health is left out: it has " in said
    assert "the broker takes at most 800 bytes" in said
    await tap.stop()
    await broker.kill()


async def test_no_message_is_given_up_for_births_that_are_too_large(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    broker = Mosquitto(tmp_path, extra="max_packet_size 400")
    await broker.start()
    async with bench(broker.port, SPARKPLUG_ONLY) as running:
        running.put(*(sample("FC101", number) for number in range(3)))
        await until(lambda: "mqtt.lost" in running.kinds(), "the event")
        await until(lambda: broker.log.count("oversize packet") > 10, "more connections")
        report = running.publishing.report().formats["sparkplug"]
        assert (report.delivered, report.skipped) == (0, 0)
        assert set(running.kinds()) == {"mqtt.lost"}
        assert "it was lost over the births" in running.events[0][2]
    await broker.kill()


async def test_a_message_that_no_packet_can_carry_is_left_out(
    bench: Callable[..., Any], broker_process: Mosquitto, tmp_path: Path
) -> None:
    (tmp_path / "data").mkdir()
    spool = Spool(tmp_path / "data/mqtt_spool.sqlite", ["json"], most_bytes=10**7, longest=1e6)
    spool.open()
    spool.append(
        [
            Message(
                "event", "daemon", time.time_ns() // 1_000_000, {"kind": "x", "message": "\ud800"}
            )
        ]
    )
    spool.close()
    async with (
        Client(broker_process.port, "fieldlink/#") as host,
        bench(broker_process.port, JSON_ONLY) as running,
    ):
        running.put(event("x", "daemon", "half \ud800 a letter"), sample("FC101", 2))
        await until(lambda: running.waiting == -1, "everything")
        assert running.publishing.report().formats["json"].connects == 1
        defects = [found for found in running.events if found[0] == "defect"]
        running.events.clear()
        await until(lambda: any(b'"sample"' in data for _, data, _ in host.received), "the sample")
    assert [found[2].partition("; ")[2] for found in defects] == ["message 1 is left out"]
    assert any(b'"half ? a letter"' in data for _, data, _ in host.received)


async def test_a_command_on_the_longest_topic_stops_nothing(
    bench: Callable[..., Any], broker_process: Mosquitto
) -> None:
    head, tail = "fieldlink/mill 4/a/", "/command/estimate_now"
    topic = head + "y" * (LONGEST_TOPIC - len(head) - len(tail)) + tail
    async with Client(broker_process.port) as other:
        other.publish(topic, b"{}", retain=True)
    async with bench(broker_process.port, f'{JSON_ONLY}\ncommands = ["estimate_now"]') as running:
        running.put(sample("FC101", 1))
        await until(lambda: running.waiting == 0, "the sample")
        assert running.publishing.report().formats["json"].connects == 1
        (said,) = [said for kind, _, said in running.events if kind == "command.refused"]
        assert len(said) < 1000


@pytest.mark.parametrize(("kind", "bits"), [(DataType.INT32, 32), (DataType.INT64, 64)])
def test_a_negative_number_is_its_complement(kind: DataType, bits: int) -> None:
    data = encode(Payload((Metric("a", None, kind, -2, None),), None, None))
    value = 2**bits - 2
    varint = bytearray()
    while value >= 0x80:
        varint.append(value & 0x7F | 0x80)
        value >>= 7
    assert bytes([*varint, value]) in data
