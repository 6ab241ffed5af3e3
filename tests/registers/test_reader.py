"""The PLC's rules, each as a short story of scans."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fieldlink.registers import (
    ACCEPTED,
    BLOCK_REGISTERS,
    NOTHING_SEEN,
    Bank,
    BlockFault,
    BlockLimits,
    BlockReader,
    ExchangeLayout,
    Fallback,
    ParameterBlock,
    ReaderState,
    Status,
    commit_word,
    encode_block,
    split_commit,
)
from loop_model import LoopModel, ProcessModel, ValveModel

LAYOUT = ExchangeLayout.at(100)
PROCESS = ProcessModel(a=(-0.9,), b=(0.1,), dead_time=1, offset=0.0, period=1.0)
MODEL = LoopModel(ValveModel(5.0, 2.0), PROCESS)
BLOCK = ParameterBlock.from_model(
    MODEL, loop_id=7, seq=1, valid_for=100, window_end_ms=0, confidence=0.875
)


class Plc:
    """Registers, a reader, and a heartbeat that counts at every scan while ``beats``."""

    def __init__(self, **options: object) -> None:
        self.registers = [0] * 400
        self.registers[LAYOUT.enable] = 1
        self.reader = BlockReader(7, **options)  # type: ignore[arg-type]
        self.now = 0.0
        self.beats = True

    def write(self, block: ParameterBlock, bank: Bank, *, commit: bool = True) -> None:
        self.put(encode_block(block), bank)
        if commit:
            self.registers[LAYOUT.commit] = commit_word(bank, block.seq)

    def put(self, words: list[int], bank: Bank) -> None:
        address = LAYOUT.bank_address(bank)
        self.registers[address : address + BLOCK_REGISTERS] = words

    def scan(self, seconds: float = 1.0) -> ReaderState:
        self.now += seconds
        if self.beats:
            self.registers[LAYOUT.heartbeat] = (self.registers[LAYOUT.heartbeat] + 1) & 0xFFFF
        words = LAYOUT.view(lambda address, count: self.registers[address : address + count])
        state = self.reader.scan(words, self.now)
        for address, word in state.reply(LAYOUT).items():
            self.registers[address] = word
        return state


@pytest.fixture
def plc() -> Plc:
    plc = Plc()
    plc.scan()
    return plc


def test_an_empty_area_is_no_fault(plc: Plc) -> None:
    state = plc.scan()
    assert (state.ack_seq, state.ack_result) == (0, NOTHING_SEEN)
    assert state.fallback is Fallback.NO_BLOCK
    assert state.in_force is None


def test_a_committed_block_is_accepted_and_acknowledged(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B)
    state = plc.scan()
    assert state.model == MODEL
    assert plc.registers[LAYOUT.ack_seq] == 1
    assert plc.registers[LAYOUT.ack_result] == ACCEPTED
    assert plc.registers[LAYOUT.active_bank] == Bank.B
    assert plc.registers[LAYOUT.ack_commit] == commit_word(Bank.B, 1)


def test_a_block_without_commit_is_not_used(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B, commit=False)
    assert plc.scan().accepted is None
    plc.write(BLOCK, Bank.B)
    assert plc.scan().accepted == BLOCK


def test_the_block_in_use_does_not_follow_its_registers(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B)
    plc.scan()
    plc.put(list(range(BLOCK_REGISTERS)), Bank.B)
    state = plc.scan()
    assert state.in_force == BLOCK
    assert state.ack_result == BlockFault.MAGIC.code


def test_a_rejected_block_leaves_the_active_one_in_force(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B)
    plc.scan()
    torn = encode_block(replace(BLOCK, seq=2))
    torn[30] ^= 1
    plc.put(torn, Bank.A)
    plc.registers[LAYOUT.commit] = commit_word(Bank.A, 2)
    state = plc.scan()
    assert state.in_force == BLOCK
    assert (state.ack_seq, state.ack_result) == (1, BlockFault.CRC.code)
    assert state.active_bank is Bank.B
    assert state.ack_commit == commit_word(Bank.A, 2)
    assert "torn" in state.detail

    plc.write(replace(BLOCK, seq=3), Bank.A)
    assert plc.scan().ack_seq == 3


@pytest.mark.parametrize(
    ("block", "fault"),
    [
        (replace(BLOCK, seq=5), BlockFault.NOT_NEWER),
        (replace(BLOCK, seq=4), BlockFault.NOT_NEWER),
        (replace(BLOCK, seq=6, loop_id=8), BlockFault.WRONG_LOOP),
        (
            ParameterBlock.from_model(
                LoopModel(ValveModel(25.0, 2.0), PROCESS),
                loop_id=7, seq=6, valid_for=100, window_end_ms=0,
            ),
            BlockFault.OUT_OF_RANGE,
        ),
    ],
)  # fmt: skip
def test_what_the_reader_itself_refuses(block: ParameterBlock, fault: BlockFault) -> None:
    plc = Plc(limits=BlockLimits(stick_band=(0.0, 20.0)))
    plc.write(replace(BLOCK, seq=5), Bank.B)
    plc.scan()
    plc.write(replace(block, samples=1), Bank.A)
    state = plc.scan()
    assert state.ack_result == fault.code
    assert state.ack_seq == 5


def test_sequence_numbers_go_on_after_65535(plc: Plc) -> None:
    plc.write(replace(BLOCK, seq=65535), Bank.B)
    plc.scan()
    plc.write(BLOCK, Bank.A)
    assert plc.scan().ack_seq == 1


def test_a_block_whose_low_sequence_byte_is_zero_is_accepted(plc: Plc) -> None:
    plc.write(replace(BLOCK, seq=256), Bank.B)
    plc.scan()
    plc.write(replace(BLOCK, seq=512), Bank.A)
    assert plc.registers[LAYOUT.commit] == 0
    assert plc.scan().ack_seq == 512


def test_committing_the_accepted_block_again_does_not_renew_it(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B)
    plc.scan()
    plc.registers[LAYOUT.commit] = commit_word(Bank.A, 9)
    state = plc.scan()
    assert (state.ack_result, state.in_force) == (BlockFault.EMPTY.code, BLOCK)
    plc.registers[LAYOUT.commit] = commit_word(Bank.B, 1)
    state = plc.scan(50.0)
    assert state.ack_result == ACCEPTED
    assert state.expires_in == pytest.approx(100.0 - 51.0)


def test_a_block_expires_in_seconds_of_the_plc_since_acceptance(plc: Plc) -> None:
    plc.scan(1000.0)
    plc.write(BLOCK, Bank.B)
    plc.scan()
    assert plc.scan(99.0).in_force == BLOCK
    state = plc.scan(1.0)
    assert state.expired
    assert state.in_force is None
    plc.write(replace(BLOCK, seq=2), Bank.A)
    assert plc.scan().model == MODEL


def test_a_dead_heartbeat_suspends_the_block_until_it_counts_again(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B)
    plc.scan()
    plc.beats = False
    assert plc.scan(9.0).in_force == BLOCK
    assert plc.scan(1.0).heartbeat_dead
    plc.beats = True
    assert plc.scan().in_force == BLOCK


def test_a_block_left_in_the_registers_of_a_restarted_plc_waits_for_a_heartbeat() -> None:
    plc = Plc()
    plc.write(BLOCK, Bank.B)
    plc.beats = False
    plc.registers[LAYOUT.heartbeat] = 1234
    assert plc.scan().heartbeat_dead
    plc.beats = True
    assert plc.scan().model == MODEL


def test_no_stiction_is_in_force_without_a_model(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B)
    plc.scan()
    plc.write(ParameterBlock(loop_id=7, seq=2, status=Status.NO_STICTION, valid_for=60), Bank.A)
    state = plc.scan()
    assert state.in_force is not None
    assert state.in_force.status is Status.NO_STICTION
    assert state.model is None


def test_not_assessable_keeps_the_last_block_and_its_expiry(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B)
    plc.scan()
    plc.write(
        ParameterBlock(loop_id=7, seq=2, status=Status.NOT_ASSESSABLE, valid_for=9999), Bank.A
    )
    state = plc.scan(50.0)
    assert state.in_force == BLOCK
    assert state.ack_seq == 2
    assert plc.scan(50.0).expired


def test_withdrawn_ends_the_block_at_once(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B)
    plc.scan()
    plc.write(ParameterBlock(loop_id=7, seq=2, status=Status.WITHDRAWN, valid_for=1), Bank.A)
    state = plc.scan()
    assert state.fallback is Fallback.WITHDRAWN
    assert (state.ack_seq, state.ack_result) == (2, ACCEPTED)


def test_registers_that_were_cleared_end_the_block(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B)
    plc.scan()
    plc.put([0] * BLOCK_REGISTERS, Bank.A)
    plc.put([0] * BLOCK_REGISTERS, Bank.B)
    plc.registers[LAYOUT.commit] = 0
    assert plc.scan().fallback is Fallback.CLEARED


def test_without_the_enable_bit_nothing_is_accepted_or_used(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B)
    plc.scan()
    plc.registers[LAYOUT.enable] = 0
    plc.write(replace(BLOCK, seq=2), Bank.A)
    state = plc.scan()
    assert state.fallback is Fallback.DISABLED
    assert (state.ack_seq, state.ack_result) == (1, BlockFault.NOT_ENABLED.code)
    # What was committed against the operator's will stays refused; a new number is accepted.
    plc.registers[LAYOUT.enable] = 1
    state = plc.scan()
    assert (state.ack_seq, state.ack_result) == (1, BlockFault.NOT_ENABLED.code)
    assert state.in_force == BLOCK
    plc.write(replace(BLOCK, seq=3), Bank.A)
    state = plc.scan()
    assert (state.ack_seq, state.ack_result) == (3, ACCEPTED)
    assert state.model == MODEL


def test_a_commit_word_that_names_no_bank_is_refused(plc: Plc) -> None:
    plc.write(BLOCK, Bank.B)
    plc.scan()
    plc.registers[LAYOUT.commit] = 0x0201
    state = plc.scan()
    assert state.ack_result == BlockFault.COMMIT.code
    assert state.in_force == BLOCK


def test_the_word_order_of_the_device_is_used() -> None:
    plc = Plc(word_order="little")
    plc.put(encode_block(BLOCK, "little"), Bank.B)
    plc.registers[LAYOUT.commit] = commit_word(Bank.B, 1)
    plc.scan()
    assert plc.scan().model == MODEL


def test_time_must_not_go_back(plc: Plc) -> None:
    with pytest.raises(ValueError, match="went back"):
        plc.scan(-1.0)


def test_the_compact_layout_leaves_no_register_to_two_parts() -> None:
    used = [address for _, first, last in LAYOUT.spans() for address in range(first, last + 1)]
    assert len(used) == len(set(used)) == 9 + 2 * BLOCK_REGISTERS
    assert min(used) == 100


def test_a_layout_that_overlaps_itself_is_refused() -> None:
    with pytest.raises(ValueError, match="bank_b and bank_a share register 150"):
        replace(LAYOUT, bank_a=120, bank_b=150)
    with pytest.raises(ValueError, match="outside 0 to 65535"):
        ExchangeLayout.at(65400)


def test_commit_words_name_bank_and_low_byte() -> None:
    assert commit_word(Bank.B, 0x1234) == 0x0134
    assert split_commit(0x0134) == (Bank.B, 0x34)
    assert Bank.A.other is Bank.B
    assert Bank.B.other is Bank.A
