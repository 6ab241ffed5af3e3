"""The broker is killed, paused and full; the disk's bound is reached; the file is damaged."""

from __future__ import annotations

import asyncio
import json
import sqlite3
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fieldlink.store.errors import StoreError
from fieldlink.store.housekeeping import RetentionClock
from fieldlink.upward.errors import UpwardError
from fieldlink.upward.messages import Message
from fieldlink.upward.spool import Spool
from tests.upward.client import Client
from tests.upward.conftest import documents, event, finding, sample, until
from tests.upward.mosquitto import Mosquitto
from tests.upward.wiretap import PUBLISH, WireTap

JSON_ONLY = 'formats = ["json"]'


def acknowledged(tap: WireTap) -> list[int]:
    """The ids of samples that a broker has taken, in the order of their first sending."""
    found: list[int] = []
    for connection in tap.of("-json"):
        for packet in connection.sent:
            if packet.kind == PUBLISH and packet.number in connection.acknowledged:
                document = json.loads(packet.payload)
                if document.get("kind") == "sample":
                    found.append(document["id"])
    return list(dict.fromkeys(found))


async def test_a_broker_that_is_killed_again_and_again_gets_everything_in_order(
    bench: Callable[..., Any], tap: WireTap, broker_process: Mosquitto
) -> None:
    async with bench(tap.port, JSON_ONLY) as running:
        for number in range(5):
            running.put(*(sample("FC101", 100 * number + step) for step in range(100)))
            await until(lambda put=running.puts: len(acknowledged(tap)) > put - 90, "a part of it")
            await broker_process.kill()
            running.put(*(sample("FC102", 100 * number + step) for step in range(100)))
            await until(lambda: "mqtt.lost" in running.kinds(), "the event")
            await broker_process.start()
        await until(lambda: running.waiting == 0, "everything delivered")
    assert acknowledged(tap) == list(range(1, 1001))
    # repeats have the number of the first sending, so that a consumer drops them by it
    by_id: dict[int, set[tuple[str, float]]] = {}
    for document in documents(tap, "sample"):
        by_id.setdefault(document["id"], set()).add((document["loop"], document["pv"]))
    assert all(len(told) == 1 for told in by_id.values())


async def retained(port: int) -> dict[str, Any]:
    """What a new dashboard gets of findings, by topic."""
    async with Client(port, "fieldlink/mill 4/findings/#", "fieldlink/mill 4/online") as late:
        await until(lambda: any(topic.endswith("online") for topic, _, _ in late.received), "it")
        found = {topic: payload for topic, payload, _ in late.received if payload}
    del found["fieldlink/mill 4/online"]
    return {topic.rpartition("/")[2]: json.loads(payload) for topic, payload in found.items()}


async def test_a_broker_that_has_forgotten_gets_the_open_findings_again(
    bench: Callable[..., Any], tap: WireTap, broker_process: Mosquitto
) -> None:
    """A finding that stands may give no other message for months."""
    async with bench(tap.port, JSON_ONLY) as running:
        running.put(finding("confirmed"), replace(finding("confirmed"), finding="F-8"))
        running.put(replace(finding("closed"), finding="F-8"))
        await until(lambda: running.waiting == 0, "everything delivered")
        await broker_process.kill()
        await until(lambda: "mqtt.lost" in running.kinds(), "the event")
        await broker_process.start()
        await until(lambda: running.kinds().count("mqtt.connected") == 2, "a new connection")
        running.put(sample("FC101", 1))
        await until(lambda: running.waiting == 0, "everything delivered")
        found = await retained(broker_process.port)
    assert found.keys() == {"F-7"}
    assert (found["F-7"]["state"], found["F-7"]["id"]) == ("confirmed", 1)


