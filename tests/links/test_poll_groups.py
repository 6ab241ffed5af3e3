"""Loops of different periods on one device: only what is due is asked for."""

from __future__ import annotations

from collections.abc import Sequence

from fieldlink.links import ExceptionReplyError, LinkState, LinkTimeoutError, Quality, VirtualClock
from fieldlink.links.plan_reader import PlanReader
from fieldlink.registers import DataType, Table, Tag, pack_payload, plan_reads

FAST, SLOW = 10, 50
BEAT = 1.0


class Bench:
    """A reader of a fast and a slow register, its clock, and what it asked for."""

    def __init__(self, polls: int = 5, fast_polls: int = 1) -> None:
        tags = [Tag(f"R{n}", Table.HOLDING, n, DataType.UINT16) for n in (FAST, SLOW)]
        plan = plan_reads(tags, polls={f"R{SLOW}": polls, f"R{FAST}": fast_polls})
        self.clock = VirtualClock(0.0)
        self.asked: list[int] = []
        self.errors: list[Exception] = []
        self.reader = PlanReader(plan, self._read, self.clock, beat=BEAT)

    async def _read(self, table: Table, address: int, count: int) -> bytes:
        self.asked.append(address)
        if self.errors and address == SLOW:
            raise self.errors.pop()
        return pack_payload(table, [address] * count)

    async def scans(self, moments: Sequence[float]) -> list[float]:
        """Scan at these moments; return those at which the slow register was read well."""
        read = []
        for moment in moments:
            self.clock.advance_to(moment)
            scan = await self.reader.scan()
            if scan[f"R{SLOW}"].good:
                assert scan[f"R{SLOW}"].monotonic == moment
                read.append(moment)
        return read


async def test_a_slow_request_is_sent_once_in_its_period() -> None:
    bench = Bench()
    assert await bench.scans([float(k) for k in range(20)]) == [0.0, 5.0, 10.0, 15.0]
    assert bench.asked.count(FAST) == 20
    assert bench.asked.count(SLOW) == 4


async def test_jitter_of_less_than_half_a_beat_changes_nothing() -> None:
    bench = Bench()
    moments = [k + (0.4 if k % 3 == 0 else 0.0) for k in range(1, 21)]
    assert await bench.scans(moments) == [1.0, 6.4, 11.0, 16.0]


async def test_a_skipped_beat_is_made_up_for_and_the_next_is_where_it_was() -> None:
    bench = Bench()
    moments = [float(k) for k in range(20) if k not in (5, 10, 11)]
    assert await bench.scans(moments) == [0.0, 6.0, 12.0, 15.0]


async def test_between_two_readings_there_is_none_and_never_an_old_one() -> None:
    bench = Bench()
    await bench.scans([0.0])
    bench.clock.advance_to(1.0)
    reading = (await bench.reader.scan())[f"R{SLOW}"]
    assert reading.quality is Quality.NOT_DUE
    assert reading.value != reading.value


async def test_what_failed_is_asked_for_again_at_the_next_beat() -> None:
    bench = Bench()
    bench.errors = [LinkTimeoutError("plc", "no answer", ""), ExceptionReplyError("plc", "busy", 6)]
    assert await bench.scans([0.0, 1.0, 2.0, 3.0, 4.0, 5.0]) == [2.0, 5.0]


async def test_a_scan_that_asks_for_nothing_tells_nothing_about_the_device() -> None:
    bench = Bench(polls=2, fast_polls=2)
    await bench.scans([0.0])
    assert bench.reader.state is LinkState.GOOD
    bench.errors = [LinkTimeoutError("plc", "no answer", "")] * 2
    bench.reader._plan.reverse()
    await bench.scans([2.0])
    assert bench.reader.state is LinkState.DEMOTED
    bench.clock.advance_to(2.2)
    before = len(bench.asked)
    bench.reader._period_of = {f"R{FAST}": 1, f"R{SLOW}": 1}
    scan = await bench.reader.scan()
    assert len(bench.asked) == before
    assert scan.requests == 0
    assert bench.reader.state is LinkState.DEMOTED
