"""Looking at a device without a description: which units answer, which addresses can be read.

Only reads are sent, one at a time, with a pause between them and never more than allowed. A block
that is refused is cut in halves; single addresses that are refused are not readable. Behind a long
stretch of them only every tenth address of a refused block is tried, and the block is cut in halves
as soon as one can be read; `SurveySettings.thorough` always cuts.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from fieldlink.links.backoff import Backoff, BackoffSettings
from fieldlink.links.clock import SystemClock
from fieldlink.links.connection import ModbusConnection
from fieldlink.links.errors import (
    ExceptionCode,
    ExceptionReplyError,
    LinkError,
    LinkUnreachableError,
    ReplyMismatchError,
)
from fieldlink.links.transports import line_settings
from fieldlink.registers import Table
from fieldlink.site import Device

__all__ = ["Survey", "SurveySettings", "TableSurvey", "UnitSurvey", "survey"]

BARREN = 100
"""Addresses in a row, each tried and refused, behind which a stretch is plainly unreadable."""

STRIDE = 10
"""Distance of the addresses that are tried there: register lists begin at round addresses."""

_ABOUT_ADDRESSES = frozenset(
    {ExceptionCode.ILLEGAL_ADDRESS, ExceptionCode.ILLEGAL_VALUE, ExceptionCode.DEVICE_FAILURE}
)
"""Exceptions by which devices say that an address cannot be read."""

Progress = Callable[[str, int], None]
"""Called with what is looked at, and the requests sent so far."""


@dataclass(frozen=True, slots=True)
class SurveySettings:
    """What to look at, and how gently.

    Attributes:
        units: unit ids to try.
        tables: tables to look at.
        first, last: addresses, both included.
        block: addresses asked for at once.
        thorough: try every address of every refused block.
        pause: seconds between a reply and the next request.
        max_requests: most requests in all.
    """

    units: tuple[int, ...] = (1,)
    tables: tuple[Table, ...] = tuple(Table)
    first: int = 0
    last: int = 499
    block: int = 100
    thorough: bool = False
    pause: float = 0.02
    max_requests: int = 2000


@dataclass(frozen=True, slots=True)
class TableSurvey:
    """One table of a unit.

    Attributes:
        table: which.
        served: whether the unit knows the table's function code at all.
        ranges: readable addresses (first, last), both included.
        looked_to: the last address that was looked at.
        sampled: stretches (first, last) of which only every tenth address was tried.
        put_off: exception codes that say nothing about an address, such as 6 (busy), with the
            number of requests that they answered: what they hide may be readable.
    """

    table: str
    served: bool
    ranges: tuple[tuple[int, int], ...]
    looked_to: int
    sampled: tuple[tuple[int, int], ...] = ()
    put_off: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, slots=True)
class UnitSurvey:
    """One unit id that answers.

    Attributes:
        unit: the id.
        tables: what was looked at.
        max_registers: of the longest request that was answered, where a longer one was not although
            all of its registers can be read; None where no such limit was met.
    """

    unit: int
    tables: tuple[TableSurvey, ...]
    max_registers: int | None = None


@dataclass(frozen=True, slots=True)
class Survey:
    """What was found.

    Attributes:
        where: the device.
        units: the units that answer.
        silent: the units that do not.
        unfit: units to whose requests something came that is no answer, and what it was.
        requests: how many were sent.
        complete: False when the limit of requests, or a device that fell silent, ended it early.
        note: why it is not complete.
    """

    where: str
    units: tuple[UnitSurvey, ...]
    silent: tuple[int, ...]
    requests: int
    complete: bool
    note: str = ""
    unfit: tuple[tuple[int, str], ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return it as dictionaries, lists, strings and numbers."""
        return asdict(self)


class _EnoughError(Exception):
    """The survey ends here; the text says why."""


@dataclass(slots=True)
class _Look:
    """One unit while it is looked at."""

    settings: SurveySettings
    progress: Progress
    unit: int = 0
    requests: int = 0
    silent_in_a_row: int = 0
    longest: int = 0
    too_long: int | None = None
    put_off: Counter[int] = field(default_factory=Counter)
    unfit: dict[int, str] = field(default_factory=dict)
    connections: list[ModbusConnection] = field(default_factory=list)

    async def ask(self, link: ModbusConnection, table: Table, first: int, count: int) -> None:
        if self.requests >= self.settings.max_requests:
            raise _EnoughError(f"the limit of {self.settings.max_requests} requests is reached")
        self.requests += 1
        self.progress(f"unit {self.unit}, {table} {first} to {first + count - 1}", self.requests)
        await link.read(table, first, count)
        if not table.is_bits:
            self.longest = max(self.longest, count)
            if self.too_long is not None and count >= self.too_long:
                # It was no limit: what was refused twice is answered now.
                self.too_long = None

    @property
    def max_registers(self) -> int | None:
        """The limit of a request that was met; None when none was."""
        return None if self.too_long is None else self.longest

    async def note_too_long(
        self, link: ModbusConnection, table: Table, first: int, count: int
    ) -> None:
        """Note that a block is refused whose parts are not, if it is refused again."""
        if table.is_bits or (self.too_long is not None and count >= self.too_long):
            return
        try:
            await self.ask(link, table, first, count)
        except LinkError as error:
            self.heed(error)
            self.too_long = count

    def heed(self, error: LinkError) -> None:
        """Count silence; let out what ends the look at a table or at the device."""
        if isinstance(error, ExceptionReplyError) and not error.code.is_the_gateways:
            self.silent_in_a_row = 0
            if error.code is ExceptionCode.ILLEGAL_FUNCTION:
                raise error
            if error.code not in _ABOUT_ADDRESSES:
                self.put_off[error.number] += 1
            return
        self.silent_in_a_row += 1
        if self.silent_in_a_row >= 3:
            raise _EnoughError(f"the device fell silent: {error}") from error


