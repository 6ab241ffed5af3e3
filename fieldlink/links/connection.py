"""The connection of one device: requests in turn, own pauses, every reply checked.

`Wire` sends and judges bytes; what to do when a device is silent, late or wrong is decided here.

- Where replies name their transaction (TCP, TLS), a time-out or a reply that does not fit drops the
  wire: whatever still arrives can never be the answer to a later request. On a line that devices
  share, a time-out does not: the late reply is known by its transaction.
- RTU framing has no transaction id, a gateway may deliver a late reply into a new connection, and
  other devices share the line. There the connection remembers which replies are still owed, and
  before the device is asked for anything else it has to answer a probe (see `late_replies`).

A device that has failed is left alone for a while that grows with every failure in a row. Requests
of other devices on the same line go on meanwhile.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from fieldlink.links.backoff import Backoff, describe_next
from fieldlink.links.clock import Clock
from fieldlink.links.errors import (
    ExceptionReplyError,
    LinkError,
    LinkPausedError,
    LinkTimeoutError,
    LinkUnreachableError,
    ReplyMismatchError,
)
from fieldlink.links.frames import (
    Request,
    read_request,
    write_coils_request,
    write_many_request,
    write_one_request,
)
from fieldlink.links.late_replies import LateReplies
from fieldlink.links.line import Line, Lines, LineSettings
from fieldlink.links.misfits import Misfits
from fieldlink.links.wire import (
    Wire,
    WireClosedError,
    WireLostError,
    WireSettingError,
    WireTakenError,
    WrongReplyError,
)
from fieldlink.registers import Table
from fieldlink.tls_words import distrust_remedy, tls_remedy

__all__ = ["ModbusConnection"]

_LINES = Lines()

_PORT_REMEDY = (
    "check serial_port, that its adapter is plugged in, and that this user may open it (as a rule "
    "as a member of the group dialout)"
)


class ModbusConnection:
    """A connection to one unit that heals itself.

    Args:
        device: the device's name, for messages.
        where: its address as people write it, for messages.
        unit: the unit id.
        line: what its requests travel on.
        timeout: seconds to wait for a reply.
        backoff: the pauses between attempts.
        clock: for the pauses.
        probes: whether a time-out is followed by a probe; always so without transaction ids.
    """

    def __init__(
        self,
        device: str,
        where: str,
        unit: int,
        line: LineSettings,
        timeout: float,
        backoff: Backoff,
        clock: Clock,
        *,
        probes: bool = False,
    ) -> None:
        self._device = device
        self._where = where
        self._unit = unit
        self._settings = line
        self._timeout = timeout
        self._backoff = backoff
        self._clock = clock
        self._line: Line | None = None
        self._late = LateReplies() if probes or not line.numbered else None
        self._last_error = "not tried yet"
        self._misfits = Misfits(on_serial_line=line.per_byte > 0.0)
        self._connects_before = 0
        self.requests = 0
        self.late_replies = 0

    @property
    def connects(self) -> int:
        """How often the line was opened."""
        return self._connects_before if self._line is None else self._line.connects

    async def read(self, table: Table, address: int, count: int) -> bytes:
        """Read ``count`` registers (two bytes each) or bits (eight a byte, first in bit 0).

        Raises:
            LinkError: see `fieldlink.links.errors`.
        """
        return (await self._request(read_request(table, address, count)))[2:]

    async def write_many(self, address: int, words: Sequence[int]) -> None:
        """Write holding registers with one FC16; overtakes waiting reads, is never repeated."""
        await self._request(write_many_request(address, words), urgent=True)

    async def write_one(self, address: int, word: int) -> None:
        """Write one holding register with FC6; overtakes waiting reads, is never repeated."""
        await self._request(write_one_request(address, word), urgent=True)

    async def write_coils(self, address: int, bits: Sequence[int]) -> None:
        """Write coils (FC5, FC15); overtakes waiting reads, is never repeated."""
        await self._request(write_coils_request(address, bits), urgent=True)

    async def hang_up(self) -> None:
        """Close the wire unless another device waits for it; the next request opens it again."""
        if self._line is not None:
            turns = self._line.turns
            async with turns.take():
                if not turns.is_wanted:
                    self._line.drop()

    async def close(self) -> None:
        """Let go of the line; a later request would take it up again."""
        line, self._line = self._line, None
        if line is not None:
            # A daemon that has stopped still says how often it connected.
            self._connects_before = line.connects
            line.leave()
        await asyncio.sleep(0)

    async def _request(self, request: Request, *, urgent: bool = False) -> bytes:
        if self._line is None:
            self._line = _LINES.line(self._settings, self._clock)
            self._line.join()
        line = self._line
        await line.turns.acquire(urgent=urgent)
        try:
            self._wait_over()
            try:
                pdu = await self._ask(line, request, again=request.is_read)
            except WireClosedError:
                # A device that closes after each answer; nothing is written twice by this.
                pdu = await self._ask(line, request)
        finally:
            line.turns.release()
        if request.is_exception(pdu):
            raise ExceptionReplyError(
                self._device, request.text, pdu[1], is_write=not request.is_read
            )
        return pdu

    async def _ask(self, line: Line, request: Request, *, again: bool = False) -> bytes:
        """Send a request; with ``again`` a `WireClosedError` is the caller's to deal with."""
        wire = await self._open(line)
        if self._late:
            await self._probe(line, wire, request)
            wire = await self._open(line)
        return await self._exchange(line, wire, request, again=again)

    def _wait_over(self) -> None:
        if not self._backoff.failures:
            return
        wait = self._backoff.remaining(self._clock.monotonic())
        if wait > 0.0:
            named = self._where in self._last_error
            raise LinkPausedError(
                self._device,
                self._last_error if named else f"{self._where}: {self._last_error}",
                describe_next(wait, self._backoff.failures),
            )

    async def _open(self, line: Line) -> Wire:
        try:
            return await line.wire()
        except LinkError as error:
            raise self._failed(error) from error.__cause__
        except WireLostError as error:
            remedy = "check that the device is on, its address, and the cable or network between"
            if line.settings.per_byte:
                remedy = _PORT_REMEDY
            if isinstance(error, WireSettingError):
                serial = "baud rate, parity, data bits and stop bits"
                remedy = f"correct {serial if line.settings.per_byte else 'the host name'}"
            elif isinstance(error, WireTakenError):
                remedy = (
                    "end it; programs that run beside each other need a gateway that speaks Modbus "
                    "TCP, or the device's network port"
                )
            elif of_tls := tls_remedy(
                error.__cause__, "tls.ca", "tls.cert", "host or tls.server_name"
            ):
                remedy = of_tls
            raise self._failed(
                LinkUnreachableError(
                    self._device,
                    f"no connection to {self._where}: {error}",
                    _too_few(line) or remedy,
                )
            ) from error

    async def _exchange(
        self,
        line: Line,
        wire: Wire,
        request: Request,
        *,
        again: bool = False,
        is_probe: bool = False,
    ) -> bytes:
        self.requests += 1
        late = self._late
        patience = self._timeout + line.settings.per_byte * request.bytes_on_line
        try:
            pdu = await wire.exchange(
                self._unit, request, patience, late.recognise if late else None
            )
        except WireLostError as error:
            line.closed(wire)
            self._owe(request)
            if again and isinstance(error, WireClosedError):
                raise
            raise self._failed(
                LinkUnreachableError(
                    self._device,
                    f"{self._where}: {error} while {request.text}",
                    ("" if wire.answers else _too_few(line))
                    or (distrust_remedy("tls.cert") if wire.may_distrust_us else "")
                    or (_PORT_REMEDY if line.settings.per_byte else "")
                    or "it is tried again by itself; look at the device if it persists",
                )
            ) from error
        except TimeoutError as error:
            line.unanswered()
            self._owe(request)
            what = f"{self._where} did not answer within {patience:.3g} s while {request.text}"
            remedy = self._misfits.remedy_of_silence(None if is_probe else request)
            if wire.heard_noise and self._settings.numbered:
                what += "; only a part of a reply came"
                remedy = "raise the device's timeout; if it persists, look for a faulty gateway"
            elif wire.heard_noise:
                what += "; bytes came that are no whole reply"
                remedy = (
                    "check the line's baud rate, parity and stop bits, its cable for noise, or "
                    "raise the device's timeout"
                )
            raise self._failed(LinkTimeoutError(self._device, what, remedy)) from error
        except WrongReplyError as error:
            line.drop()
            self._owe(request)
            raise self._failed(
                ReplyMismatchError(
                    self._device,
                    f"{self._where}: {request.text} got {error}",
                    self._misfits.remedy(error),
                )
            ) from error
        except asyncio.CancelledError:
            # The reply may still come: it must not be taken for another's.
            if not line.settings.keeps_open:
                line.drop()
            self._owe(request)
            raise
        line.answered()
        self._misfits.note_fit(request, pdu)
        self._backoff.succeeded()
        return pdu

    async def _probe(self, line: Line, wire: Wire, request: Request) -> None:
        """Ask for what can only be answered now, and pass over what is still owed."""
        assert self._late is not None
        self._late.forget(self._clock.monotonic())
        if not self._late:
            return
        probe = self._late.probe_for(request)
        pdu = await self._exchange(line, wire, probe, is_probe=True)
        if not self._late.proves(probe, pdu):
            self._late.refused(probe, self._clock.monotonic())
            raise self._failed(
                LinkUnreachableError(
                    self._device,
                    f"{self._where} refused {probe.text}, which was to prove that no late reply "
                    "is on its way",
                    "another probe is tried, and none is needed after a minute",
                )
            )
        self.late_replies += self._late.settled()

    def _owe(self, request: Request) -> None:
        if self._late is not None:
            self._late.owe(request, self._clock.monotonic())

    def _failed(self, error: LinkError) -> LinkError:
        self._last_error = error.what
        self._backoff.failed(self._clock.monotonic())
        return error


def _too_few(line: Line) -> str:
    """Return what to do where other connections to the same address stand; empty without one."""
    others = _LINES.open_beside(line)
    if not others:
        return ""
    stand = "another connection to it stands" if others == 1 else f"{others} others to it stand"
    return (
        f"{stand}, and it may take no more: set close_after_scan in the quirks of all devices at "
        "this address, so that they take turns on one"
    )
