"""What the daemon sends as Sparkplug B, held against the specification on the wire."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from fieldlink.site import load_site
from fieldlink.upward import sparkplug_format
from fieldlink.upward.messages import Message
from fieldlink.upward.sparkplug_node import EdgeNode
from fieldlink.upward.sparkplug_payload import DataType, Metric, Payload, encode
from tests.upward.client import Client
from tests.upward.conftest import event, finding, sample, until, verdict
from tests.upward.mosquitto import Mosquitto
from tests.upward.sparkplug_rules import read_payload, violations
from tests.upward.wiretap import WireTap

GROUP, NODE = "mill 4", "fieldlink"


def verbs(tap: WireTap, connection: int = -1) -> list[str]:
    published = tap.of("-sparkplug")[connection].published
    return ["/".join(packet.topic.split("/")[2::2]) for packet in published]


def metrics_sent(tap: WireTap, verb: str) -> list[Any]:
    return [
        metric
        for connection in tap.of("-sparkplug")
        for packet in connection.published
        if f"/{verb}/" in packet.topic
        for metric in read_payload(packet.payload).metrics
    ]


def assert_conforms(tap: WireTap) -> None:
    assert violations(tap.of("-sparkplug"), GROUP, NODE) == []


def rebirth_request(times: int = 1) -> bytes:
    metric = Metric("Node Control/Rebirth", None, DataType.BOOLEAN, True, 1)
    return encode(Payload((metric,) * times, 1, None))


async def test_a_session_conforms_from_birth_to_death(
    bench: Callable[..., Any], tap: WireTap
) -> None:
    async with bench(tap.port, 'formats = ["sparkplug"]') as running:
        await until(lambda: tap.of("-sparkplug") and len(verbs(tap)) == 3, "births")
        for number in range(300):
            running.put(sample("FC101", number))
        running.put(verdict("FC102", 2.5))
        running.put(event("device.demoted", "plc", "gone"))
        running.put(event("loop.silent", "FC101", "silent"), finding("watch"))
        await until(lambda: running.waiting == 0, "everything delivered")
        running.states["plc"] = "demoted"
        await until(lambda: "DDEATH/FC101" in verbs(tap), "the loop's death")
        running.states["plc"] = "good"
        await until(lambda: verbs(tap).count("DBIRTH/FC101") == 2, "the loop's birth")
    assert verbs(tap)[:3] == ["NBIRTH", "DBIRTH/FC101", "DBIRTH/FC102"]
    assert verbs(tap)[-1] == "NDEATH"  # a clean end makes the broker forget the will
    assert "sticky_valve" in [metric.value for metric in metrics_sent(tap, "DDATA")]
    # more than 256 messages, so the sequence numbers went round
    assert sum(verb == "DDATA/FC101" for verb in verbs(tap)) == 302
    assert_conforms(tap)
    pvs = [metric.value for metric in metrics_sent(tap, "DDATA") if metric.field == 13]
    assert set(map(float, range(300))) <= set(pvs)


async def test_what_does_not_change_is_not_sent(bench: Callable[..., Any], tap: WireTap) -> None:
    async with bench(tap.port, 'formats = ["sparkplug"]') as running:
        await until(lambda: tap.of("-sparkplug") and len(verbs(tap)) == 3, "births")
        for number in range(50):
            running.put(sample("FC101", number, pv=3.0))
        await until(lambda: running.waiting == 0, "everything delivered")
    assert verbs(tap).count("DDATA/FC101") == 1
    assert_conforms(tap)


async def test_a_rebirth_request_gives_births_in_the_same_connection(
    bench: Callable[..., Any], tap: WireTap
) -> None:
    async with bench(tap.port, 'formats = ["sparkplug"]') as running, Client(tap.broker) as host:
        await until(lambda: tap.of("-sparkplug") and len(verbs(tap)) == 3, "births")
        running.put(verdict("FC101", 2.5))
        await until(lambda: running.waiting == 0, "the verdict")
        host.publish(f"spBv1.0/{GROUP}/NCMD/{NODE}", rebirth_request())
        await until(lambda: verbs(tap).count("NBIRTH") == 2, "a rebirth")
        await until(lambda: verbs(tap).count("DBIRTH/FC102") == 2, "the loops' rebirth")
    assert len(tap.of("-sparkplug")) == 1
    assert_conforms(tap)
    births = [metric for metric in metrics_sent(tap, "DBIRTH") if metric.name == "Estimate/Verdict"]
    assert [metric.value for metric in births] == [None, None, "stiction", None]
    numbers = {metric.value for metric in metrics_sent(tap, "NBIRTH") if metric.name == "bdSeq"}
    assert len(numbers) == 1


async def test_a_loop_that_leaves_the_site_dies_before_the_new_births(
    bench: Callable[..., Any], tap: WireTap
) -> None:
    async with bench(tap.port, 'formats = ["sparkplug"]') as running:
        await until(lambda: tap.of("-sparkplug") and len(verbs(tap)) == 3, "births")
        head, _, rest = running.site.path.read_text().partition("[loops.FC102]")
        running.site.path.write_text(f"{head}[mqtt]{rest.partition('[mqtt]')[2]}")
        running.site = load_site(running.site.path)
        running.publishing.follow(running.site)
        await until(lambda: verbs(tap).count("DBIRTH/FC101") == 2, "the births")
    assert verbs(tap)[3:] == ["DDEATH/FC102", "NBIRTH", "DBIRTH/FC101", "NDEATH"]
    assert_conforms(tap)


async def test_a_flood_of_rebirth_requests_gets_one_birth(
    bench: Callable[..., Any], tap: WireTap
) -> None:
    async with bench(tap.port, 'formats = ["sparkplug"]') as running, Client(tap.broker) as host:
        await until(lambda: tap.of("-sparkplug") and len(verbs(tap)) == 3, "births")
        host.publish(f"spBv1.0/{GROUP}/NCMD/{NODE}", rebirth_request(20))
        await until(lambda: verbs(tap).count("NBIRTH") == 2, "a rebirth")
        running.put(sample("FC101", 1))
        await until(lambda: running.waiting == 0, "the sample")
    assert verbs(tap).count("NBIRTH") == 2
    assert_conforms(tap)


async def test_a_host_that_asks_for_births_without_end_gets_a_bounded_number(
    bench: Callable[..., Any], tap: WireTap, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with bench(tap.port, 'formats = ["sparkplug"]') as running, Client(tap.broker) as host:
        await until(lambda: tap.of("-sparkplug") and len(verbs(tap)) == 3, "births")
        monkeypatch.setattr(sparkplug_format, "BIRTHS_WITHIN", 1e6)
        for number in range(40):
            host.publish(f"spBv1.0/{GROUP}/NCMD/{NODE}", rebirth_request())
            running.put(sample("FC101", number))
            await until(lambda: running.waiting == 0, "the sample")
        assert verbs(tap).count("NBIRTH") <= sparkplug_format.BIRTHS_AT_ONCE
        # The last request is answered all the same, when its time has come.
        monkeypatch.setattr(sparkplug_format, "BIRTHS_WITHIN", 0.0)
        more = sparkplug_format.BIRTHS_AT_ONCE + 1
        await until(lambda: verbs(tap).count("NBIRTH") >= more, "the last birth")


def test_events_of_a_spool_from_before_the_site_stopped_publishing_them_hold_nothing_up() -> None:
    node = EdgeNode(GROUP, NODE, ["estimates"], [], "1")
    node.follow(["FC101"], "stream")
    list(node.birth({"devices": [], "loops": {"FC101": "good"}, "store_failing": False}))
    told = Message("event", "plc", 1, {"kind": "device.demoted", "message": "gone"}, 1)
    about_loop = Message("event", "FC101", 1, {"kind": "loop.silent", "message": "silent"}, 2)
    assert [*node.data(told), *node.data(about_loop)] == []


async def test_after_an_outage_history_follows_the_birth_and_nothing_is_missing(
    bench: Callable[..., Any], tap: WireTap, broker_process: Mosquitto
) -> None:
    async with bench(tap.port, 'formats = ["sparkplug"]') as running:
        await until(lambda: tap.of("-sparkplug") and len(verbs(tap)) == 3, "births")
        running.put(sample("FC101", 0))
        await until(lambda: running.waiting == 0, "the first sample")
        await broker_process.kill()
        for number in range(1, 400):
            running.put(sample("FC101", number))
        await until(lambda: running.waiting == 399, "samples on disk")
        await until(lambda: len(tap.of("-sparkplug")) >= 4, "attempts in vain")
        await broker_process.start()
        await until(lambda: running.waiting == 0, "everything delivered")
        running.put(sample("FC101", 400))
        await until(lambda: running.waiting == 0, "the last sample")
    assert_conforms(tap)
    sent = [metric for metric in metrics_sent(tap, "DDATA") if metric.field == 13]
    old = [metric.value for metric in sent if metric.historical and metric.value != -1.0]
    assert list(dict.fromkeys(old)) == [float(number) for number in range(1, 400)]
    assert [metric.value for metric in sent if not metric.historical][-1] == 400.0
    # the birth after the outage had the newest value
    pv = [m.value for m in metrics_sent(tap, "DBIRTH") if m.name == "Sample/PV"]
    assert pv == [None, None, 399.0, None]


def test_the_checker_finds_what_is_wrong() -> None:
    """A checker that finds nothing anywhere would prove nothing."""
    from tests.upward.wiretap import CONNECT, PUBLISH, Connection, Packet

    death = encode(Payload((Metric("bdSeq", None, DataType.INT64, 1, 1),), 1, 5))
    data = encode(Payload((Metric("PV", None, DataType.DOUBLE, 1.0, 1),), 1, 7))
    wire = Connection(
        [
            Packet(CONNECT, f"spBv1.0/{GROUP}/NDEATH/{NODE}", death, qos=0, clean=True),
            Packet(PUBLISH, f"spBv1.0/{GROUP}/DDATA/{NODE}/FC101", data, qos=1),
        ]
    )
    text = "\n".join(violations([wire], GROUP, NODE))
    for rule in (
        "will-message-qos",
        "ndeath-seq",
        "publish-subscribe",
        "ddata-mqtt",
        "incrementing",
        "before NBIRTH",
        "without DBIRTH",
    ):
        assert rule in text