async def survey(
    device: Device,
    settings: SurveySettings,
    progress: Progress = lambda _what, _requests: None,
    resolve: Callable[[str | Path], Path] = Path,
) -> Survey:
    """Look at a device; nothing is ever written. ``resolve`` finds the files of a site's device.

    Raises:
        LinkUnreachableError: there is no connection at all.
    """
    look = _Look(settings, progress)
    found: list[UnitSurvey] = []
    silent: list[int] = []
    note = ""
    try:
        for unit in settings.units:
            link = _connection(device, unit, settings.pause, resolve)
            look.connections.append(link)
            look.unit = unit
            if not await _answers(look, link):
                if unit not in look.unfit:
                    silent.append(unit)
                await link.close()
                continue
            look.unfit.pop(unit, None)
            look.longest, look.too_long = 0, None
            tables = []
            found.append(UnitSurvey(unit, ()))
            for table in settings.tables:
                tables.append(await _look_at(look, link, table))
                found[-1] = UnitSurvey(unit, tuple(tables), look.max_registers)
            await link.close()
    except _EnoughError as enough:
        note = str(enough)
    finally:
        for link in look.connections:
            await link.close()
    where = device.where.rsplit(" unit", 1)[0]
    unfit = tuple(look.unfit.items())
    return Survey(where, tuple(found), tuple(silent), look.requests, not note, note, unfit)


def _connection(
    device: Device, unit: int, pause: float, resolve: Callable[[str | Path], Path]
) -> ModbusConnection:
    quirks = device.quirks.model_copy(update={"pause_between_requests": pause})
    device = device.model_copy(update={"unit": unit, "quirks": quirks})
    backoff = Backoff(BackoffSettings(first=1e-6, cap=1e-6))
    line = line_settings(device, device.where, resolve)
    return ModbusConnection(
        device.where, device.where, unit, line, device.timeout, backoff, SystemClock()
    )


async def _answers(look: _Look, link: ModbusConnection) -> bool:
    """Whether the unit answers to anything; one request, and one more when it keeps silent."""
    for table in (Table.HOLDING, Table.INPUT):
        try:
            await look.ask(link, table, look.settings.first, 1)
        except ExceptionReplyError as error:
            return not error.code.is_the_gateways
        except LinkUnreachableError as error:
            if link.connects == 0:
                raise
            look.progress(str(error), look.requests)
        except LinkError as error:
            if isinstance(error, ReplyMismatchError):
                look.unfit[look.unit] = f"{error.what}; {error.remedy}"
            look.progress(str(error), look.requests)
        else:
            return True
    return False


async def _look_at(look: _Look, link: ModbusConnection, table: Table) -> TableSurvey:
    settings = look.settings
    readable: list[int] = []
    sampled: list[int] = []
    look.put_off.clear()
    first = settings.first
    while first <= settings.last:
        count = min(settings.block, settings.last - first + 1)
        refused = first - (readable[-1] + 1 if readable else settings.first)
        try:
            if (
                refused < BARREN
                or settings.thorough
                or await _has_some(look, link, table, first, count)
            ):
                readable.extend(await _readable(look, link, table, first, count))
            else:
                sampled.extend(range(first, first + count))
        except ExceptionReplyError as error:
            if error.code is not ExceptionCode.ILLEGAL_FUNCTION:
                raise
            return TableSurvey(table.value, False, (), first)
        first += count
    runs = tuple(_runs(readable))
    put_off = tuple(sorted(look.put_off.items()))
    return TableSurvey(table.value, True, runs, settings.last, tuple(_runs(sampled)), put_off)


async def _has_some(
    look: _Look, link: ModbusConnection, table: Table, first: int, count: int
) -> bool:
    """Whether the block, or one of the round addresses in it, can be read."""
    if await _can_read(look, link, table, first, count):
        return True
    begin = -(-first // STRIDE) * STRIDE
    for address in range(begin, first + count, STRIDE):
        if await _can_read(look, link, table, address, 1):
            return True
    return False


async def _can_read(
    look: _Look, link: ModbusConnection, table: Table, first: int, count: int
) -> bool:
    """Whether a request is answered with data; the same errors as `_readable` go on."""
    try:
        await look.ask(link, table, first, count)
    except LinkError as error:
        look.heed(error)
        return False
    look.silent_in_a_row = 0
    return True


async def _readable(
    look: _Look, link: ModbusConnection, table: Table, first: int, count: int
) -> list[int]:
    """Return the addresses of a block that can be read."""
    try:
        await look.ask(link, table, first, count)
    except LinkError as error:
        look.heed(error)
        return await _halves(look, link, table, first, count)
    look.silent_in_a_row = 0
    return list(range(first, first + count))


async def _halves(
    look: _Look, link: ModbusConnection, table: Table, first: int, count: int
) -> list[int]:
    if count == 1:
        return []
    half = count // 2
    lower = await _readable(look, link, table, first, half)
    found = lower + await _readable(look, link, table, first + half, count - half)
    if len(found) == count:
        await look.note_too_long(link, table, first, count)
    return found


def _runs(addresses: Sequence[int]) -> list[tuple[int, int]]:
    runs: list[tuple[int, int]] = []
    for address in addresses:
        if runs and runs[-1][1] == address - 1:
            runs[-1] = (runs[-1][0], address)
        else:
            runs.append((address, address))
    return runs
