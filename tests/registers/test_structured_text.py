"""The structured text of deploy/plc, run: it must do what `BlockReader` does.

No PLC is at hand, so the few constructs that the text uses are translated to Python: assignments,
IF, FOR, expressions with the precedence of IEC 61131-3, identifiers in any case.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fieldlink.registers import (
    BLOCK_FIELDS,
    BLOCK_REGISTERS,
    BlockLimits,
    BlockReader,
    Bounded,
    ExchangeWords,
    ParameterBlock,
    Status,
    commit_word,
    encode_block,
    next_seq,
)
from fieldlink.registers.crc import crc16
from fieldlink.registers.exchange import Bank
from loop_model import LoopModel, ProcessModel, ValveModel

FILE = Path(__file__).parents[2] / "deploy" / "plc" / "block_reader.st"
CODE = re.sub(r"\(\*.*?\*\)", "", FILE.read_text(encoding="utf-8"), flags=re.DOTALL)

TOKEN = re.compile(r"16#[0-9A-Fa-f]+|\d+\.\d+|\d+|\w+|:=|<=|>=|<>|[-+*/=<>();,\[\]]")
LEVELS = [
    {"or": "|"},
    {"xor": "^"},
    {"and": "&"},
    {"=": "==", "<>": "!="},
    {"<": "<", ">": ">", "<=": "<=", ">=": ">="},
    {"+": "+", "-": "-"},
    {"*": "*", "/": "//", "mod": "%"},
]


class Translator:
    """Turns the statements of one program unit into Python that works on a dictionary ``v``."""

    def __init__(self, body: str) -> None:
        self._tokens = [token.lower() for token in TOKEN.findall(body)]
        self._at = 0
        self.lines: list[str] = []
        self._statements(0, frozenset())

    def _peek(self) -> str:
        return self._tokens[self._at] if self._at < len(self._tokens) else ""

    def _next(self, *expected: str) -> str:
        token = self._peek()
        assert token
        assert not expected or token in expected, f"{token} where {expected} is due"
        self._at += 1
        return token

    def _statements(self, depth: int, ends: frozenset[str]) -> None:
        while self._peek() and self._peek() not in ends:
            pad = "    " * depth
            if self._peek() == "if":
                word = self._next()
                while word != "end_if":
                    if word == "else":
                        self.lines.append(f"{pad}else:")
                    else:
                        head = "if" if word == "if" else "elif"
                        self.lines.append(f"{pad}{head} {self._expression()}:")
                        self._next("then")
                    self._statements(depth + 1, frozenset({"elsif", "else", "end_if"}))
                    word = self._next("elsif", "else", "end_if")
            elif self._peek() == "for":
                self._next()
                name = self._next()
                self._next(":=")
                first = self._expression()
                self._next("to")
                last = self._expression()
                self._next("do")
                self.lines.append(f"{pad}for v[{name!r}] in range({first}, {last} + 1):")
                self._statements(depth + 1, frozenset({"end_for"}))
                self._next("end_for")
            else:
                target = self._factor()
                self._next(":=")
                self.lines.append(f"{pad}{target} = {self._expression()}")
                self._next(";")

    def _expression(self, level: int = 0) -> str:
        if level == len(LEVELS):
            return self._factor()
        text = self._expression(level + 1)
        while self._peek() in LEVELS[level]:
            operator = LEVELS[level][self._next()]
            text = f"({text} {operator} {self._expression(level + 1)})"
        return text

    def _factor(self) -> str:
        token = self._next()
        if token == "not":
            return f"(not {self._factor()})"
        if token == "(":
            text = self._expression()
            self._next(")")
            return text
        if token.startswith("16#"):
            return str(int(token[3:], 16))
        if token[0].isdigit():
            return token
        if token in ("true", "false"):
            return token.capitalize()
        if self._peek() == "(":
            self._next()
            arguments = []
            while True:
                if self._tokens[self._at + 1] == ":=":
                    self._at += 2
                arguments.append(self._expression())
                if self._next(",", ")") == ")":
                    return f"{token}({', '.join(arguments)})"
        if self._peek() == "[":
            self._next()
            index = self._expression()
            self._next("]")
            return f"v[{token!r}][{index}]"
        return f"v[{token!r}]"


def unit(kind: str, name: str) -> tuple[dict[str, Any], str]:
    """Return a program unit's variables with their initial values, and its translated body."""
    found = re.search(rf"{kind} {name}\b(.*?)END_{kind}", CODE, re.DOTALL)
    assert found is not None
    declared, body = found[1].rsplit("END_VAR", 1)
    values: dict[str, Any] = {}
    pattern = re.compile(r"^\s*([\w, ]+) : [^:;]+?(?::= ([^;]+))?;", re.MULTILINE)
    for names, initial in pattern.findall(declared):
        value = float(initial) if "." in initial else int(initial or 0)
        values |= {variable.strip().lower(): value for variable in names.split(",")}
    return values, "\n".join(Translator(body).lines)


