"""The register image of a simulated PLC: what exists, what it holds, who may write it.

The PLC program and the network see the same image, and nothing else is shared between them. The
program reads and writes with `get` and `put`, which know no rules; a client comes through `read`
and `write`, which answer as the Modbus application protocol says (V1.1b3, section 7): exception 2
for a register that does not exist or that a client may not write, exception 3 for a value out of
range.

    image = RegisterImage()
    image.define(Table.HOLDING, 100, 2, writable=True)
    image.write(Table.HOLDING, 100, [1, 2])
    image.read(Table.HOLDING, 100, 2)        # [1, 2]
    image.read(Table.HOLDING, 101, 2)        # RequestRefusedError, exception 2

Coils and discrete inputs live in words of sixteen, as in most PLCs: in a word with a declared bit,
every undeclared bit reads 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum

from fieldlink.errors import FieldlinkError
from fieldlink.registers.types import Table

__all__ = ["ExceptionCode", "RegisterImage", "RequestRefusedError"]

WORD_BITS = 16

Check = Callable[[Sequence[int]], str | None]


class ExceptionCode(IntEnum):
    """Modbus exception codes that the image answers with."""

    ILLEGAL_ADDRESS = 2
    ILLEGAL_VALUE = 3


class RequestRefusedError(FieldlinkError):
    """A client asked for what the PLC does not do; `code` is the exception code of the answer."""

    def __init__(self, code: ExceptionCode, message: str) -> None:
        super().__init__(message)
        self.code = code


@dataclass(frozen=True, slots=True)
class _Guard:
    """A check of the whole value that a write touches, even where it touches a part of it."""

    table: Table
    address: int
    count: int
    check: Check

    def touches(self, table: Table, address: int, count: int) -> bool:
        return (
            table == self.table
            and address < self.address + self.count
            and self.address < address + count
        )


class RegisterImage:
    """Four tables of registers or bits; every method is one indivisible step for a caller."""

    def __init__(self) -> None:
        self._cells: dict[Table, dict[int, int]] = {table: {} for table in Table}
        self._writable: dict[Table, set[int]] = {table: set() for table in Table}
        self._guards: list[_Guard] = []
        self._unread: set[tuple[Table, int]] = set()

    def define(
        self,
        table: Table,
        address: int,
        count: int,
        *,
        writable: bool = False,
        check: Check | None = None,
    ) -> None:
        """Make registers exist, holding zero; defining one twice keeps its value.

        Args:
            table: which of the four tables.
            address: first register or bit, 0-based.
            count: how many.
            writable: whether a client may write them (holding registers and coils alone).
            check: judges the value that these registers would hold after a client's write, and
                returns what is wrong with it; a partial write is judged with the rest as it is.

        Raises:
            ValueError: outside 0..65535, or writable where the protocol has no write.
        """
        if count < 1 or not 0 <= address <= 65536 - count:
            raise ValueError(f"{table} {address}..{address + count - 1} is outside 0..65535")
        if writable and not table.is_writable:
            raise ValueError(f"{table} {address}: Modbus has no request that writes this table")
        cells = self._cells[table]
        first, last = address, address + count - 1
        if table.is_bits:
            first, last = first - first % WORD_BITS, last - last % WORD_BITS + WORD_BITS - 1
        for cell in range(first, last + 1):
            cells.setdefault(cell, 0)
        if writable:
            self._writable[table].update(range(address, address + count))
        if check is not None:
            self._guards.append(_Guard(table, address, count, check))

    def get(self, table: Table, address: int, count: int) -> list[int]:
        """Return what the program sees; the registers must have been defined."""
        cells = self._cells[table]
        return [cells[cell] for cell in range(address, address + count)]

    def put(self, table: Table, address: int, words: Sequence[int]) -> None:
        """Store what the program computed; the registers must have been defined."""
        cells = self._cells[table]
        for cell, word in enumerate(words, start=address):
            if cell not in cells:
                raise KeyError(f"{table} register {cell} was never defined")
            cells[cell] = word

    def await_read(self, places: Iterable[tuple[Table, int]]) -> None:
        """Note registers that a client is to read, instead of those noted before; see `is_read`."""
        self._unread = set(places)

    @property
    def is_read(self) -> bool:
        """Whether clients have read every register that `await_read` noted last."""
        return not self._unread

    def read(self, table: Table, address: int, count: int) -> list[int]:
        """Answer a client's read.

        Raises:
            RequestRefusedError: exception 2 when one of the registers does not exist.
        """
        cells = self._cells[table]
        if self._unread:
            self._unread.difference_update((table, address + k) for k in range(count))
        try:
            return [cells[cell] for cell in range(address, address + count)]
        except KeyError as missing:
            raise RequestRefusedError(
                ExceptionCode.ILLEGAL_ADDRESS,
                f"read of {table} {address}..{address + count - 1}: {missing} does not exist",
            ) from None

    def write(self, table: Table, address: int, words: Sequence[int]) -> None:
        """Carry out a client's write, wholly or not at all.

        Raises:
            RequestRefusedError: exception 2 when a register does not exist or is read-only,
                exception 3 when a value is outside its declared range.
        """
        count = len(words)
        where = f"write of {table} {address}..{address + count - 1}"
        allowed = self._writable[table]
        for cell in range(address, address + count):
            if cell not in allowed:
                why = "is read-only" if cell in self._cells[table] else "does not exist"
                raise RequestRefusedError(ExceptionCode.ILLEGAL_ADDRESS, f"{where}: {cell} {why}")
        for guard in self._guards:
            if not guard.touches(table, address, count):
                continue
            after = dict(enumerate(self.get(table, guard.address, guard.count), guard.address))
            after.update((c, w) for c, w in enumerate(words, address) if c in after)
            if fault := guard.check(list(after.values())):
                raise RequestRefusedError(ExceptionCode.ILLEGAL_VALUE, f"{where}: {fault}")
        self.put(table, address, words)

    def spans(self, table: Table) -> list[tuple[int, int]]:
        """Return the runs of existing registers as ``(first, count)``, in order of address."""
        runs: list[tuple[int, int]] = []
        for cell in sorted(self._cells[table]):
            if runs and cell == sum(runs[-1]):
                runs[-1] = (runs[-1][0], runs[-1][1] + 1)
            else:
                runs.append((cell, 1))
        return runs
