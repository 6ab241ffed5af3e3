"""Runs a read plan: whole blocks while they answer, and around a bad register when one does not.

A block that answers with an exception is cut in halves until the tags that cannot be read are
alone. Those are quarantined and tried again now and then; the rest goes on in requests as large as
the device accepts. A device that does not answer at all ends the scan at once, so that a scan never
costs more than one time-out; the next scan begins behind the request that failed, so that one that
always times out cannot starve the others.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass

from fieldlink.links.base import LinkState, Quality, Reading, Scan
from fieldlink.links.clock import Clock
from fieldlink.links.errors import (
    ExceptionCode,
    ExceptionReplyError,
    LinkError,
    LinkUnreachableError,
)
from fieldlink.registers import Quality as TagQuality
from fieldlink.registers import ReadRequest, Table, Tag

__all__ = ["PlanReader", "ReadBlock"]

ReadBlock = Callable[[Table, int, int], Awaitable[list[int]]]
"""Reads ``count`` addresses of a table from an address on; raises `LinkError`."""

_QUALITY = {quality: Quality[quality.name] for quality in TagQuality}


@dataclass(frozen=True, slots=True)
class _Quarantined:
    tag: Tag
    until: float


@dataclass(frozen=True, slots=True)
class _Piece:
    request: ReadRequest
    words: list[int]


class PlanReader:
    """Reads the requests of a plan, scan after scan.

    Args:
        plan: the requests, as `plan_reads` gives them.
        read: the connection's read.
        clock: stamps the readings.
        retry_after: seconds until a quarantined tag is tried again.
    """

    def __init__(
        self,
        plan: Sequence[ReadRequest],
        read: ReadBlock,
        clock: Clock,
        retry_after: float = 60.0,
    ) -> None:
        self._planned = tuple(plan)
        self._plan = list(plan)
        self._read = read
        self._clock = clock
        self._retry_after = retry_after
        self._quarantine: dict[str, _Quarantined] = {}
        self._requests = 0
        self.state = LinkState.CLOSED

    @property
    def quarantined(self) -> tuple[str, ...]:
        """The tags that are left out for now."""
        return tuple(self._quarantine)

    async def scan(self) -> Scan:
        """Read every tag of the plan once."""
        began, began_utc = self._clock.monotonic(), self._clock.utc()
        before = self._requests
        readings: dict[str, Reading] = {}
        failures: list[LinkError] = []
        try:
            await self._retry_quarantined()
            for request in list(self._plan):
                await self._read_request(request, readings, failures)
        except LinkError as error:
            failures.append(error)
        for request in self._planned:
            for tag in request.tags:
                if tag.name not in readings:
                    quarantined = tag.name in self._quarantine
                    quality = Quality.QUARANTINED if quarantined else Quality.NOT_READ
                    readings[tag.name] = Reading(math.nan, quality, began, began_utc)
        scan = Scan(readings, began, began_utc, self._requests - before, tuple(failures))
        self.state = self._judge(scan)
        return scan

    def _judge(self, scan: Scan) -> LinkState:
        if not scan.answered:
            return LinkState.DEMOTED
        if scan.failures or self._quarantine:
            return LinkState.DEGRADED
        return LinkState.GOOD

    async def _read_request(
        self, request: ReadRequest, readings: dict[str, Reading], failures: list[LinkError]
    ) -> None:
        try:
            try:
                pieces = [_Piece(request, await self._ask(request))]
            except ExceptionReplyError as error:
                if error.code.is_the_gateways:
                    raise
                failures.append(error)
                if not _can_be_split(error):
                    return
                pieces = await self._split(request, error)
        except LinkError:
            self._put_last(request)
            raise
        self._keep(pieces, readings)

    async def _split(self, request: ReadRequest, error: ExceptionReplyError) -> list[_Piece]:
        """Find the readable parts of a refused request and plan with them from now on."""
        bad: list[Tag] = []
        pieces = await self._join(await self._halve(request, error, bad), bad)
        at = self._plan.index(request)
        self._plan[at : at + 1] = [piece.request for piece in pieces]
        until = self._clock.monotonic() + self._retry_after
        self._quarantine.update({tag.name: _Quarantined(tag, until) for tag in bad})
        return pieces

    async def _halve(
        self, request: ReadRequest, error: ExceptionReplyError, bad: list[Tag]
    ) -> list[_Piece]:
        if len(request.tags) == 1 or error.code is ExceptionCode.ILLEGAL_FUNCTION:
            bad.extend(request.tags)
            return []
        middle = len(request.tags) // 2
        pieces = []
        for tags in (request.tags[:middle], request.tags[middle:]):
            half = _request_for(tags)
            try:
                pieces.append(_Piece(half, await self._ask(half)))
            except ExceptionReplyError as inner:
                if not _can_be_split(inner):
                    raise
                pieces.extend(await self._halve(half, inner, bad))
        return pieces

    async def _join(self, pieces: list[_Piece], bad: Sequence[Tag]) -> list[_Piece]:
        """Put neighbours together again that the halving cut apart for no reason of theirs."""
        joined: list[_Piece] = []
        for piece in pieces:
            if joined and not _lies_between(bad, joined[-1].request, piece.request):
                whole = _request_for((*joined[-1].request.tags, *piece.request.tags))
                try:
                    joined[-1] = _Piece(whole, await self._ask(whole))
                except ExceptionReplyError:
                    # What they enclose cannot be read: they stay apart.
                    joined.append(piece)
            else:
                joined.append(piece)
        return joined

    async def _retry_quarantined(self) -> None:
        now = self._clock.monotonic()
        due = [entry for entry in self._quarantine.values() if entry.until <= now]
        for entry in due:
            try:
                await self._ask(_request_for((entry.tag,)))
            except ExceptionReplyError:
                until = now + self._retry_after
                self._quarantine[entry.tag.name] = _Quarantined(entry.tag, until)
            else:
                self._quarantine.clear()
                self._plan = list(self._planned)
                return

    def _put_last(self, request: ReadRequest) -> None:
        at = self._plan.index(request)
        self._plan = [*self._plan[at + 1 :], *self._plan[: at + 1]]

    async def _ask(self, request: ReadRequest) -> list[int]:
        try:
            words = await self._read(request.table, request.address, request.count)
        except LinkUnreachableError:
            # Nothing went out, or nothing came back: no request that a device has seen.
            raise
        except LinkError:
            self._requests += 1
            raise
        self._requests += 1
        return words

    def _keep(self, pieces: Sequence[_Piece], readings: dict[str, Reading]) -> None:
        now, utc = self._clock.monotonic(), self._clock.utc()
        for piece in pieces:
            for tag in piece.request.tags:
                found = tag.decode(piece.request.words_of(tag, piece.words))
                quality = _QUALITY[found.quality]
                value = found.value if quality is Quality.GOOD else math.nan
                readings[tag.name] = Reading(value, quality, now, utc)


def _can_be_split(error: ExceptionReplyError) -> bool:
    return error.code.blames_an_address or error.code is ExceptionCode.ILLEGAL_FUNCTION


def _request_for(tags: Sequence[Tag]) -> ReadRequest:
    ordered = tuple(sorted(tags, key=lambda tag: (tag.address, tag.name)))
    start, end = ordered[0].address, max(tag.end for tag in ordered)
    return ReadRequest(ordered[0].table, start, end - start, ordered)


def _lies_between(bad: Sequence[Tag], left: ReadRequest, right: ReadRequest) -> bool:
    start, end = min(left.address, right.address), max(left.end, right.end)
    return any(tag.address < end and start < tag.end for tag in bad)
