"""A write-back under everything at once, beside a PLC that checks every write by today's rules."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from fieldlink.daemon.estimation.estimating import Findings
from fieldlink.daemon.writeback.asked_withdrawal import is_still_open
from fieldlink.daemon.writeback.candidate import findings_agree, same_stick_band
from fieldlink.daemon.writeback.exchange_io import Exchange
from fieldlink.daemon.writeback.outcomes import Attempt
from fieldlink.daemon.writeback.sequence import SequenceNumbers
from fieldlink.daemon.writeback.writer import BlockWriter
from fieldlink.links import LinkError, LinkTimeoutError
from fieldlink.registers import (
    BLOCK_REGISTERS,
    Bank,
    BlockReader,
    ExchangeLayout,
    Refusal,
    Status,
    decode_block,
    split_commit,
)
from fieldlink.site import WriteBack as Settings
from fieldlink.site import WriteLimits
from fieldlink.store import WritebackRecord
from tests.daemon.conftest import _findings as make_findings

LAYOUT = ExchangeLayout.at(0)
BANDS = st.sampled_from([3.0, 3.1, 7.0, 7.2, 15.0, 19.0])


class Killed(BaseException):
    """The process ends here, in the middle of a request."""


class CheckingPlc:
    """Registers and a block reader; every write is judged by what holds at that moment."""

    def __init__(self, machine: WritebackMachine) -> None:
        self.machine = machine
        self.words = [0] * 400
        self.words[LAYOUT.enable] = 1
        self.reader = BlockReader(101)
        self.now = 0.0
        self.refusal: Refusal | None = None
        self.glitch = self.lost = False
        self.state = self.reader.scan(self._view(), 0.0)
        self.lose = self.kill_after = 0
        self.ignores_commits = False

    @property
    def compensates(self) -> bool:
        """Whether its controller uses a valve model now."""
        return self.state.model is not None and self.refusal is None

    def _view(self) -> Any:
        return LAYOUT.view(lambda address, count: self.words[address : address + count])

    def scan(self) -> None:
        self.now += 1.0
        before = self.state.ack_seq
        self.state = self.reader.scan(self._view(), self.now)
        if self.state.ack_seq != before:
            self.refusal = None
        for address, word in self.state.reply(LAYOUT, self.refusal).items():
            self.words[address] = word
        if self.glitch:
            self.words[LAYOUT.active_bank] ^= 1

    async def read_registers(self, address: int, count: int) -> list[int]:
        self._fail()
        if self.lost:
            return [0xFFFF] * count
        return self.words[address : address + count]

    async def write_registers(self, address: int, words: Sequence[int]) -> None:
        self._fail()
        assert not self.lost, "written while the gateway has lost the PLC"
        bank = {LAYOUT.bank_a: Bank.A, LAYOUT.bank_b: Bank.B}[address]
        assert self.words[LAYOUT.enable], "a bank was written while the operator forbids it"
        held = self.state.accepted
        assert held is None or self.state.active_bank is not bank, "the active bank was overwritten"
        self.words[address : address + len(words)] = words
        self._end_there()

    async def write_register(self, address: int, word: int) -> None:
        self._fail()
        assert not self.lost, "written while the gateway has lost the PLC"
        # The enable bit may be cleared between the last look and a heartbeat; it does no harm.
        assert address in (LAYOUT.heartbeat, LAYOUT.writer, LAYOUT.commit)
        if address == LAYOUT.commit:
            bank, _ = split_commit(word)
            first = LAYOUT.bank_address(bank)
            self.machine.judge(decode_block(self.words[first : first + BLOCK_REGISTERS]))
            if self.ignores_commits:
                return
        self.words[address] = word
        self._end_there()

    def _fail(self) -> None:
        if self.lose:
            self.lose -= 1
            raise LinkTimeoutError("plc", "no reply", "wait")

    def _end_there(self) -> None:
        if self.kill_after:
            self.kill_after -= 1
            if not self.kill_after:
                raise Killed


class WritebackMachine(RuleBasedStateMachine):
    """Reloads, operators, kills, lost requests, clock steps and contradicting findings."""

    @initialize()
    def begin(self) -> None:
        self.loop = asyncio.new_event_loop()
        self.plc = CheckingPlc(self)
        self.now, self.utc = 0.0, 1.8e9
        self.settings = self._settings(20.0, 2)
        self.read_only = False
        self.newest: Findings | None = None
        self.counted = 0
        self.held = False
        self.committed: set[int] = set()
        self.rows: list[WritebackRecord] = []
        self.compensated = False
        self.asked_after: int | None = None
        # The numbers wrap around soon.
        self.numbers = SequenceNumbers(65530)
        self.writer = self._writer()

    def teardown(self) -> None:
        if hasattr(self, "loop"):
            self.loop.close()

    @rule(
        band=BANDS,
        verdict=st.sampled_from(["stiction"] * 4 + ["no_stiction", "not_assessable"]),
        times=st.integers(1, 3),
    )
    def find(self, band: float, verdict: str, times: int) -> None:
        found = make_findings(band, 1.0, verdict=verdict)
        if verdict != "not_assessable":
            self.newest = found
            self.compensated = self.plc.compensates
        for _ in range(times):
            compensated = self.writer.may_compensate
            self.writer.submit(found, self.utc, since=self.now, compensated=compensated)

    @rule(seconds=st.sampled_from([1, 3, 15, 70]))
    def wait(self, seconds: int) -> None:
        for _ in range(seconds):
            try:
                self.loop.run_until_complete(self.writer.service(self.now))
            except LinkError:
                pass
            except Killed:
                self._begin_again()
            self.plc.scan()
            self.now, self.utc = self.now + 1.0, self.utc + 1.0

    @rule(allowed=st.booleans())
    def enable(self, allowed: bool) -> None:
        before = self.plc.words[LAYOUT.enable]
        self.plc.words[LAYOUT.enable] = int(allowed)
        if allowed and not before:
            self.held = False

    @rule(
        limit=st.sampled_from([5.0, 20.0]),
        windows=st.integers(1, 3),
        read_only=st.sampled_from([False, False, False, True]),
    )
    def reload(self, limit: float, windows: int, read_only: bool) -> None:
        self.settings, self.read_only = self._settings(limit, windows), read_only
        before, self.writer = self.writer, self._writer()
        self.writer.carry_over(before)

    @rule(first=BANDS, then=BANDS)
    def disagree_while_it_waits(self, first: float, then: float) -> None:
        self.enable(allowed=False)
        self.find(band=first, verdict="stiction", times=3)
        self.wait(seconds=3)
        self.find(band=then, verdict="stiction", times=1)
        self.enable(allowed=True)
        self.wait(seconds=15)

    @rule()
    def withdraw(self) -> None:
        self.held = True
        self.asked_after = self.numbers.last
        self.writer.withdraw("a test", self.utc)

    @rule(refusal=st.sampled_from([Refusal.WORSE, Refusal.WRONG_SIGN]))
    def refuse(self, refusal: Refusal) -> None:
        if self.plc.state.model is not None:
            self.plc.refusal = refusal

    @rule(requests=st.integers(1, 6))
    def lose(self, requests: int) -> None:
        self.plc.lose = requests

    @rule(writes=st.integers(1, 4))
    def kill(self, writes: int) -> None:
        self.plc.kill_after = writes

    @rule()
    def restart(self) -> None:
        self._begin_again()

    @rule(ignored=st.booleans())
    def ignore_commits(self, ignored: bool) -> None:
        self.plc.ignores_commits = ignored

    @rule(step=st.sampled_from([-86400.0, 86400.0]))
    def step_clock(self, step: float) -> None:
        self.utc += step

    @rule()
    def restart_plc(self) -> None:
        enabled = self.plc.words[LAYOUT.enable]
        self.plc = CheckingPlc(self)
        self.plc.words[LAYOUT.enable] = enabled
        # Other registers behind the same endpoint: the process before keeps its connection.
        self.writer._exchange._access = self.plc  # type: ignore[assignment]

    @rule(wrong=st.booleans())
    def glitch(self, wrong: bool) -> None:
        self.plc.glitch = wrong

    @rule(lost=st.booleans())
    def lose_behind_a_gateway(self, lost: bool) -> None:
        self.plc.lost = lost

    @invariant()
    def what_is_in_force_was_committed(self) -> None:
        if hasattr(self, "plc") and self.plc.state.accepted is not None:
            assert self.plc.state.accepted.seq in self.committed

    def judge(self, block: Any) -> None:
        """Judge a commit by the rules of this moment."""
        assert not self.read_only, "committed although read-only"
        assert self.plc.words[LAYOUT.enable], "committed while the operator forbids it"
        assert block.seq not in self.committed, "a number was committed twice"
        self.committed.add(block.seq)
        if block.status is Status.WITHDRAWN:
            return
        assert not self.held, "a block after a withdrawal"
        assert block.windows >= self.settings.min_windows, "too few windows"
        compensated = self.compensated and self.plc.compensates
        if block.status is not Status.VALID:
            assert not self.plc.compensates, "a sticky valve's model was taken away unasked"
            return
        if compensated:
            held = self.plc.state.in_force.stick_band
            assert same_stick_band(block.stick_band, held), "a compensated window changed the model"
        low, high = self.settings.limits.stick_band
        assert low <= block.stick_band.value <= high, "outside today's limits"
        assert self.newest is not None
        said = make_findings(block.stick_band.value, 1.0)
        assert findings_agree(said, self.newest), "the newest window says otherwise"

    def _settings(self, limit: float, windows: int) -> Settings:
        return Settings(
            enabled=True,
            loop_id=101,
            base=0,
            min_windows=windows,
            min_interval=5.0,
            valid_for=120,
            limits=WriteLimits(stick_band=(0.0, limit)),
        )

    def _begin_again(self) -> None:
        """A process that was killed starts again with what the store holds."""
        self.numbers = SequenceNumbers()
        self.writer = self._writer()
        if self.rows:
            self.writer.resume(self.rows[-1])
        if self.asked_after is not None and is_still_open(self.asked_after, self.rows[::-1]):
            self.writer.withdraw("a test", self.utc)

    def _writer(self) -> BlockWriter:
        async def nothing() -> None:
            self.plc.scan()

        return BlockWriter(
            self.settings,
            Exchange(self.plc, LAYOUT, "big", device="plc"),
            period=1.0,
            read_only=self.read_only,
            pause=nothing,
            report=self._report,
            keep=self._keep,
            tell=lambda *_: None,
            numbers=self.numbers,
            identity=7,
            max_age=60.0,
        )

    def _report(self, attempt: Attempt) -> None:
        if attempt.block is not None:
            self.rows.append(attempt.record("FC101", self.utc))

    def _keep(self, attempt: Attempt) -> Future[bool]:
        self.rows.append(attempt.record("FC101", self.utc))
        receipt: Future[bool] = Future()
        receipt.set_result(True)
        return receipt
