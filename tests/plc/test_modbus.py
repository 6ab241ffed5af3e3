"""A register image behind a real Modbus TCP server, asked by pymodbus's client and by raw bytes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import pytest
import pytest_asyncio
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.pdu import ModbusPDU

from fieldlink.lab.plc.image import RegisterImage
from fieldlink.lab.plc.listening import Listening, PortError, listen
from fieldlink.lab.plc.modbus_device import modbus_device, other_units
from fieldlink.registers.types import Table

HOST = "127.0.0.1"


@pytest.fixture
def image() -> RegisterImage:
    image = RegisterImage()
    image.define(Table.HOLDING, 10, 2)
    image.put(Table.HOLDING, 10, [7, 8])
    image.define(Table.HOLDING, 100, 4, writable=True)
    image.define(Table.INPUT, 5, 1)
    image.put(Table.INPUT, 5, [55])
    image.define(Table.COIL, 19, 2, writable=True)
    image.define(Table.DISCRETE, 40, 1)
    image.put(Table.DISCRETE, 40, [1])
    return image


@pytest_asyncio.fixture
async def port(image: RegisterImage) -> AsyncIterator[int]:
    server, port = await listen([modbus_device(image, 1), other_units()], Listening())
    yield port
    await server.shutdown()


@pytest_asyncio.fixture
async def client(port: int) -> AsyncIterator[AsyncModbusTcpClient]:
    client = AsyncModbusTcpClient(HOST, port=port, timeout=60.0, retries=0)
    assert await client.connect()
    yield client
    client.close()


def refusal(reply: ModbusPDU) -> int:
    assert reply.isError()
    return reply.exception_code


async def test_every_table_is_read(client: AsyncModbusTcpClient) -> None:
    assert (await client.read_holding_registers(10, count=2)).registers == [7, 8]
    assert (await client.read_input_registers(5, count=1)).registers == [55]
    assert (await client.read_discrete_inputs(40, count=1)).bits[0] is True
    assert (await client.read_coils(19, count=2)).bits[:2] == [False, False]


async def test_written_registers_reach_the_image(
    client: AsyncModbusTcpClient, image: RegisterImage
) -> None:
    assert not (await client.write_registers(100, [1, 2, 3, 4])).isError()
    assert not (await client.write_register(102, 9)).isError()
    assert not (await client.write_coil(20, True)).isError()
    mask = await client.mask_write_register(address=103, and_mask=0x0000, or_mask=0x0005)
    assert not mask.isError()
    assert image.get(Table.HOLDING, 100, 4) == [1, 2, 9, 5]
    assert image.get(Table.COIL, 19, 2) == [0, 1]
    assert (await client.read_coils(20, count=1)).bits[0] is True


async def test_read_write_in_one_request(client: AsyncModbusTcpClient) -> None:
    reply = await client.readwrite_registers(
        read_address=100, read_count=2, write_address=100, values=[5]
    )
    assert reply.registers == [5, 0]


async def test_illegal_addresses_answer_with_exception_2(client: AsyncModbusTcpClient) -> None:
    assert refusal(await client.read_holding_registers(10, count=3)) == 2
    assert refusal(await client.read_holding_registers(60_000, count=1)) == 2
    assert refusal(await client.read_input_registers(10, count=1)) == 2
    assert refusal(await client.read_coils(0, count=17)) == 2
    assert refusal(await client.write_register(10, 1)) == 2
    assert refusal(await client.write_coil(21, True)) == 2


async def test_a_unit_that_is_unused_answers_with_exception_11(
    client: AsyncModbusTcpClient,
) -> None:
    assert refusal(await client.read_holding_registers(10, count=1, device_id=7)) == 11


@pytest.mark.parametrize(("function", "most"), [(1, 2000), (2, 2000), (3, 125), (4, 125)])
@pytest.mark.parametrize("excess", [False, True])
async def test_a_count_out_of_range_answers_with_exception_3(
    port: int, function: int, most: int, excess: bool
) -> None:
    count = most + 1 if excess else 0
    reader, writer = await asyncio.open_connection(HOST, port)
    request = bytes([1, function, 0, 10]) + count.to_bytes(2, "big")
    writer.write(b"\x00\x2a\x00\x00\x00\x06" + request)
    reply = await reader.readexactly(9)
    writer.close()
    assert reply == b"\x00\x2a\x00\x00\x00\x03" + bytes([1, 0x80 | function, 3])


async def test_a_port_in_use_is_reported_with_its_remedy(port: int, image: RegisterImage) -> None:
    with pytest.raises(PortError, match=rf"127.0.0.1:{port}: Address already in use; stop what"):
        await listen([modbus_device(image, 1)], Listening(host=HOST, port=port))
