"""docs/modbus.md must say what the program does."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import get_args

from fieldlink.links import LinkState, link_kinds
from fieldlink.registers import ORDERS, DataType
from fieldlink.site import Device, Quirks

PAGE = (Path(__file__).parents[2] / "docs" / "modbus.md").read_text(encoding="utf-8")


def first_cells(heading: str) -> list[str]:
    """Return the first cells of the table whose header begins with ``heading``."""
    rows = PAGE.split(f"| {heading} |", 1)[1].split("\n\n")[0].splitlines()[2:]
    return [row.strip("|").split("|")[0].strip() for row in rows]


def codes(cells: list[str]) -> list[str]:
    return [name for cell in cells for name in re.findall(r"`([^`]+)`", cell)]


def test_every_transport_is_listed() -> None:
    links = get_args(Device.model_fields["link"].annotation)
    modbus = {link for link in links if link.startswith("modbus-")}
    assert set(codes(first_cells("`link`"))) == modbus
    assert modbus <= set(link_kinds())


def test_every_quirk_type_order_and_state_is_listed() -> None:
    assert codes(first_cells("key")) == list(Quirks.model_fields)
    assert set(codes(first_cells("type"))) == set(DataType)
    assert first_cells("order") == list(ORDERS)
    states = {state.name.lower() for state in LinkState} - {"closed"}
    assert set(codes(first_cells("state"))) == states


def test_the_shown_devices_are_valid() -> None:
    text = PAGE.split("```toml\n")[1].split("```")[0]
    devices = tomllib.loads(text)["devices"]
    assert [Device.model_validate(keys).link for keys in devices.values()] == [
        "modbus-rtu",
        "modbus-rtu",
        "modbus-tls",
    ]
