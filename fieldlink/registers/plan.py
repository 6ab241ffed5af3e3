"""The read plan: which requests fetch a device's tags.

Tags of one table that lie close together share a request: a gap of at most ``max_gap`` unused
addresses is read along, a request asks for at most ``max_registers`` (and never more than the
protocol allows), and it never crosses the border of a declared readable range.

Tags that must be samples of the same instant (a loop's OP and PV) form a group in ``together``. A
group is planned as one piece, whatever the gap inside it, so that it shares a request whenever any
request could hold it. `find_apart` names the groups that cannot, with the reason. Two requests may
overlap in addresses for that; each tag still belongs to exactly one of them.

Tags that are read at different rates (``every``, ``polls``) never share a request, and for a device
that can answer for one tag at a time (``one_tag``) every tag has a request of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

from fieldlink.errors import FieldlinkError
from fieldlink.registers.tag import Tag
from fieldlink.registers.types import Table

__all__ = ["Apart", "ApartReason", "PlanError", "ReadRequest", "find_apart", "plan_reads"]

Range = tuple[int, int]
"""First and last readable address, both included."""


class PlanError(FieldlinkError, ValueError):
    """Tags that no request within the limits could read."""


@dataclass(frozen=True, slots=True)
class ReadRequest:
    """One Modbus read: ``count`` addresses of ``table`` from ``address`` on, for ``tags``.

    ``every`` is the number of seconds between two of them; 0 sends it in every scan. With
    ``polls`` of 3 it is in every third scan only: its loops have longer periods than others of the
    device.
    """

    table: Table
    address: int
    count: int
    tags: tuple[Tag, ...]
    every: float = 0.0
    polls: int = 1

    @property
    def end(self) -> int:
        """The first address after the request."""
        return self.address + self.count

    def words_of(self, tag: Tag, words: Sequence[int]) -> Sequence[int]:
        """Return the part of the answer ``words`` (length ``count``) that belongs to ``tag``."""
        start = tag.address - self.address
        return words[start : start + tag.count]


class ApartReason(Enum):
    """Why the tags of a group are not in one request; the value is text with advice."""

    TABLES = "they are in different tables; map copies of them into one table of the PLC"
    RANGES = "they are in different declared ranges; move them into one range of the PLC"
    TOO_FAR = (
        "they are further apart than one request may reach; "
        "move them closer in the PLC or raise max_registers"
    )
    RATES = "they are read at different rates; give them the same `every` in the register map"
    ONE_TAG = "the device answers for one tag a request (one_request_per_tag)"
    CROWDED = (
        "a tag they share with another group needs a request that leaves no room; "
        "move the tags closer in the PLC or raise max_registers"
    )


@dataclass(frozen=True, slots=True)
class Apart:
    """A group whose tags could not share a request."""

    tags: tuple[str, ...]
    reason: ApartReason


@dataclass(frozen=True, slots=True)
class _Limits:
    max_gap: int
    max_registers: int
    ranges: tuple[Range, ...]
    one_tag: bool = False
    polls: Mapping[str, int] = field(default_factory=dict)

    def rate(self, tag: Tag) -> tuple[float, int]:
        """How often a tag is read: seconds between two readings, and in every how many scans."""
        return tag.every, 1 if tag.every else self.polls.get(tag.name, 1)

    def most(self, table: Table) -> int:
        return table.read_limit if table.is_bits else min(self.max_registers, table.read_limit)

    def range_of(self, start: int, end: int) -> Range | None:
        """Return the declared range that holds ``start`` to ``end``, if any."""
        if not self.ranges:
            return (0, 0xFFFF)
        for first, last in self.ranges:
            if first <= start and end <= last + 1:
                return (first, last)
        return None

    def allow(self, piece: Sequence[Tag]) -> bool:
        """Whether one request may read all of ``piece``."""
        table = piece[0].table
        rate = self.rate(piece[0])
        alike = all(tag.table is table and self.rate(tag) == rate for tag in piece)
        alone = len(piece) == 1 or not self.one_tag
        return alike and alone and self.allow_span(table, _start(piece), _end(piece))

    def allow_span(self, table: Table, start: int, end: int) -> bool:
        """Whether one request may read from ``start`` up to, not including, ``end``."""
        return end - start <= self.most(table) and self.range_of(start, end) is not None


@dataclass(slots=True)
class _Span:
    """A request that still grows."""

    table: Table
    start: int
    end: int
    tags: list[Tag]
    rate: tuple[float, int]

    def take(self, later: _Span, limits: _Limits) -> bool:
        """Take in a span that begins here or further on, if one request may read both."""
        end = max(self.end, later.end)
        if (
            limits.one_tag
            or later.table is not self.table
            or later.rate != self.rate
            or later.start - self.end > limits.max_gap
            or not limits.allow_span(self.table, self.start, end)
        ):
            return False
        self.end = end
        self.tags.extend(later.tags)
        return True

    def request(self) -> ReadRequest:
        ordered = tuple(sorted(self.tags, key=lambda tag: (tag.address, tag.name)))
        return ReadRequest(self.table, self.start, self.end - self.start, ordered, *self.rate)


def plan_reads(
    tags: Iterable[Tag],
    max_gap: int = 8,
    max_registers: int = 125,
    ranges: Sequence[Range] = (),
    *,
    together: Sequence[Sequence[str]] = (),
    one_tag: bool = False,
    polls: Mapping[str, int] | None = None,
) -> tuple[ReadRequest, ...]:
    """Return the requests that read every one of ``tags`` once, ordered by table and address.

    Args:
        tags: the tags of one device; names are unique.
        max_gap: the most unused addresses read along between two tags.
        max_registers: the most registers in one request, 1 to 125; coils and discrete inputs have
            the protocol's own limit of 2000 bits.
        ranges: declared readable ranges (first, last), both included; empty means everything.
        together: groups of tag names that are to share a request.
        one_tag: give every tag a request of its own.
        polls: in every how many scans a tag is read, by name; 1 unless given.

    Raises:
        PlanError: a tag is longer than a request, lies outside the ranges or crosses one's border,
            or a group names a tag that is not there.
    """
    limits = _Limits(max_gap, max_registers, tuple(ranges), one_tag, polls or {})
    all_tags = list(tags)
    for tag in all_tags:
        if not limits.allow([tag]):
            raise PlanError(_why_unreadable(tag, limits))
    pieces = _pieces(all_tags, together, limits)
    order = list(Table)
    pieces.sort(
        key=lambda piece: (
            order.index(piece[0].table),
            limits.rate(piece[0]),
            _start(piece),
            _end(piece),
        )
    )
    spans: list[_Span] = []
    for piece in pieces:
        span = _Span(piece[0].table, _start(piece), _end(piece), list(piece), limits.rate(piece[0]))
        if not (spans and spans[-1].take(span, limits)):
            spans.append(span)
    return tuple(span.request() for span in spans)


def find_apart(
    requests: Sequence[ReadRequest],
    together: Sequence[Sequence[str]],
    max_registers: int = 125,
    ranges: Sequence[Range] = (),
    *,
    one_tag: bool = False,
) -> tuple[Apart, ...]:
    """Return the groups of ``together`` that are not in one of ``requests``, and why."""
    limits = _Limits(0, max_registers, tuple(ranges), one_tag)
    place = {tag.name: number for number, found in enumerate(requests) for tag in found.tags}
    by_name = {tag.name: tag for found in requests for tag in found.tags}
    result = []
    for group in together:
        if len({place[name] for name in group}) > 1:
            reason = _why_apart([by_name[name] for name in group], limits)
            result.append(Apart(tuple(group), reason))
    return tuple(result)


def _pieces(
    tags: list[Tag], together: Sequence[Sequence[str]], limits: _Limits
) -> list[tuple[Tag, ...]]:
    """Return what stays whole: groups where a request can hold them, else single tags."""
    piece_of: dict[str, tuple[Tag, ...]] = {tag.name: (tag,) for tag in tags}
    for group in together:
        missing = [name for name in group if name not in piece_of]
        if missing:
            raise PlanError(f"no tag of that name to keep together: {', '.join(missing)}")
        merged = {tag.name: tag for name in group for tag in piece_of[name]}
        candidate = tuple(merged.values())
        if candidate and limits.allow(candidate):
            for name in merged:
                piece_of[name] = candidate
    seen: set[str] = set()
    pieces = []
    for tag in tags:
        if tag.name not in seen:
            pieces.append(piece_of[tag.name])
            seen.update(member.name for member in piece_of[tag.name])
    return pieces


def _why_unreadable(tag: Tag, limits: _Limits) -> str:
    where = f"{tag.name}: {tag.table} {tag.address} to {tag.end - 1}"
    if tag.count > limits.most(tag.table):
        return f"{where} is longer than max_registers = {limits.most(tag.table)}; raise it"
    return f"{where} is not inside one of the declared ranges {list(limits.ranges)}; extend them"


def _why_apart(group: Sequence[Tag], limits: _Limits) -> ApartReason:
    if len({tag.table for tag in group}) > 1:
        return ApartReason.TABLES
    if limits.one_tag:
        return ApartReason.ONE_TAG
    if len({tag.every for tag in group}) > 1:
        return ApartReason.RATES
    start, end = _start(group), _end(group)
    if end - start > limits.most(group[0].table):
        return ApartReason.TOO_FAR
    if limits.range_of(start, end) is None:
        return ApartReason.RANGES
    return ApartReason.CROWDED


def _start(tags: Sequence[Tag]) -> int:
    return min(tag.address for tag in tags)


def _end(tags: Sequence[Tag]) -> int:
    return max(tag.end for tag in tags)
