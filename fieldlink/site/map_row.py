"""One row of a register map, from cells of text to a tag; everything wrong with it is collected."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import TypeVar

from fieldlink.printable import as_printable, quoted
from fieldlink.registers import ORDERS, DataType, Order, Table, Tag
from fieldlink.site.errors import Problem, nearest
from fieldlink.site.map_words import meaning_of
from fieldlink.site.number_cells import may_group
from fieldlink.whole_numbers import whole_number

__all__ = ["COLUMNS", "NUMBER_COLUMNS", "REQUIRED", "RowReader"]

_POINTS = ("raw_low", "raw_high", "eng_low", "eng_high")
NUMBER_COLUMNS = ("scale", "offset", *_POINTS, "unit", "low", "high", "outside")
"""What turns a number of the device into an engineering value; node maps have them too."""
REQUIRED = ("tag", "address", "type")
COLUMNS = (
    "tag",
    "table",
    "address",
    "type",
    "bit",
    "length",
    "order",
    *NUMBER_COLUMNS,
    "invalid",
    "writable",
    "every",
    "comment",
)

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+")
_LAST_ADDRESS = 0xFFFF
_LONGEST_TEXT = 125
SCALES = (1e-30, 1e30)
"""Scalings with which the largest and the smallest register still is a number."""
LONGEST_INTERVAL = 1e8
"""Seconds between two readings of a tag: three years."""
_BOOLEANS = {
    "": False,
    "true": True,
    "yes": True,
    "1": True,
    "false": False,
    "no": False,
    "0": False,
}

T = TypeVar("T")


class RowReader:
    """Reads one row cell by cell and collects what is wrong with it in `problems`.

    Args:
        file, line: where the row is, for the problems.
        cell: the text of a column, empty where there is none.
        number: the number in a cell; raises ValueError when it holds none.
    """

    def __init__(
        self,
        file: str,
        line: int,
        cell: Callable[[str], str],
        number: Callable[[str], float],
    ) -> None:
        self._file = file
        self._line = line
        self._cell = cell
        self._parse = number
        self.problems: list[Problem] = []

    def report(self, column: str, message: str, remedy: str) -> None:
        """Note something wrong with a cell."""
        self.problems.append(Problem(self._file, column, message, remedy, self._line))

    def tag(self, word_order: Order, byte_order: Order) -> Tag | None:
        """Return the row's tag, None when something is wrong with it."""
        name = self._cell("tag")
        if not name:
            self.report("tag", "the tag has no name", "name it")
        for column in ("tag", "unit", "comment"):
            self._printable(column)
        table = self._choice("table", {item.value: item for item in Table}, Table.HOLDING)
        data_type = self._choice("type", {item.value: item for item in DataType}, None)
        address = self._address()
        scale, offset = self._scaling(data_type)
        low, high = self._number("low", None), self._number("high", None)
        clamp = self._choice("outside", {"bad": False, "clamp": True}, False)
        writable = self._choice("writable", _BOOLEANS, False)
        every = self._number("every", 0.0) or 0.0
        orders = self._choice("order", ORDERS, (word_order, byte_order), fold=str.upper)
        if low is not None and high is not None and low >= high:
            self.report(
                "low", f"low = {low:g} is not below high = {high:g}", "exchange or correct them"
            )
        if clamp and low is None and high is None:
            self.report("outside", "there is no range to clamp to", "give low, high or both")
        if not 0.0 <= every <= LONGEST_INTERVAL:
            remedy = f"give seconds from 0 to {LONGEST_INTERVAL:g}, or leave it empty"
            self.report("every", f"{every:g} is not an interval", remedy)
        if table is not None and data_type is not None:
            self._type_fits(table, data_type)
        bit = self._bit(table, data_type)
        length = self._length(data_type)
        if table is not None and data_type is not None and address is not None:
            last = address + (length or data_type.registers) - 1
            if last > _LAST_ADDRESS:
                self.report(
                    "address", f"{data_type} at {address} ends at {last}", "end at 65535 or below"
                )
        if table is not None and writable and not table.is_writable:
            self.report(
                "writable", f"{table} cannot be written", "use holding or coil, or write no"
            )
        if writable and bit is not None:
            self.report(
                "writable",
                "one bit of a register cannot be written without the other fifteen",
                "write no, or map the whole register",
            )
        invalid, patterns = self._invalid(data_type)
        if self.problems or table is None or data_type is None or address is None:
            return None
        assert orders is not None
        return Tag(
            name=name,
            table=table,
            address=address,
            data_type=data_type,
            scale=scale,
            offset=offset,
            unit=self._cell("unit"),
            low=low,
            high=high,
            writable=bool(writable),
            comment=self._cell("comment"),
            word_order=orders[0],
            byte_order=orders[1],
            bit=bit,
            length=length,
            clamp=bool(clamp),
            invalid=invalid,
            invalid_patterns=patterns,
            every=every,
        )

    def _type_fits(self, table: Table, data_type: DataType) -> None:
        if table.is_bits and data_type is not DataType.BOOL:
            self.report("type", f"a {table} is one bit, not {data_type}", "use bool")
        if data_type is DataType.STRING:
            for column in ("scale", "offset", *_POINTS, "low", "high", "outside", "invalid"):
                if self._cell(column):
                    self.report(column, "a string is not a number", "leave it empty")

    def _scaling(self, data_type: DataType | None) -> tuple[float, float]:
        """Return scale and offset, given as such or by two points."""
        scale, offset = self._number("scale", 1.0), self._number("offset", 0.0)
        if scale == 0.0:
            self.report("scale", "a scale of 0 loses the value", "give engineering units per count")
        points = [self._number(column, None) for column in _POINTS]
        if all(point is None for point in points):
            if scale and not self._is_usable("scale", scale, offset or 0.0):
                return 1.0, 0.0
            return 1.0 if scale is None else scale, offset or 0.0
        if self._cell("scale") or self._cell("offset"):
            self.report("scale", "scale or offset and two points are given", "keep one of the ways")
        raw_low, raw_high, eng_low, eng_high = points
        if raw_low is None or raw_high is None or eng_low is None or eng_high is None:
            empty = [name for name in _POINTS if not self._cell(name)]
            if empty:
                remedy = "two points need raw_low, raw_high, eng_low and eng_high"
                self.report(empty[0], "is empty", remedy)
            return 1.0, 0.0
        if raw_low == raw_high or eng_low == eng_high:
            self.report("raw_low", "both points are the same", "give two that differ in both")
            return 1.0, 0.0
        small, large = (-math.inf, math.inf) if data_type is None else data_type.bounds
        for column, raw in (("raw_low", raw_low), ("raw_high", raw_high)):
            # Manuals round the ends of a type: 0 to 65536 and -32768 to 32768 are usual.
            if not small - 1.0 <= raw <= large + 1.0:
                message = f"{raw:.10g} is no count of {data_type} ({small:.10g} to {large:.10g})"
                self.report(column, message, "correct it or the type")
        slope = (eng_high - eng_low) / (raw_high - raw_low)
        offset = eng_low - slope * raw_low
        if not self._is_usable("raw_low", slope, offset):
            return 1.0, 0.0
        return slope, offset

    def _is_usable(self, column: str, scale: float, offset: float) -> bool:
        """Whether a scaling leaves a number of every register; says so if it does not."""
        small, large = SCALES
        if small <= abs(scale) <= large and abs(offset) <= large:
            return True
        message = f"scale {scale:g} with offset {offset:g} leaves no number of a register"
        remedy = f"give a scale from {small:g} to {large:g} and an offset up to {large:g}"
        self.report(column, message, remedy)
        return False

    def _printable(self, column: str) -> None:
        cell = self._cell(column)
        if not cell.isprintable():
            self.report(
                column,
                f"{quoted(as_printable(cell))} has characters that cannot be printed",
                "remove them",
            )

    def _bit(self, table: Table | None, data_type: DataType | None) -> int | None:
        cell = self._cell("bit")
        if not cell:
            return None
        if data_type is not DataType.BOOL or table is None or table.is_bits:
            self.report(
                "bit", "only a bool in a register has one", "use type bool in holding or input"
            )
            return None
        return self._whole("bit", 0, 15, "give 0 (least significant) to 15")

    def _length(self, data_type: DataType | None) -> int:
        if data_type is not DataType.STRING:
            if (length := self._cell("length")) and data_type is not None:
                own = data_type.registers
                self.report(
                    "length",
                    f"{length} is given for {data_type}, which takes "
                    + ("1 register" if own == 1 else f"{own} registers"),
                    "correct the type if it takes more (int32, float64), else leave it empty",
                )
            return 0
        remedy = f"give the registers of the string, 1 to {_LONGEST_TEXT}"
        if not self._cell("length"):
            self.report("length", "is empty", remedy)
            return 0
        return self._whole("length", 1, _LONGEST_TEXT, remedy) or 0

    def _invalid(self, data_type: DataType | None) -> tuple[tuple[float, ...], tuple[int, ...]]:
        """Return the raw numbers and the bit patterns that mean invalid."""
        numbers: list[float] = []
        patterns: list[int] = []
        for word in self._cell("invalid").replace("|", " ").split():
            if word.lower() == "nan":
                # NaN is never good; saying so is allowed.
                continue
            try:
                if word.lower().startswith("0x"):
                    patterns.append(int(word, 16))
                    continue
                numbers.append(self._parse(word))
            except ValueError:
                self.report(
                    "invalid",
                    f"{quoted(word)} is not a number",
                    "give raw values, such as 0x8000 -9999 nan",
                )
        bits = 16 * (data_type.registers if data_type is not None else 4)
        if patterns and max(patterns) >= 1 << bits:
            self.report(
                "invalid",
                f"0x{max(patterns):X} has more than {bits} bits",
                "correct it or the type",
            )
        return tuple(numbers), tuple(patterns)

    def _choice(
        self,
        column: str,
        choices: Mapping[str, T],
        default: T | None,
        fold: Callable[[str], str] = str.lower,
    ) -> T | None:
        cell = fold(self._cell(column))
        if not cell and default is not None:
            return default
        if cell not in choices:
            message = f"{quoted(self._cell(column))} is unknown" if cell else "is empty"
            # What others call float is float32 here, not the word that looks most alike.
            meant = fold(meaning_of(column, cell))
            known = [name for name in choices if name]
            self.report(column, message, nearest(meant if meant in known else cell, known))
            return None
        return choices[cell]

    def _number(self, column: str, default: float | None) -> float | None:
        cell = self._cell(column)
        if not cell:
            return default
        try:
            return self._parse(cell)
        except ValueError:
            if "," in cell and may_group(cell):
                what, remedy = "may be decimals or grouped digits", "write 1000 or 1.0"
            elif _DECIMAL_COMMA.fullmatch(cell):
                what = "has a decimal comma, which a file with commas between cells cannot have"
                remedy = f"write {cell.replace(',', '.')}, or put semicolons between the cells"
            else:
                what, remedy = "is not a number", "give a number or leave it empty"
            self.report(column, f"{quoted(cell)} {what}", remedy)
            return default

    def _whole(self, column: str, low: int, high: int, remedy: str) -> int | None:
        cell = self._cell(column)
        number = whole_number(cell, high)
        if number is None or number < low:
            self.report(
                column, f"{quoted(cell)} is not a whole number from {low} to {high}", remedy
            )
            return None
        return number

    def _address(self) -> int | None:
        cell = self._cell("address")
        try:
            address = int(cell)
        except ValueError:
            message = f"{quoted(cell)} is not a whole number" if cell else "is empty"
            self.report("address", message, "give the 0-based address, for 40001 that is 0")
            return None
        if not 0 <= address <= _LAST_ADDRESS:
            remedy = "give the 0-based address, for 40001 that is 0"
            self.report("address", f"{address} is outside 0 to {_LAST_ADDRESS}", remedy)
            return None
        return address
