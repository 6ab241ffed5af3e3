"""What ``fieldlink status`` prints of a loop."""

from __future__ import annotations

from typing import Any

import pytest

from fieldlink.cli.ask_daemon import _lines

LOOP: dict[str, Any] = {
    "name": "FC101", "device": "plc", "expected": 100, "read": 100, "bad": 0, "fault": "",
    "missed": 0, "verdict": "stiction", "stick_band": 11.0, "stick_band_low": 10.12,
    "stick_band_high": 11.91, "waiting": None,
    "block": {"status": None, "seq": None, "acknowledged": False, "reason": ""},
}  # fmt: skip


def printed(units: dict[str, str], **loop: object) -> str:
    daemon = {"alive": True, "since": "2026-11-26T08:00:00+00:00"}
    found = {"daemon": daemon, "devices": [], "loops": [{**LOOP, **loop}]}
    return _lines(found, units)[1]


@pytest.mark.parametrize(
    ("units", "loop", "said"),
    [
        ({"FC101": "%"}, {}, "stiction, S = 11 (10.12 to 11.91) %"),
        ({}, {}, "stiction, S = 11 (10.12 to 11.91) in units of OP"),
        ({"FC101": "mA"}, {"stick_band_low": None}, "stiction, S = 11 mA"),
        ({"FC101": "%"}, {"verdict": "no_stiction"}, "no_stiction"),
        ({}, {"verdict": None, "filled": 0.5, "estimates": 0}, "no estimate yet, window 50% full"),
        (
            {},
            {"verdict": None, "filled": 1.0, "estimates": 0},
            "no estimate yet, window full and being judged (the first time after an installation "
            "that takes minutes)",
        ),
        ({}, {"verdict": None, "filled": 1.0, "estimates": 2}, "no estimate yet, window 100% full"),
    ],
)
def test_a_stick_band_has_its_interval_and_unit(
    units: dict[str, str], loop: dict[str, object], said: str
) -> None:
    assert printed(units, **loop).endswith(f"0 missed; {said}")


@pytest.mark.parametrize(
    ("reason", "said"),
    [("the PLC has accepted it", "  block 2: withdrawn; the PLC has accepted it"),
     ("", "  block 2: withdrawn")],
)  # fmt: skip
def test_a_block_without_a_reason_ends_with_its_status(reason: str, said: str) -> None:
    """So stands the block of a daemon that has started again."""
    block = {"status": "withdrawn", "seq": 2, "acknowledged": True, "reason": reason}
    daemon = {"alive": True, "since": "2026-11-26T08:00:00+00:00"}
    found = {"daemon": daemon, "devices": [], "loops": [{**LOOP, "block": block}]}
    assert _lines(found, {})[2] == said


def test_a_store_that_cannot_be_written_comes_before_devices_and_loops() -> None:
    daemon = {"alive": True, "since": "2026-11-26T08:00:00+00:00"}
    store = {"failing": True, "reason": "database or disk is full", "waiting": 812, "lost": 1}
    found = {"daemon": daemon, "devices": [], "loops": [LOOP], "store": store}
    assert _lines(found, {})[1:3] == [
        "store: cannot be written: database or disk is full; 812 records waiting in memory",
        "store: 1 record lost",
    ]
    well = {**found, "store": {"failing": False, "reason": "", "waiting": 3, "lost": 0}}
    assert _lines(well, {})[1].startswith("loop FC101")
