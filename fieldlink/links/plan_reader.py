"""Runs a read plan: whole blocks while they answer, and around a bad register when one does not.

A block that answers with an exception is cut in halves until the tags that cannot be read are
alone. Those are left out and tried again now and then (`quarantine`); the rest goes on in requests
as large as the device accepts, and now and then larger ones are tried again: what is refused for a
moment must not part the OP and PV of a loop for good. A device that does not answer at all ends the
scan at once, so that a scan never costs more than one time-out; the next scan begins behind the
request that failed, so that one that always times out cannot starve the others.

A request of tags with a rate of their own (``every``) is sent when it is due; between, its tags
keep the last reading, with the time at which that arrived, until it is two intervals old. A request
of loops with a longer period than others (``polls``) is sent once in so many beats, and its tags
have no reading between: a window is never given an old value for a new one.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass

from fieldlink.links.backoff import Backoff, BackoffSettings
from fieldlink.links.base import LinkState, Quality, Reading, Scan
from fieldlink.links.clock import Clock
from fieldlink.links.errors import (
    ExceptionCode,
    ExceptionReplyError,
    LinkError,
    LinkUnreachableError,
)
from fieldlink.links.quarantine import FIRST_PAUSE, Quarantine
from fieldlink.registers import BlockDecoder, ReadRequest, Table, Tag, ValueQuality

__all__ = ["PlanReader", "ReadBlock"]

ReadBlock = Callable[[Table, int, int], Awaitable[bytes]]
"""Reads ``count`` addresses of a table from an address on, as on the wire; raises `LinkError`."""

EARLY = 0.1
"""The share of an interval by which a request may be early: scans jitter."""

KEPT_DECODERS = 1000

_QUALITY = {quality: Quality[quality.name] for quality in ValueQuality}


@dataclass(frozen=True, slots=True)
class _Piece:
    request: ReadRequest
    payload: bytes


class PlanReader:
    """Reads the requests of a plan, scan after scan.

    Args:
        plan: the requests, as `plan_reads` gives them.
        read: the connection's read.
        clock: stamps the readings.
        retry_after: longest seconds until a quarantined tag is tried again.
        beat: seconds between two scans, which time slower requests; 0 sends all in every scan.
    """

    def __init__(
        self,
        plan: Sequence[ReadRequest],
        read: ReadBlock,
        clock: Clock,
        retry_after: float = 60.0,
        beat: float = 0.0,
    ) -> None:
        self._planned = tuple(plan)
        self._tags = sum(len(request.tags) for request in self._planned)
        self._plan = list(plan)
        self._read = read
        self._clock = clock
        self._beat = beat
        self._began_first: float | None = None
        self._polls = {
            tag.name: request.polls
            for request in self._planned
            for tag in request.tags
            if beat and request.polls > 1
        }
        self._period_of: dict[str, int] = {}
        self._quarantine = Quarantine(plan, retry_after)
        pause = max(0.001, retry_after)
        self._apart = Backoff(BackoffSettings(min(FIRST_PAUSE, pause), pause, jitter=0.0))
        self._decoders: dict[int, BlockDecoder] = {}
        self._slow: dict[str, Reading] = {}
        self._due: dict[str, float] = {}
        self._requests = 0
        self.state = LinkState.CLOSED

    @property
    def quarantined(self) -> tuple[str, ...]:
        """The tags that are left out for now."""
        return self._quarantine.names

    async def scan(self) -> Scan:
        """Read every tag of the plan once."""
        began, began_utc = self._clock.monotonic(), self._clock.utc()
        before = self._requests
        readings: dict[str, Reading] = {}
        failures: list[LinkError] = []
        resting: set[str] = set()
        asked = False
        beat = self._beat_at(began)
        try:
            await self._retry_quarantined()
            await self._retry_apart()
            for request in list(self._plan):
                if self._is_due(request, began, beat):
                    asked = True
                    await self._read_request(request, readings, failures)
                    if any(tag.name in readings for tag in request.tags):
                        self._note_period(request, beat)
                elif request.tags[0].name in self._polls:
                    resting.update(tag.name for tag in request.tags)
        except LinkError as error:
            failures.append(error)
        if len(readings) < self._tags:
            self._fill(readings, resting, began, began_utc)
        scan = Scan(readings, began, began_utc, self._requests - before, tuple(failures))
        if asked or failures:
            # A scan without a request shows nothing of the device.
            self.state = self._judge(scan)
        return scan

    def _beat_at(self, now: float) -> int:
        """Count the beats since the first scan; half a beat of jitter is no matter."""
        if not self._polls:
            return 0
        if self._began_first is None:
            self._began_first = now
        return round((now - self._began_first) / self._beat)

    def _is_due(self, request: ReadRequest, now: float, beat: int) -> bool:
        name = request.tags[0].name
        if request.every:
            return now >= self._due.get(name, now)
        polls = self._polls.get(name, 1)
        return polls == 1 or self._period_of.get(name) != beat // polls

    def _note_period(self, request: ReadRequest, beat: int) -> None:
        """Note that the loops of a request have been served in their present period."""
        polls = self._polls.get(request.tags[0].name, 1)
        if polls > 1:
            self._period_of.update({tag.name: beat // polls for tag in request.tags})

    def _note_slow(self, request: ReadRequest, readings: dict[str, Reading]) -> None:
        """Keep the readings of tags with a rate of their own, and say when they are due again."""
        for tag in request.tags:
            reading = self._slow[tag.name] = readings[tag.name]
            self._due[tag.name] = reading.monotonic + (1.0 - EARLY) * tag.every

    def _fill(
        self, readings: dict[str, Reading], resting: set[str], began: float, began_utc: float
    ) -> None:
        """Give a reading to every tag that this scan brought none for."""
        for request in self._planned:
            for tag in request.tags:
                if tag.name in readings:
                    continue
                kept = self._slow.get(tag.name)
                if kept is not None and kept.age(began) <= 2.0 * tag.every:
                    readings[tag.name] = kept
                    continue
                quality = Quality.NOT_READ
                if tag.name in self._quarantine:
                    quality = Quality.QUARANTINED
                elif tag.name in resting:
                    quality = Quality.NOT_DUE
                readings[tag.name] = Reading(math.nan, quality, began, began_utc)

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
        now = self._clock.monotonic()
        self._quarantine.refuse(bad, now)
        if len(pieces) > 1:
            self._apart.succeeded()
            self._apart.failed(now)
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
        for trial in self._quarantine.trials(now):
            try:
                await self._ask(_request_for((trial.tag,)))
            except ExceptionReplyError:
                self._quarantine.refuse(trial.stands_for, now)
            else:
                self._quarantine.clear()
                self._plan = list(self._planned)
                return

    async def _retry_apart(self) -> None:
        """Try whether the pieces of a planned request are answered together again."""
        now = self._clock.monotonic()
        if not self._apart.failures or self._apart.remaining(now):
            return
        self._apart.failed(now)
        parted = False
        for planned in self._planned:
            bad = [tag for tag in planned.tags if tag.name in self._quarantine]
            parts = [part for part in self._plan if part.tags[0] in planned.tags]
            pieces = [_Piece(part, b"") for part in sorted(parts, key=lambda part: part.address)]
            joined = [piece.request for piece in await self._join(pieces, bad)]
            if len(joined) < len(parts):
                at = self._plan.index(parts[0])
                rest = [request for request in self._plan if request not in parts]
                self._plan = [*rest[:at], *joined, *rest[at:]]
            parted = parted or len(joined) > 1
        if not parted:
            self._apart.succeeded()

    def _put_last(self, request: ReadRequest) -> None:
        at = self._plan.index(request)
        self._plan = [*self._plan[at + 1 :], *self._plan[: at + 1]]

    async def _ask(self, request: ReadRequest) -> bytes:
        try:
            payload = await self._read(request.table, request.address, request.count)
        except LinkUnreachableError:
            # Nothing went out, or nothing came back: no request that a device has seen.
            raise
        except LinkError:
            self._requests += 1
            raise
        self._requests += 1
        return payload

    def _keep(self, pieces: Sequence[_Piece], readings: dict[str, Reading]) -> None:
        now, utc = self._clock.monotonic(), self._clock.utc()
        # Names of the module looked up once: this loop is most of what a scan costs.
        reading, nan, good, found_good = Reading, math.nan, Quality.GOOD, ValueQuality.GOOD
        for piece in pieces:
            for name, value, found, text in self._decoder(piece.request).decode(piece.payload):
                if found is found_good:
                    readings[name] = reading(value, good, now, utc, text)
                else:
                    readings[name] = reading(nan, _QUALITY[found], now, utc, text)
            if piece.request.every:
                self._note_slow(piece.request, readings)

    def _decoder(self, request: ReadRequest) -> BlockDecoder:
        # By identity, as hashing a request means hashing its tags; a decoder keeps its request.
        decoder = self._decoders.get(id(request))
        if decoder is None:
            if len(self._decoders) > KEPT_DECODERS:
                self._decoders.clear()
            decoder = self._decoders[id(request)] = BlockDecoder(request)
        return decoder


def _can_be_split(error: ExceptionReplyError) -> bool:
    return error.code.blames_an_address or error.code is ExceptionCode.ILLEGAL_FUNCTION


def _request_for(tags: Sequence[Tag]) -> ReadRequest:
    ordered = tuple(sorted(tags, key=lambda tag: (tag.address, tag.name)))
    start, end = ordered[0].address, max(tag.end for tag in ordered)
    return ReadRequest(ordered[0].table, start, end - start, ordered, ordered[0].every)


def _lies_between(bad: Sequence[Tag], left: ReadRequest, right: ReadRequest) -> bool:
    start, end = min(left.address, right.address), max(left.end, right.end)
    return any(tag.address < end and start < tag.end for tag in bad)
