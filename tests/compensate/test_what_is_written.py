"""Whatever PLC, operator and network do: OP is written only as docs/compensation.md permits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random

import pytest

from compensator import PiController, PiSettings
from fieldlink.compensate import service as service_module
from fieldlink.compensate.service import CompensateService, Step, Verdict
from fieldlink.lab.study.closed_loop import EXAMPLE_1, Plant
from fieldlink.links import LinkTimeoutError, Quality, Scan
from fieldlink.links.base import Reading
from fieldlink.registers import (
    Bank,
    DataType,
    ParameterBlock,
    Table,
    Tag,
    decode,
    encode_block,
)
from fieldlink.site import load_site
from tests.compensate.test_service import AREA, make_site
from tests.seeds import in_suite

LOW, HIGH, RATE = 20.0, 80.0, 3.0
"""Of `make_site`."""
TIMEOUT = 5
"""Scans after the last write in which the PLC's own controller has not taken over yet."""
SCANS = 700
FAULT, HEAL = 0.02, 0.015
"""Shares of the scans in which something goes wrong, and all is put right with a new block."""


class Plc:
    """A loop, its registers, what may go wrong with both, and a link to it that is no network."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.plant = Plant(EXAMPLE_1.process, EXAMPLE_1.valve, 50.0, 48.0)
        self.own = PiController(PiSettings(0.8, 10.0, 1.0))
        self.registers = dict.fromkeys(range(400), 0)
        self.op, self.pv, self.sp = 50.0, 50.0, 54.0
        self.automatic = self.beats = self.answers = self.takes_writes = True
        self.pv_good = True
        self.forced: float | None = None
        self.count, self.beat_at, self.seq, self.client = 0, -99, 0, 0
        self.written: list[tuple[int, list[int]]] = []

    def cycle(self) -> None:
        """Let a second pass."""
        self.pv = self.plant.pv + self.random.gauss(0.0, 0.02)
        self.own.observe(self.pv, self.op)
        self.client -= 1
        if self.automatic and self.client <= 0:
            self.op = self.own.decide(self.sp).op
        self.op = self.op if self.forced is None else self.forced
        self.plant.step(self.op)
        self.count += 1
        if self.beats:
            self.registers[AREA.heartbeat] = self.count % 65536
            self.beat_at = self.count

    def commit(self, bank: Bank) -> None:
        self.seq = self.seq % 65535 + 1
        block = ParameterBlock.from_model(
            EXAMPLE_1,
            loop_id=101,
            seq=self.seq,
            valid_for=86_400,
            window_end_ms=round(1000.0 * self.utc()),
        )
        self._put(AREA.bank_address(bank), encode_block(block))
        self._put(AREA.ack_seq, [self.seq])
        self._put(AREA.active_bank, [bank])

    def disturb(self) -> None:
        """Let one of the things happen that do."""
        r, flip = self.random, self.random.choice([True, False])
        bank = AREA.bank_address(r.choice([Bank.A, Bank.B]))
        happenings: list[Callable[[], None]] = [
            lambda: self._put(AREA.enable, [int(flip)]),
            lambda: setattr(self, "automatic", flip),
            lambda: setattr(self, "beats", flip),
            lambda: setattr(self, "answers", flip),
            lambda: setattr(self, "takes_writes", flip),
            lambda: setattr(self, "pv_good", flip),
            lambda: setattr(self, "sp", r.uniform(30.0, 75.0)),
            lambda: setattr(self, "forced", r.uniform(0.0, 100.0) if flip else None),
            lambda: self._put(bank, [r.randrange(65536) for _ in range(40)]),
            lambda: self._put(bank, [0] * 94),
            lambda: self._put(AREA.ack_seq, [r.choice([0, 1, 65535])]),
            lambda: self._put(AREA.active_bank, [r.choice([0, 1, 2, 65535])]),
            lambda: self._put(100, [0 if flip else 65535] * 210),
            lambda: self.commit(r.choice([Bank.A, Bank.B])),
        ]
        r.choice(happenings)()

    def heal(self) -> None:
        self.automatic = self.beats = self.answers = self.takes_writes = self.pv_good = True
        self.forced = None
        self._put(AREA.enable, [1])
        self.commit(Bank.B)

    def _put(self, address: int, words: Sequence[int]) -> None:
        self.registers.update(enumerate(words, address))

    def monotonic(self) -> float:
        return self.count / 40.0

    def utc(self) -> float:
        return 1.7e9 + self.count / 40.0

    async def open(self) -> None: ...

    async def close(self) -> None: ...

    async def scan(self) -> Scan:
        values = {"OP": self.op, "PV": self.pv, "SP": self.sp, "MODE": float(self.automatic)}
        good = {name: self.answers and (name != "PV" or self.pv_good) for name in values}
        readings = {
            f"FC101.{name}": Reading(
                value if good[name] else math.nan,
                Quality.GOOD if good[name] else Quality.NOT_READ,
                self.monotonic(),
                self.utc(),
            )
            for name, value in values.items()
        }
        return Scan(readings, self.monotonic(), self.utc(), 1)

    async def read_registers(self, address: int, count: int) -> list[int]:
        if not self.answers:
            raise LinkTimeoutError("plc", "no reply", "wait")
        return [self.registers[address + k] for k in range(count)]

    async def write_registers(self, address: int, words: Sequence[int]) -> None:
        self.written.append((address, list(words)))
        if not self.takes_writes:
            raise LinkTimeoutError("plc", "no reply", "wait")
        if address == 0 and self.automatic:
            self.op, self.client = float(decode(words, DataType.FLOAT32)), TIMEOUT

    async def write_register(self, address: int, word: int) -> None:
        raise AssertionError(f"nothing is written with FC6, {word} was to {address}")


def assert_permitted(plc: Plc, step: Step, before: Verdict) -> None:
    """Judge what was written in a scan by what the PLC held then."""
    for address, words in plc.written:
        assert plc.registers[AREA.enable] & 1
        assert address in (0, AREA.ack_refusal)
        if address != 0:
            continue
        op = float(decode(words, DataType.FLOAT32))
        assert LOW <= op <= HIGH
        # Where OP is read a little outside, the range comes before the rate.
        assert abs(op - step.op_before) <= RATE + 0.01 * (HIGH - LOW)
        assert plc.automatic
        assert plc.count - plc.beat_at <= 10
        assert plc.registers[AREA.ack_seq] != 0
        assert plc.registers[AREA.active_bank] in (0, 1)
        if before in (Verdict.WAITING, Verdict.NO_MODEL, Verdict.MANUAL, Verdict.PLC_DISABLED):
            assert op == pytest.approx(step.op_before, abs=1e-4)
    plc.written.clear()


@pytest.mark.parametrize("seed", in_suite(3, range(40)))
async def test_nothing_is_written_that_is_not_permitted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    plc, site = Plc(seed), make_site(tmp_path)
    monkeypatch.setattr(service_module, "link_to", lambda *_, **__: plc)

    async def start() -> CompensateService:
        begun = CompensateService(site, "FC101", write=True, clock=plc, tell=lambda _: None)
        await begun.open()
        return begun

    service, verdict, writes = await start(), Verdict.NO_MODEL, 0
    plc.heal()
    for scan in range(SCANS):
        chance = plc.random.random()
        if scan > 100 and chance < FAULT:
            plc.disturb()
        elif chance > 1.0 - HEAL:
            plc.heal()
        elif scan > 100 and chance > 0.5 and chance < 0.503:
            await service.close()
            service = await start()
        for _ in range(60 if 0.4 < chance < 0.402 else 1):
            plc.cycle()
        step = await service.step(float(plc.count))
        writes += len(plc.written)
        assert_permitted(plc, step, verdict)
        verdict = step.verdict
    await service.close()
    assert writes > 50  # else nothing was put to the test


@pytest.mark.parametrize("seed", in_suite(1, range(6)))
async def test_writes_that_fail_let_go_of_the_loop_until_they_succeed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """What OP does meanwhile is the PLC's doing, and no model is judged by it."""
    plc, site = Plc(seed), make_site(tmp_path)
    monkeypatch.setattr(service_module, "link_to", lambda *_, **__: plc)
    service = CompensateService(site, "FC101", write=True, clock=plc, tell=lambda _: None)
    await service.open()
    plc.heal()

    async def run(scans: int) -> set[Verdict]:
        seen = set()
        for _ in range(scans):
            plc.cycle()
            seen.add((await service.step(float(plc.count))).verdict)
        return seen

    assert Verdict.WRITTEN in await run(150)
    plc.takes_writes, plc.sp = False, 58.0
    assert await run(450) == {Verdict.WRITE_FAILED, Verdict.WAITING}
    assert service.supervisor.memory.given_up == ()
    plc.takes_writes = True
    assert Verdict.WRITTEN in await run(150)
    await service.close()