def f_real(words: list[int], offset: int) -> float:
    value: float = struct.unpack(">f", struct.pack(">2H", *words[offset : offset + 2]))[0]
    return value


def f_crc16(words: list[int]) -> int:
    values, body = unit("FUNCTION", "F_CRC16")
    scope = {"v": values | {"words": words}, "shr": lambda word, bits: word >> bits}
    exec(body, scope)
    result: int = scope["v"]["f_crc16"]  # type: ignore[index]
    return result


FUNCTIONS = {
    "shr": lambda word, bits: word >> bits,
    "shl": lambda word, bits: word << bits,
    "abs": abs,
    "word_to_dword": int,
    "word_to_udint": int,
    "dword_to_udint": int,
    "f_real": f_real,
    # The function itself is compared with ours below; here it would cost a second.
    "f_crc16": lambda words: crc16(words[:-2]),
}


class FunctionBlock:
    """An instance of FB_BLOCK_READER."""

    def __init__(self) -> None:
        self.v, body = unit("FUNCTION_BLOCK", "FB_BLOCK_READER")
        self._code = compile(body, str(FILE), "exec")

    def scan(self, words: ExchangeWords, seconds: int) -> dict[str, Any]:
        self.v |= {
            "enable": bool(words.enable & 1),
            "heartbeat": words.heartbeat,
            "commit": words.commit,
            "loopid": 7,
            "seconds": seconds,
            "banka": list(words.bank_a),
            "bankb": list(words.bank_b),
        }
        exec(self._code, {"v": self.v, **FUNCTIONS})
        return self.v


PROCESS = ProcessModel(a=(-0.9,), b=(0.1,), dead_time=1, offset=0.0, period=1.0)


def block(seq: int, status: Status = Status.VALID, S: float = 5.0, **changes: Any) -> list[int]:
    made = ParameterBlock.from_model(
        LoopModel(ValveModel(S, 2.0), PROCESS), loop_id=7, seq=seq, valid_for=40, window_end_ms=0
    )
    return encode_block(replace(made, status=status, **changes))


@given(words=st.lists(st.integers(0, 0xFFFF), min_size=94, max_size=94))
@settings(max_examples=5, deadline=None)
def test_the_crc_of_the_page_is_ours(words: list[int]) -> None:
    assert f_crc16(words) == crc16(words[:-2])


def test_the_offsets_of_the_page_are_those_of_the_layout() -> None:
    offsets = {field.name: field.offset for field in BLOCK_FIELDS}
    named = re.findall(r"OFS_(\w+) : INT := (\d+);", CODE)
    assert len(named) == 11
    assert {name.lower(): int(offset) for name, offset in named}.items() <= offsets.items()
    assert f"BLOCK_LENGTH : WORD := {BLOCK_REGISTERS};" in CODE


def test_a_block_is_accepted_with_its_values() -> None:
    plc = FunctionBlock()
    blank = (0,) * BLOCK_REGISTERS
    plc.scan(ExchangeWords(1, 1, 0, blank, blank), 100)
    found = plc.scan(ExchangeWords(1, 2, commit_word(Bank.B, 1), blank, tuple(block(1))), 101)
    assert (found["ackseq"], found["ackresult"], found["activebank"]) == (1, 1, 1)
    assert found["inforce"]
    assert not found["healthy"]
    assert (found["stickband"], found["slipjump"]) == (5.0, 2.0)
    assert (found["staticfriction"], found["dynamicfriction"]) == (3.5, 1.5)


@dataclass(frozen=True)
class Write:
    """A block, sound or spoilt, that is written to a bank and committed."""

    bank: Bank
    step: int  # from the sequence number written before
    status: Status
    S: float
    spoil: str
    offset: int

    def words(self, seq: int) -> list[int]:
        words = block(seq, self.status, self.S)
        if self.spoil == "zero":
            return [0] * BLOCK_REGISTERS
        if self.spoil == "torn":
            return words[:40] + block(next_seq(seq), self.status)[40:]
        if self.spoil == "loop":
            return block(seq, self.status, self.S, loop_id=8)
        if self.spoil == "seq":
            words[-1] ^= 1
        elif self.spoil == "word":
            words[self.offset] ^= 0x0101
        elif self.spoil == "nan" and self.status is Status.VALID:
            words[24] = 0x7FC0
            words[-2] = crc16(words[:-2])
        return words