async def test_findings_whose_messages_were_dropped_are_told_with_the_next_connection(
    bench: Callable[..., Any],
    tap: WireTap,
    broker_process: Mosquitto,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with bench(tap.port, JSON_ONLY) as running:
        running.put(finding("confirmed"))
        await until(lambda: running.waiting == 0, "the first one delivered")
        await broker_process.kill()
        monkeypatch.setattr(running.publishing._spool, "_most_bytes", 100_000)
        running.put(finding("closed"), replace(finding("confirmed"), finding="F-8"))
        running.put(*(event("defect", "daemon", 1000 * "x") for _ in range(200)))
        await until(lambda: running.publishing.report().dropped > 2, "the oldest dropped")
        await broker_process.start()
        await until(lambda: running.kinds().count("mqtt.connected") == 2, "a new connection")
        await until(lambda: "F-8" in told(documents(tap, "finding")), "the second finding")
        found = await retained(broker_process.port)
    assert found.keys() == {"F-8"}


def told(documents: list[dict[str, Any]]) -> set[str]:
    return {str(document["finding"]) for document in documents}


async def test_a_paused_broker_costs_nothing_but_time(
    bench: Callable[..., Any],
    tap: WireTap,
    broker_process: Mosquitto,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with bench(tap.port) as running:
        running.put(sample("FC101", 0))
        await until(lambda: running.waiting == 0, "the first sample")
        broker_process.pause()
        monkeypatch.setattr("fieldlink.upward.broker.ANSWER_WITHIN", 1.0)
        running.put(*(sample("FC101", number) for number in range(1, 200)))
        await until(lambda: running.kinds().count("mqtt.lost") >= 2, "both connections lost")
        broker_process.resume()
        await until(lambda: running.waiting == 0, "everything delivered")
    assert acknowledged(tap) == list(range(1, 201))


async def test_a_full_broker_is_tried_until_there_is_room(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    broker = Mosquitto(tmp_path, listener="max_connections 1\n")
    await broker.start()
    other = await Client(broker.port).__aenter__()
    async with bench(broker.port, JSON_ONLY) as running:
        running.put(sample("FC101", 0))
        await until(lambda: "mqtt.lost" in running.kinds(), "the refusal")
        assert running.waiting == 1
        await other.__aexit__(None, None, None)
        await until(lambda: running.waiting == 0, "the delivery")
    await broker.kill()


async def test_one_message_that_the_broker_refuses_holds_no_other_up(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    broker = Mosquitto(tmp_path, extra="max_packet_size 2000")
    await broker.start()
    tap = WireTap(broker=broker.port)
    await tap.start()
    async with bench(tap.port, JSON_ONLY) as running:
        running.put(*(sample("FC101", number) for number in range(30)))
        running.put(event("defect", "daemon", "x" * 5000))
        running.put(*(sample("FC101", number) for number in range(30, 60)))
        await until(lambda: len(acknowledged(tap)) == 60, "all samples")
        await until(lambda: "mqtt.skipped" in running.kinds(), "the event")
        assert running.publishing.report().formats["json"].skipped == 1
    await tap.stop()
    await broker.kill()


async def test_what_waits_survives_the_process_and_keeps_its_numbers(
    bench: Callable[..., Any], tap: WireTap, broker_process: Mosquitto
) -> None:
    await broker_process.kill()
    async with bench(tap.port, JSON_ONLY) as running:
        running.put(*(sample("FC101", number) for number in range(10)))
    await broker_process.start()
    async with bench(tap.port, JSON_ONLY) as running:
        running.put(sample("FC101", 10))
        await until(lambda: len(acknowledged(tap)) == 11, "everything delivered")
    samples = documents(tap, "sample")
    assert [(found["id"], found["pv"]) for found in samples] == [
        (number + 1, float(number)) for number in range(11)
    ]
    assert len({found["stream"] for found in samples}) == 1


@pytest.fixture
def spool(tmp_path: Path) -> Callable[..., Spool]:
    def make(most_bytes: int = 10**9, longest: float = 1e9) -> Spool:
        made = Spool(tmp_path / "s.sqlite", ["a", "b"], most_bytes=most_bytes, longest=longest)
        made.open()
        return made

    return make


def messages(count: int, utc_ms: int = 0, size: int = 10) -> list[Message]:
    return [Message("event", "x", utc_ms, {"text": "y" * size}) for _ in range(count)]


def test_the_oldest_go_when_the_bound_is_reached(spool: Callable[..., Spool]) -> None:
    bounded = spool(most_bytes=1_000_000)
    for _ in range(40):
        bounded.append(messages(100, round(1000 * time.time()), size=1000))
        bounded.trim()
    left = [message.id for message in bounded.read(0, 10_000)]
    assert left == list(range(left[0], 4001))
    assert 500 < len(left) < 1000
    assert bounded.dropped == 4000 - len(left)
    bounded.close()


def test_what_is_too_old_goes_and_a_clock_that_stepped_tears_no_hole(
    spool: Callable[..., Spool],
) -> None:
    now = round(1000 * time.time())
    aged = spool(longest=3600.0)
    aged.append(messages(3, now - 7_200_000))
    # younger ones that a wrong clock has stamped as old stay, because a newer one came before
    aged.append(messages(2, now))
    aged.append(messages(2, now - 7_200_000))
    assert aged.trim() == 3
    assert [message.id for message in aged.read(0, 10)] == [4, 5, 6, 7]
    aged.close()


def test_a_clock_that_jumps_ahead_drops_nothing(tmp_path: Path) -> None:
    began, ahead = time.time(), [0.0]
    clock = RetentionClock(lambda: began + ahead[0], lambda: 0.0)
    file = tmp_path / "s.sqlite"
    waiting = Spool(file, ["a"], most_bytes=10**9, longest=3600.0, clock=clock)
    waiting.open()
    waiting.append(messages(3, round(1000 * began)))
    ahead[0] = 10.0 * 365.0 * 86_400.0
    assert waiting.trim() == 0
    assert waiting.waiting("a") == 3
    waiting.close()


def test_a_message_leaves_when_every_format_has_delivered_it(spool: Callable[..., Spool]) -> None:
    both = spool()
    both.append(messages(4))
    both.confirm("a", 4, both.stream)
    both.confirm("b", 1, both.stream)
    assert [message.id for message in both.read(both.confirmed("b"), 10)] == [2, 3, 4]
    assert (both.waiting("a"), both.waiting("b")) == (0, 3)
    both.confirm("b", 4, both.stream)
    both.close()
    again = spool()
    assert again.append(messages(1)) == 5  # numbers never come back
    assert [again.next_birth("a") for _ in range(258)] == [*range(256), 0, 1]
    again.close()


def test_a_damaged_file_is_set_aside(spool: Callable[..., Spool], tmp_path: Path) -> None:
    first = spool()
    first.append(messages(3))
    stream = first.stream
    first.close()
    for file in tmp_path.glob("s.sqlite-*"):
        file.unlink()
    (tmp_path / "s.sqlite").write_bytes(b"SQLite format 3\0" + b"\xff" * 5000)
    second = spool()
    assert second.append(messages(1)) == 1
    assert second.stream != stream
    assert len(list(tmp_path.glob("s.damaged-*.sqlite"))) == 1
    second.close()


USES: list[Callable[[Spool], object]] = [
    lambda found: found.read(0, 1000),
    lambda found: found.confirm("a", 200, found.stream),
    lambda found: found.confirm("a", 290, found.stream),
    lambda found: found.trim(),
    lambda found: found.waiting("a"),
]


def zero_pages(file: Path, *, keep: Collection[int] = ()) -> Iterator[int]:
    """Yield after each page of an SQLite file, the first apart, was filled with zeros alone."""
    whole = file.read_bytes()
    for begin in range(4096, len(whole), 4096):
        if begin not in keep:
            file.write_bytes(whole[:begin] + bytes(4096) + whole[begin + 4096 :])
            yield begin
            for one in file.parent.glob(f"{file.stem}*"):
                one.unlink()


def test_damage_that_is_met_while_reading_stops_nothing(
    spool: Callable[..., Spool], tmp_path: Path
) -> None:
    first = spool()
    first.append(messages(300, size=100))
    stream = first.stream
    first.close()
    replaced = 0
    for page in zero_pages(tmp_path / "s.sqlite"):
        found = spool()
        for use in USES:
            use(found)
        replaced += found.set_aside
        # a new file has a new stream, and what comes now is delivered
        last = found.append(messages(3))
        assert (found.stream != stream) == (found.set_aside > 0), page
        assert [message.id for message in found.read(last - 3, 10)] == [last - 2, last - 1, last]
        found.close()
    assert replaced >= 10


def test_a_number_of_the_file_before_confirms_nothing(
    spool: Callable[..., Spool], tmp_path: Path
) -> None:
    found = spool()
    found.append(messages(300, size=100))
    before = found.stream
    found.close()
    (tmp_path / "s.sqlite").write_bytes(b"SQLite format 3\0" + b"\xff" * 5000)
    again = spool()
    again.append(messages(5))
    again.confirm("a", 300, before)
    assert again.waiting("a") == 5
    again.close()


def test_a_spool_that_could_not_be_replaced_is_tried_again(
    spool: Callable[..., Spool], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = spool()
    first.append(messages(300, size=100))
    first.close()
    next(zero_pages(tmp_path / "s.sqlite", keep=range(4096, 40_960)))
    found = spool()

    def refuse(_file: Path) -> Path:
        raise StoreError("cannot be renamed")

    with monkeypatch.context() as patch:
        patch.setattr("fieldlink.upward.spool.set_aside", refuse)
        with pytest.raises(UpwardError, match="cannot be renamed"):
            found.read(0, 1000)
    assert found.read(0, 1000) == []
    assert found.append(messages(1)) == 1
    found.close()


async def test_a_spool_that_cannot_be_opened_at_the_start_is_tried_again(
    bench: Callable[..., Any], broker_process: Mosquitto, tmp_path: Path
) -> None:
    file = tmp_path / "data/mqtt_spool.sqlite"
    file.mkdir(parents=True)
    async with bench(broker_process.port) as running:
        running.put(*(sample("FC101", number) for number in range(5)))
        await until(lambda: "mqtt.lost" in running.kinds(), "the formats' trouble")
        assert running.events[0][0] == "mqtt.spool_failing"
        file.rmdir()
        await until(lambda: running.waiting == 0, "everything delivered")
        assert "mqtt.spool_written" in running.kinds()
        assert "mqtt.spool_replaced" not in running.kinds()


def test_a_spool_that_cannot_be_opened_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "s.sqlite").mkdir()
    refused = Spool(tmp_path / "s.sqlite", ["a"], most_bytes=10**6, longest=1.0)
    with pytest.raises(UpwardError, match=r"s\.sqlite: .*; check the disk and the folder"):
        refused.open()


async def test_a_disk_that_cannot_be_written_delays_and_then_drops_the_oldest(
    bench: Callable[..., Any], tap: WireTap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fieldlink.upward.publishing.MEMORY", 50)
    monkeypatch.setattr("fieldlink.upward.spool.BUSY", 0.02)
    async with bench(tap.port, JSON_ONLY) as running:
        await until(lambda: "mqtt.connected" in running.kinds(), "the connection")
        locker = sqlite3.connect(running.site.data_dir / "mqtt_spool.sqlite")
        locker.execute("BEGIN IMMEDIATE")
        running.put(*(sample("FC101", number) for number in range(30)))
        await until(lambda: "mqtt.spool_failing" in running.kinds(), "the event")
        running.put(*(sample("FC101", number) for number in range(30, 60)))
        locker.rollback()
        locker.close()
        await until(lambda: len(documents(tap, "sample")) == 50, "what memory held")
        await asyncio.sleep(0)
        assert [found["pv"] for found in documents(tap, "sample")] == [
            float(number) for number in range(10, 60)
        ]
        assert running.publishing.report().dropped == 10
        assert "mqtt.dropped" in running.kinds()
