"""One register image behind pymodbus: a `SimDevice` whose every answer comes from the image.

pymodbus frames, parses and answers; the image decides. A request is handled without a single
suspension between looking and answering (an ``await`` in a `SimDevice` action would also stamp the
reply with a later request's transaction id), and the PLC's scan publishes between two turns of the
same event loop. So one request sees one scan, and one FC16 is one change.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from pymodbus.constants import ExcCodes
from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.pdu.bit_message import ReadCoilsRequest, ReadDiscreteInputsRequest
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
)
from pymodbus.simulator import DataType, SimData, SimDevice

from fieldlink.lab.plc.image import RegisterImage, RequestRefusedError
from fieldlink.registers.types import Table

__all__ = ["CHECKED_REQUESTS", "modbus_device", "other_units"]

TABLES = {
    1: Table.COIL,
    5: Table.COIL,
    15: Table.COIL,
    2: Table.DISCRETE,
    3: Table.HOLDING,
    6: Table.HOLDING,
    16: Table.HOLDING,
    22: Table.HOLDING,
    23: Table.HOLDING,
    4: Table.INPUT,
}
TABLE_SIZE = 65536


def _blank(
    image: RegisterImage,
) -> tuple[list[SimData], list[SimData], list[SimData], list[SimData]]:
    """Return room for the tables; which of these addresses exist is the image's decision."""

    def extent(table: Table) -> tuple[int, int]:
        spans = image.spans(table) or [(0, 1)]
        return spans[0][0], sum(spans[-1]) - spans[0][0]

    def bits(table: Table) -> list[SimData]:
        first, count = extent(table)
        # A list of values: pymodbus 3.16.1 applies `count` to bits twice.
        return [SimData(first, values=[False] * count, datatype=DataType.BITS)]

    def words(table: Table) -> list[SimData]:
        first, count = extent(table)
        return [SimData(first, count=count, values=0, datatype=DataType.REGISTERS)]

    return bits(Table.COIL), bits(Table.DISCRETE), words(Table.HOLDING), words(Table.INPUT)


def modbus_device(image: RegisterImage, unit: int) -> SimDevice:
    """Return the pymodbus device of an image, answering to one unit id."""

    async def answer(
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        values: Sequence[int | bool] | None,
    ) -> ExcCodes | None:
        table = TABLES[function]
        try:
            if values:
                image.write(table, address, [int(value) for value in values])
                return None
            if not table.is_bits:
                registers[address - start : address - start + count] = image.read(
                    table, address, count
                )
                return None
            # For bits pymodbus hands over words: its `address` counts bits, its `count` words.
            word = address // 16
            bits = image.read(table, word * 16, count * 16)
            for i in range(count):
                group = bits[i * 16 : i * 16 + 16]
                registers[word - start + i] = sum(bit << k for k, bit in enumerate(group))
        except RequestRefusedError as refused:
            return ExcCodes(refused.code)
        return None

    return SimDevice(id=unit, simdata=_blank(image), action=answer)


def other_units() -> SimDevice:
    """Return what answers for unused unit ids: exception 11, target did not respond."""

    async def answer(*_: object) -> ExcCodes:
        return ExcCodes.GATEWAY_NO_RESPONSE

    everywhere = SimData(0, count=TABLE_SIZE, values=0, datatype=DataType.REGISTERS)
    return SimDevice(id=0, simdata=[everywhere], action=answer)


class _CountChecked:
    """Answers a count out of range with exception 3; pymodbus drops the connection instead."""

    address: int
    count: int
    function_code: int
    MAX_COUNT: int

    def decode(self, data: bytes) -> None:
        self.address, self.count = struct.unpack(">HH", data[:4])

    async def datastore_update(self, context: object, device_id: int) -> ModbusPDU:
        if not 1 <= self.count <= self.MAX_COUNT:
            return ExceptionResponse(self.function_code, ExcCodes.ILLEGAL_VALUE)
        answer: ModbusPDU = await super().datastore_update(context, device_id)  # type: ignore[misc]
        return answer


class _ReadCoils(_CountChecked, ReadCoilsRequest):
    pass


class _ReadDiscreteInputs(_CountChecked, ReadDiscreteInputsRequest):
    pass


class _ReadHoldingRegisters(_CountChecked, ReadHoldingRegistersRequest):
    pass


class _ReadInputRegisters(_CountChecked, ReadInputRegistersRequest):
    pass


CHECKED_REQUESTS: list[type[ModbusPDU]] = [
    _ReadCoils,
    _ReadDiscreteInputs,
    _ReadHoldingRegisters,
    _ReadInputRegisters,
]
"""Requests that replace pymodbus' own."""
