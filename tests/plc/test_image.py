"""The register image answers as the Modbus application protocol says."""

from __future__ import annotations

import pytest

from fieldlink.lab.plc.image import ExceptionCode, RegisterImage, RequestRefusedError
from fieldlink.registers.types import Table

HOLDING, COIL = Table.HOLDING, Table.COIL


@pytest.fixture
def image() -> RegisterImage:
    image = RegisterImage()
    image.define(HOLDING, 10, 2)
    image.define(HOLDING, 20, 4, writable=True)
    image.define(COIL, 3, 2, writable=True)
    return image


def test_what_the_program_puts_a_client_reads(image: RegisterImage) -> None:
    image.put(HOLDING, 10, [7, 8])
    assert image.read(HOLDING, 10, 2) == [7, 8]


def test_a_write_is_seen_by_the_program(image: RegisterImage) -> None:
    image.write(HOLDING, 21, [1, 2])
    assert image.get(HOLDING, 20, 4) == [0, 1, 2, 0]


@pytest.mark.parametrize(("table", "address", "count"), [(HOLDING, 10, 3), (Table.INPUT, 10, 1)])
def test_a_register_that_does_not_exist_is_an_illegal_address(
    image: RegisterImage, table: Table, address: int, count: int
) -> None:
    with pytest.raises(RequestRefusedError, match="does not exist") as refused:
        image.read(table, address, count)
    assert refused.value.code is ExceptionCode.ILLEGAL_ADDRESS


@pytest.mark.parametrize(
    ("address", "words", "why"),
    [(10, [1], "10 is read-only"), (23, [1, 1], "24 does not exist")],
)
def test_a_refused_write_changes_nothing(
    image: RegisterImage, address: int, words: list[int], why: str
) -> None:
    with pytest.raises(RequestRefusedError, match=why) as refused:
        image.write(HOLDING, address, words)
    assert refused.value.code is ExceptionCode.ILLEGAL_ADDRESS
    assert image.get(HOLDING, 20, 4) == [0, 0, 0, 0]


def test_a_check_sees_the_whole_value_of_a_partial_write() -> None:
    image = RegisterImage()
    seen: list[list[int]] = []

    def even_sum(words: object) -> str | None:
        seen.append(list(words))  # type: ignore[call-overload]
        return "the sum is odd" if sum(seen[-1]) % 2 else None

    image.define(HOLDING, 0, 2, writable=True, check=even_sum)
    image.write(HOLDING, 0, [3, 5])
    image.write(HOLDING, 1, [7])
    with pytest.raises(RequestRefusedError, match="the sum is odd") as refused:
        image.write(HOLDING, 0, [4])
    assert refused.value.code is ExceptionCode.ILLEGAL_VALUE
    assert seen == [[3, 5], [3, 7], [4, 7]]
    assert image.get(HOLDING, 0, 2) == [3, 7]


def test_bits_exist_in_words_of_sixteen_but_only_declared_ones_are_written(
    image: RegisterImage,
) -> None:
    assert image.read(COIL, 0, 16) == [0] * 16
    image.write(COIL, 4, [1])
    assert image.read(COIL, 3, 2) == [0, 1]
    with pytest.raises(RequestRefusedError, match="5 is read-only"):
        image.write(COIL, 5, [1])
    with pytest.raises(RequestRefusedError, match="does not exist"):
        image.read(COIL, 0, 17)


@pytest.mark.parametrize("address", [-1, 65535])
def test_registers_outside_the_address_space_cannot_be_defined(address: int) -> None:
    with pytest.raises(ValueError, match="is outside"):
        RegisterImage().define(HOLDING, address, 2)


def test_input_registers_cannot_be_writable() -> None:
    with pytest.raises(ValueError, match="no request that writes"):
        RegisterImage().define(Table.INPUT, 0, 1, writable=True)


def test_spans_are_the_runs_of_existing_registers(image: RegisterImage) -> None:
    assert image.spans(HOLDING) == [(10, 2), (20, 4)]
    assert image.spans(COIL) == [(0, 16)]
