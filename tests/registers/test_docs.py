"""docs/parameter-block.md must say what the program does."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from fieldlink.registers import ExchangeLayout, Refusal, Status

PAGE = (Path(__file__).parents[2] / "docs" / "parameter-block.md").read_text(encoding="utf-8")


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


def test_the_table_of_the_exchange_area_is_the_compact_layout() -> None:
    documented = {row[1]: int(row[0]) for row in table("offset") if len(row) == 4 and row[1]}
    assert documented == asdict(ExchangeLayout.at(0))


def test_every_status_is_explained() -> None:
    documented = {int(code): name for code, name, _ in table("status")}
    assert documented == {status.value: status.name.lower().replace("_", " ") for status in Status}


def test_refusals_are_read_from_their_register() -> None:
    assert Refusal.from_code(0) is None
    assert Refusal.from_code(24) is Refusal.WORSE
    assert Refusal.from_code(99) is Refusal.OTHER