@dataclass(frozen=True)
class Scan:
    """One scan: ``seconds`` after the one before, after a write or without."""

    seconds: int
    enabled: bool
    beats: bool
    write: Write | None


MOSTLY = st.integers(0, 9).map(lambda number: number != 9)
WRITES = st.builds(
    Write,
    bank=st.sampled_from(Bank),
    step=st.sampled_from([1, 1, 1, 1, 0, -1, 256, 32767, 32768]),
    status=st.sampled_from([Status.VALID, Status.VALID, *list(Status)[1:]]),
    S=st.sampled_from([5.0, 6.0, 30.0]),
    spoil=st.sampled_from([*[""] * 10, "zero", "torn", "loop", "seq", "word", "nan"]),
    offset=st.integers(0, BLOCK_REGISTERS - 1),
)
SCANS = st.builds(
    Scan,
    st.sampled_from([1, 1, 2, 9, 10, 39]),
    enabled=MOSTLY,
    beats=MOSTLY,
    write=st.none() | WRITES,
)


def played(story: list[Scan]) -> Iterator[tuple[int, ExchangeWords]]:
    beat = now = commit = 0
    seq = 65530
    contents = dict.fromkeys(Bank, (0,) * BLOCK_REGISTERS)
    for scan in story:
        now += scan.seconds
        beat += scan.beats
        if scan.write is not None:
            seq = (seq + scan.write.step - 1) % 65535 + 1
            contents[scan.write.bank] = tuple(scan.write.words(seq))
            commit = commit_word(scan.write.bank, seq)
        enable = int(scan.enabled)
        yield now, ExchangeWords(enable, beat, commit, contents[Bank.A], contents[Bank.B])


@settings(max_examples=100, deadline=None)
@given(story=st.lists(SCANS, min_size=5, max_size=25))
def test_the_page_does_what_the_reader_does(story: list[Scan]) -> None:
    ours = BlockReader(7, limits=BlockLimits(stick_band=(0.0, 20.0)))
    plc = FunctionBlock()
    for now, words in played(story):
        state = ours.scan(words, now)
        found = plc.scan(words, now)
        assert found["ackseq"] == state.ack_seq
        assert found["ackresult"] == state.ack_result
        assert found["activebank"] == state.active_bank
        assert found["ackcommit"] == state.ack_commit
        assert bool(found["inforce"]) == (state.in_force is not None)
        if state.model is not None:
            assert found["stickband"] == state.model.valve.stick_band


def test_other_content_under_the_accepted_number_is_refused_by_both() -> None:
    ours, plc = BlockReader(7), FunctionBlock()
    blank = (0,) * BLOCK_REGISTERS
    for k, S in enumerate((5.0, 6.0)):
        words = ExchangeWords(1, k, commit_word(Bank.A, 1), tuple(block(1, S=S)), blank)
        state, found = ours.scan(words, k), plc.scan(words, k)
        assert found["ackresult"] == state.ack_result == (1, 8)[k]
    assert found["stickband"] == 5.0


def test_a_refusal_is_acknowledged_while_the_block_is_held() -> None:
    plc = FunctionBlock()
    blank = (0,) * BLOCK_REGISTERS
    plc.v["refusal"] = 24
    assert plc.scan(ExchangeWords(1, 0, 0, blank, blank), 0)["ackrefusal"] == 0
    words = ExchangeWords(1, 1, commit_word(Bank.A, 1), tuple(block(1)), blank)
    assert plc.scan(words, 1)["ackrefusal"] == 24
    healthy = tuple(block(2, Status.NO_STICTION))
    words = ExchangeWords(1, 2, commit_word(Bank.B, 2), tuple(block(1)), healthy)
    assert plc.scan(words, 2)["ackrefusal"] == 0


def test_bounds_that_the_page_does_not_use_are_not_its_business() -> None:
    wide = block(1, stick_band=Bounded(5.0, 4.0, 6.0))
    blank = (0,) * BLOCK_REGISTERS
    plc = FunctionBlock()
    assert plc.scan(ExchangeWords(1, 1, commit_word(Bank.A, 1), tuple(wide), blank), 1)["held"]


@pytest.mark.parametrize("seconds", [39, 40])
def test_a_block_of_the_page_expires(seconds: int) -> None:
    plc = FunctionBlock()
    words = [
        ExchangeWords(1, beat, commit_word(Bank.A, 1), tuple(block(1)), tuple(block(1)))
        for beat in range(3)
    ]
    plc.scan(words[0], 0)
    assert plc.scan(words[1], 1)["inforce"]
    assert bool(plc.scan(words[2], seconds)["inforce"]) is (seconds < 40)
