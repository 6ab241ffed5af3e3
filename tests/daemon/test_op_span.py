"""OP's span by the register map, which the daemon's diagnosis goes by."""

from __future__ import annotations

from typing import Any

import pytest

from fieldlink.daemon.loop_spec import LoopSpec
from fieldlink.registers import DataType, Table, Tag
from fieldlink.site import Device, Loop


@pytest.mark.parametrize(
    ("told", "span"),
    [
        ({}, None),
        ({"unit": "%"}, 100.0),
        ({"unit": "%", "low": -5.0, "high": 105.0}, 100.0),
        ({"unit": "mA", "low": 4.0, "high": 20.0}, 16.0),
        ({"low": 0.0, "high": 1.0}, 1.0),
        ({"low": 1.0}, None),
    ],
)
def test_the_register_map_tells_the_span(told: dict[str, Any], span: float | None) -> None:
    tag = Tag("OP", Table.HOLDING, 0, DataType.FLOAT32, **told)
    loop = Loop(device="plc", op="OP", pv="PV", period=1.0)
    plc = Device(link="modbus-tcp", host="127.0.0.1", register_map="map.csv")
    assert LoopSpec("FC101", loop, plc, {"OP": tag}, plc.speed).op_span == span
    assert LoopSpec("FC101", loop, plc, {}, plc.speed).op_span is None
