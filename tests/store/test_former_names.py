"""Which rows are a loop's that had other names, and what a loop of a row is called now."""

from __future__ import annotations

import pytest
from sqlalchemy import create_engine, insert, select

from fieldlink.store.former_names import FormerNames, Renaming
from fieldlink.store.schema import SLOTS

ROWS = [("A", 5), ("A", 15), ("A", 25), ("B", 5), ("B", 15), ("B", 25), ("C", 35)]
COUNTS = dict.fromkeys(
    ("seconds", "expected", "read", "late", "missed", "bad", "duplicates", "restarts"), 0
)


@pytest.mark.parametrize(
    ("renamings", "loop", "own"),
    [
        ([], "A", [("A", 5), ("A", 15), ("A", 25)]),
        # before, another loop had the name
        ([(10, "A", "B")], "B", [("A", 5), ("B", 15), ("B", 25)]),
        # the name that was given up may be another loop's since
        ([(10, "A", "B")], "A", [("A", 15), ("A", 25)]),
        (
            [(10, "A", "B"), (30, "B", "C")],
            "C",
            [("A", 5), ("B", 15), ("B", 25), ("C", 35)],
        ),
        ([(10, "A", "B"), (20, "B", "A")], "A", [("A", 5), ("A", 25), ("B", 15)]),
        ([(10, "B", "C"), (20, "A", "B")], "B", [("A", 5), ("A", 15), ("B", 25)]),
        ([(10, "B", "C"), (20, "A", "B")], "C", [("B", 5), ("C", 35)]),
    ],
)
def test_rows_of_a_loop(
    renamings: list[tuple[int, str, str]], loop: str, own: list[tuple[str, int]]
) -> None:
    names = FormerNames(Renaming(*one) for one in renamings)
    engine = create_engine("sqlite://")
    with engine.begin() as connection:
        SLOTS.create(connection)
        for name, utc_ms in ROWS:
            connection.execute(insert(SLOTS).values(loop=name, utc_ms=utc_ms, **COUNTS))
        query = select(SLOTS.c.loop, SLOTS.c.utc_ms).where(names.own(SLOTS, loop))
        assert sorted(map(tuple, connection.execute(query))) == own


@pytest.mark.parametrize(
    ("loop", "utc_ms", "now"),
    [("A", 5, "C"), ("A", 15, "A"), ("B", 15, "C"), ("B", 35, "B"), ("C", 35, "C"), ("D", 5, "D")],
)
def test_present_name(loop: str, utc_ms: int, now: str) -> None:
    names = FormerNames([Renaming(10, "A", "B"), Renaming(30, "B", "C")])
    assert names.at_present(loop, utc_ms) == now
