"""docs/reference/events.md names every event that the program can log, and no other."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from fieldlink.daemon.operators.orders import ORDER_EVENTS, Action
from fieldlink.daemon.writeback.asked_withdrawal import WITHDRAWAL_ASKED
from fieldlink.findings.open_finding import State
from fieldlink.links import LinkState
from fieldlink.store import RENAMED
from fieldlink.store.work_notes import WORK_STATES
from tests.docs.pages import ROOT

TELLS = {"event", "event_record", "EventRecord", "tell", "_tell", "info", "warning", "error"}
NAME = re.compile(r"[a-z]+\.[a-z_]+|defect|estimate|writeback")
MADE = {
    *ORDER_EVENTS,
    RENAMED,
    WITHDRAWAL_ASKED,
    *(action.event for action in Action),
    *(f"device.{state.name.lower()}" for state in LinkState if state is not LinkState.CLOSED),
    *(f"finding.{state}" for state in State),
    *(f"work.{state}" for state in WORK_STATES),
    # The first stands for every family; the second is written where no logger can be.
    "device.flapping",
    "log.lost",
    "estimate.failed",
    "writeback",
}
"""Events whose names are put together, or given under another name of the function."""


def told_in(source: str) -> Iterator[str]:
    for call in ast.walk(ast.parse(source)):
        if not isinstance(call, ast.Call):
            continue
        function = call.func.attr if isinstance(call.func, ast.Attribute) else call.func
        name = function.id if isinstance(function, ast.Name) else function
        if name in TELLS:
            for part in call.args[:2]:
                for word in ast.walk(part):
                    if isinstance(word, ast.Constant) and NAME.fullmatch(str(word.value)):
                        yield str(word.value)


def test_every_event_is_on_the_page() -> None:
    files = (ROOT / "fieldlink").rglob("*.py")
    told = {name for file in files for name in told_in(file.read_text(encoding="utf-8"))}
    assert {"writeback.lost", "command.refused", "store.gone", "estimate"} <= told
    page = (ROOT / "docs" / "reference" / "events.md").read_text(encoding="utf-8")
    cells = re.findall(r"^\| (`.*?`) \|", page, re.MULTILINE)
    listed = [name for cell in cells for name in re.findall(r"`([^`]+)`", cell)]
    assert len(listed) == len(set(listed))
    assert set(listed) == told | MADE
