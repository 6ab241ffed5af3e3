"""Small sites to simulate, and blocks to send to them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from fieldlink.lab.plc import VirtualPlc
from fieldlink.registers import (
    Bank,
    ExchangeLayout,
    Order,
    ParameterBlock,
    Table,
    commit_word,
    encode_block,
)
from fieldlink.site import Site, load_site
from fmu_models import catalogue
from loop_model import LoopModel, ValveModel

EXCHANGE = ExchangeLayout.at(100)

MAP = """\
tag,table,address,type,low,high,writable
FC101.OP,holding,0,float32,0,100,
FC101.PV,holding,2,float32,,,
FC101.SP,holding,4,float32,0,100,
FC101.MODE,holding,6,uint16,,,
FC101.SCAN,holding,7,uint32,,,
"""

PLANT = """\
fmu = "example1"
compensate = true
setpoint = [[0.0, 55.0]]
"""

SITE = """\
[site]
name = "test"
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
port = 5020
register_map = "map.csv"
speed = 200.0
{device}
[loops.FC101]
device = "plc"
op = "FC101.OP"
pv = "FC101.PV"
sp = "FC101.SP"
mode = "FC101.MODE"
scan = "FC101.SCAN"
period = 1.0
[loops.FC101.writeback]
base = 100
loop_id = 101
limits = {{ stick_band = [0.0, 15.0], slip_jump = [0.0, 15.0] }}
[loops.FC101.plant]
{plant}
{more}
"""

MakeSite = Callable[..., Site]


@pytest.fixture
def make_site(tmp_path: Path) -> MakeSite:
    """Write a site of one loop FC101 and load it."""

    def make(*, plant: str = PLANT, registers: str = MAP, device: str = "", more: str = "") -> Site:
        (tmp_path / "map.csv").write_text(registers)
        path = tmp_path / "site.toml"
        path.write_text(SITE.format(plant=plant, device=device, more=more))
        return load_site(path)

    return make


def _true_block(
    seq: int = 1, *, loop_id: int = 101, valve: ValveModel | None = None, valid_for: int = 86_400
) -> ParameterBlock:
    """Return a block with the parameters that example1 really has, unless told otherwise."""
    plant = catalogue["example1"]
    assert plant.process is not None
    return ParameterBlock.from_model(
        LoopModel(valve or plant.valve, plant.process),
        loop_id=loop_id,
        seq=seq,
        valid_for=valid_for,
        window_end_ms=1_795_000_000_000,
    )


class Writer:
    """Fieldlink's side of the exchange, in process: enough of it to send a block."""

    def __init__(self, plc: VirtualPlc, word_order: Order = "big") -> None:
        self.plc = plc
        self.beats = 0
        self._word_order: Order = word_order

    def beat(self) -> None:
        self.beats += 1
        self.plc.image.write(Table.HOLDING, EXCHANGE.heartbeat, [self.beats])

    def send(self, block: ParameterBlock, bank: Bank = Bank.B) -> None:
        self.send_words(encode_block(block, self._word_order), block.seq, bank)

    def send_words(self, words: list[int], seq: int, bank: Bank = Bank.B) -> None:
        self.plc.image.write(Table.HOLDING, EXCHANGE.bank_address(bank), words)
        self.plc.image.write(Table.HOLDING, EXCHANGE.commit, [commit_word(bank, seq)])

    def run(self, scans: int) -> None:
        for _ in range(scans):
            self.beat()
            self.plc.scan()

    @property
    def answer(self) -> tuple[int, int]:
        """The acknowledged sequence number and the result code."""
        (seq,) = self.plc.image.read(Table.HOLDING, EXCHANGE.ack_seq, 1)
        (result,) = self.plc.image.read(Table.HOLDING, EXCHANGE.ack_result, 1)
        return seq, result


@pytest.fixture
def make_block() -> Callable[..., ParameterBlock]:
    """Build a block that says what example1 really is, unless told otherwise."""
    return _true_block


@pytest.fixture
def writer_of() -> Callable[..., Writer]:
    """Build Fieldlink's side of a PLC's exchange."""
    return Writer