async def test_a_register_of_whole_percent_does_not_round_op_beyond_its_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plc, site = Plc(1), make_site(tmp_path)
    text = (tmp_path / "site.toml").read_text()
    (tmp_path / "site.toml").write_text(text.replace("low = 20.0", "low = 50.4"))
    site = load_site(tmp_path / "site.toml")
    monkeypatch.setattr(service_module, "link_to", lambda *_, **__: plc)
    percent = Tag("OUT", Table.HOLDING, 0, DataType.UINT16, writable=True)
    monkeypatch.setattr(service_module, "op_out_of", lambda *_: percent)
    service = CompensateService(site, "FC101", write=True, clock=plc, tell=lambda _: None)
    await service.open()

    async def take(address: int, words: Sequence[int]) -> None:
        plc.written.append((address, list(words)))
        plc.op, plc.client = float(words[0]), TIMEOUT

    monkeypatch.setattr(plc, "write_registers", take)
    plc.heal()
    plc.sp = 50.0
    for _ in range(150):
        plc.cycle()
        step = await service.step(float(plc.count))
        assert step.verdict is not Verdict.WRITTEN or step.op == plc.op
    written = [words[0] for address, words in plc.written if address == 0]
    assert len(written) > 50
    assert min(written) == 51
    await service.close()
