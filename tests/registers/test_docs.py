"""docs/parameter-block.md must say what the program does."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from fieldlink.registers import (
    ACCEPTED,
    BLOCK_FIELDS,
    NOTHING_SEEN,
    BlockFault,
    ExchangeLayout,
    Refusal,
    Status,
    describe_ack,
)

PAGE = (Path(__file__).parents[2] / "docs" / "parameter-block.md").read_text(encoding="utf-8")
PLC_TYPES = {
    "uint16": "WORD",
    "uint32": "UDINT",
    "uint64": "ULINT",
    "float32": "REAL",
    "float64": "LREAL",
}


def table(first_column: str) -> list[list[str]]:
    """Return the rows of every table whose header begins with ``first_column``."""
    rows: list[list[str]] = []
    inside = False
    for line in PAGE.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith(f"| {first_column} |"):
            inside = True
        elif not line.startswith("|"):
            inside = False
        elif inside and not line.startswith("| ---"):
            rows.append(cells)
    return rows


def test_the_table_of_registers_is_the_layout() -> None:
    documented = [row for row in table("offset") if len(row) == 5]
    assert documented == [
        [str(field.offset), field.name, PLC_TYPES[field.data_type], field.unit, field.text]
        for field in BLOCK_FIELDS
    ]


def test_the_table_of_the_exchange_area_is_the_compact_layout() -> None:
    documented = {row[1]: int(row[0]) for row in table("offset") if len(row) == 4}
    assert documented == asdict(ExchangeLayout.at(0))


def test_every_result_code_is_explained_in_the_program_s_words() -> None:
    codes = [NOTHING_SEEN, ACCEPTED, *(fault.code for fault in BlockFault)]
    said = {code: describe_ack(code).removeprefix("rejected: ") for code in codes}
    assert {int(code): text for code, text in table("code")} == said


def test_every_status_is_explained() -> None:
    documented = {int(code): name for code, name, _ in table("status")}
    assert documented == {status.value: status.name.lower().replace("_", " ") for status in Status}


def test_every_refusal_is_explained_in_the_program_s_words() -> None:
    said = {refusal.code: f"{refusal.text}; {refusal.advice}" for refusal in Refusal}
    assert {int(code): text for code, text in table("refusal")} == said
    assert Refusal.from_code(0) is None
    assert Refusal.from_code(24) is Refusal.WORSE
    assert Refusal.from_code(99) is Refusal.OTHER
