"""Orders of operators: they hold at the moment of writing, and make nothing bolder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.operators.orders import Action, Order, OrderError
from fieldlink.daemon.site_runner import SiteRunner
from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.daemon.writeback.standing_orders import StandingOrders
from fieldlink.errors import FieldlinkError
from fieldlink.links import SystemClock
from fieldlink.registers import ExchangeLayout
from fieldlink.site import load_site
from fieldlink.store import (
    EventRecord,
    Historian,
    read_estimates,
    read_events,
    read_writebacks,
)
from tests.daemon.bench import Bench

Make = Callable[..., Findings]

WRITEBACK = """
[loops.LOOP.writeback]
enabled = true
loop_id = 101
base = 100
min_windows = 1
min_interval = 0.0
"""


async def test_on_hold_the_newest_model_waits_and_the_block_in_force_stays(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    orders = StandingOrders()
    b = bench(orders=orders)
    await b.write(findings(7.0))
    seq = b.plc.state.ack_seq
    orders.hold = "B. Okafor: watched today"
    b.submit(findings(9.0, 5.0))
    beats = device.words[layout.heartbeat]
    await b.seconds(20)
    assert b.outcomes[-1] is WritebackOutcome.ON_HOLD
    assert b.plc.state.ack_seq == seq
    assert b.plc.state.in_force is not None
    assert device.words[layout.heartbeat] != beats
    orders.hold = ""
    await b.seconds(5)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED
    assert b.plc.state.ack_seq != seq


async def test_a_cleared_enable_bit_is_why_a_block_is_not_used(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    b = bench()
    await b.write(findings(7.0))
    assert (b.writeback.compensates, b.writeback.unused) == (True, "")
    device.words[layout.enable] = 0
    await b.seconds(5)
    assert b.writeback.compensates is False
    assert b.writeback.unused.startswith("the PLC's enable bit is off")
    device.words[layout.enable] = 1
    await b.seconds(5)
    assert (b.writeback.compensates, b.writeback.unused) == (True, "")


async def test_switched_off_not_a_register_is_written_and_the_plc_drops_its_model(
    bench: Callable[..., Bench], findings: Make, device: Any
) -> None:
    orders = StandingOrders()
    b = bench(orders=orders)
    await b.write(findings(7.0))
    assert b.writeback.compensates
    orders.off = "B. Okafor: stop"
    written = len(device.writes)
    b.submit(findings(9.0, 5.0))
    await b.seconds(30)
    assert len(device.writes) == written
    assert b.plc.state.in_force is None
    assert b.writeback.compensates is False
    assert "no heartbeat reaches the PLC" in b.writeback.unused
    assert b.outcomes[-1] is WritebackOutcome.SWITCHED_OFF
    with pytest.raises(FieldlinkError, match="switched off"):
        b.writeback.withdraw("repair", 0.0)
    orders.off = ""
    await b.seconds(10)
    assert b.outcomes[-1] is WritebackOutcome.ACCEPTED
    assert b.plc.state.in_force is not None


async def test_an_order_that_comes_between_bank_and_commit_stops_the_commit(
    bench: Callable[..., Bench], findings: Make, device: Any, layout: ExchangeLayout
) -> None:
    orders = StandingOrders()

    async def order() -> None:
        orders.hold = "B. Okafor: not now"

    b = bench(orders=orders)
    committed = device.words[layout.commit]
    b.submit(findings(7.0))
    original = b.writeback._exchange.write_bank

    async def write_bank(*arguments: Any, **options: Any) -> Any:
        found = await original(*arguments, **options)
        await order()
        return found

    b.writeback._exchange.write_bank = write_bank  # type: ignore[method-assign]
    await b.seconds(10)
    assert device.words[layout.commit] == committed
    assert b.outcomes[-1] is WritebackOutcome.ON_HOLD


async def test_orders_are_recorded_outlive_the_daemon_and_cannot_enable_what_the_site_forbids(
    device: Any, tmp_path: Path, live: Any
) -> None:
    site = live.site_for(
        tmp_path, {"plc": device.port}, WRITEBACK, window=160, estimate_every=40_000.0
    )
    async with live.plant_on(device):
        async with live.running(site) as daemon:
            await live.until(lambda: daemon.started.is_set(), "started")
            with pytest.raises(OrderError, match="% full"):
                daemon.carry_out(Order("PLC", Action.ESTIMATE, "A. Meyer", "look"))
            with pytest.raises(OrderError, match="not on hold"):
                daemon.carry_out(Order("PLC", Action.ACCEPT, "A. Meyer", "go on"))
            daemon.carry_out(Order("PLC", Action.HOLD, "A. Meyer", "watched\ntoday"))
            await live.until(lambda: daemon.status().loops["PLC"].filled == 1.0, "a window")
            daemon.carry_out(Order("PLC", Action.ESTIMATE, "A. Meyer", "look"))
            with pytest.raises(OrderError, match="judged already"):
                daemon.carry_out(Order("PLC", Action.ESTIMATE, "A. Meyer", "again"))
            await live.until(lambda: daemon.status().loops["PLC"].estimates == 1, "by hand")
            assert daemon.status().loops["PLC"].attempts == 0
        async with live.running(site) as daemon:
            await live.until(lambda: daemon.started.is_set(), "started")
            assert daemon.status().loops["PLC"].hold == "A. Meyer: watched today"
    events = read_events(site.historian_url)
    held = events[events["kind"] == "operator.hold"].iloc[0]
    assert held["source"] == "PLC"
    assert held["detail"] == {
        "who": "A. Meyer",
        "why": "watched\ntoday",
        "device": "plc",
        "loop_id": 101,
    }
    assert "accepted" not in set(read_writebacks(site.historian_url)["outcome"])
    window = read_estimates(site.historian_url)["document"].iloc[0]["window"]
    # OP moves by 6 in 40 s, and so all day.
    assert window["travel_per_day"] == pytest.approx(0.15 * 86_400, rel=0.05)
    assert window["automatic"] is None
    forbidden = live.site_for(tmp_path, {"plc": device.port})
    async with live.running(forbidden) as daemon:
        await live.until(lambda: daemon.started.is_set(), "started")
        with pytest.raises(OrderError, match="not enabled in the site file"):
            daemon.carry_out(Order("PLC", Action.WRITEBACK_ON, "A. Meyer", "please"))


async def test_orders_of_a_loop_that_got_another_name_while_no_daemon_ran(
    tmp_path: Path, live: Any
) -> None:
    site = live.site_for(tmp_path, {"plc": 502}, WRITEBACK)
    text = site.path.read_text()

    async def begin(name: str, loop_id: int) -> tuple[SiteRunner, list[Any]]:
        """What a daemon knows and tells that begins with this name and number of the loop."""
        told: list[Any] = []
        changed = text.replace("[loops.PLC", f"[loops.{name}")
        site.path.write_text(changed.replace("loop_id = 101", f"loop_id = {loop_id}"))
        runner = SiteRunner(load_site(site.path), SystemClock(), told.append)
        await runner.resume_from(site.historian_url)
        return runner, told

    def store(*records: Any) -> None:
        historian = Historian(site.historian_url, live.STORE)
        historian.start(EventRecord(0, "daemon.start", "daemon", ""))
        for record in records:
            historian.put(record)
        historian.stop()

    first = SiteRunner(site, SystemClock(), lambda _: None).loop("PLC")
    assert first is not None
    store(Order("PLC", Action.HOLD, "A. Meyer", "watched").record(0, first.spec))

    # The PLC knows it by the same number: the same valve.
    runner, told = await begin("FIC101", 101)
    assert runner.orders["FIC101"].hold == "A. Meyer: watched"
    assert [(event.kind, event.source) for event in told] == [
        ("loop.renamed", "FIC101"),
        ("operator.hold", "FIC101"),
        ("loop.left", "PLC"),
    ]
    # Another valve: nothing is carried over, and one event reports it.
    runner, told = await begin("FIC102", 102)
    assert runner.orders["FIC102"].hold == ""
    (left,) = told
    assert left.message == (
        "the site file has no loop of this name any more; its orders are not carried over: on hold "
        "(A. Meyer: watched), since 1970-01-01 00:00 UTC; if it has another name now, give them "
        "again"
    )
    store(left)
    assert (await begin("FIC102", 102))[1] == []
    # It comes back.
    runner, told = await begin("PLC", 101)
    assert (runner.orders["PLC"].hold, told) == ("A. Meyer: watched", [])


@pytest.mark.parametrize(
    ("who", "why", "message"), [("", "x", "who is empty"), ("x", " ", "why is empty")]
)
def test_an_order_without_a_name_or_a_reason_is_refused(who: str, why: str, message: str) -> None:
    with pytest.raises(OrderError, match=message):
        Order("PLC", Action.HOLD, who, why)
