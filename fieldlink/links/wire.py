"""One open transport, and one request at a time on it.

pymodbus' transport layer opens the socket, datagram endpoint, TLS session or serial port; the
transactions are ours, because on a plant network every byte that arrives has to be judged by the
request that is waiting: a reply of another transaction, unit, function or length is refused, a
stray one is never kept for later, and nothing that arrives can raise inside the event loop.
"""

from __future__ import annotations

import asyncio
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from typing import Any

from pymodbus.transport import CommParams, CommType, ModbusProtocol

from fieldlink.links.frames import Frame, Framing, FramingError, Request
from fieldlink.links.names import find_addresses
from fieldlink.links.reasons import TerminalError, reason_of

__all__ = [
    "Wire",
    "WireClosedError",
    "WireLostError",
    "WireSettingError",
    "WireTakenError",
    "WrongReplyError",
]

_TRANSACTIONS = cycle(range(1, 0x10000))
"""Ids go on from one connection to the next: gateways are known to deliver the late reply to a
request of a connection that is gone on the one that took its place."""

Late = Callable[[bytes], bool]
"""Whether a PDU of the right unit is the late reply to an earlier request."""


class WireLostError(Exception):
    """The transport cannot be opened or is gone; the text says why."""


class WireTakenError(WireLostError):
    """Another program has the serial port."""


class WireSettingError(WireLostError):
    """The system or the port does not take a setting, such as a parity."""


class WireClosedError(WireLostError):
    """The other side closed, in order, a connection on which it had answered before."""


class WrongReplyError(Exception):
    """A reply that does not answer the request; the text says why.

    Attributes:
        unit: of which it is an answer, where that is what does not fit.
        transaction: of which it is an answer, where that is what does not fit.
        registers: how many it holds, where that is too few and all else fits.
    """

    unit: int | None = None
    transaction: int | None = None
    registers: int | None = None


@dataclass(frozen=True, slots=True)
class _Waiting:
    request: Request
    unit: int
    transaction: int
    late: Late | None
    reply: asyncio.Future[bytes]


class Wire(ModbusProtocol):
    """A client's end of a transport.

    Args:
        params: what to open; needs a running event loop.
        framing: how PDUs travel on it.
        server_name: name that a TLS server has to prove, where that is not its host.

    Attributes:
        answers: requests that were answered on it.
        heard_noise: whether bytes came since the last request that belong to no whole frame.
    """

    def __init__(
        self, params: CommParams, framing: Framing, server_name: str | None = None
    ) -> None:
        super().__init__(params, False)
        self._server_name = server_name or params.host
        self._framing = framing
        self._datagrams = params.comm_type is CommType.UDP
        self._buffer = b""
        self._waiting: _Waiting | None = None
        self._unanswered: set[int] = set()
        self._gone = asyncio.Event()
        self._lost: Exception | None = None
        self.answers = 0
        self.heard_noise = False

    @property
    def is_open(self) -> bool:
        """Whether requests can be sent."""
        return self.transport is not None and not self.is_closing

    @property
    def may_distrust_us(self) -> bool:
        """Whether the other side may refuse our certificate: TLS 1.3 tells after the handshake."""
        return self.comm_params.sslctx is not None and not self.answers

    async def open(self, within: float) -> None:
        """Open the transport ``within`` seconds.

        Raises:
            WireLostError: it cannot be opened.
        """
        self.is_closing = False
        try:
            if self.comm_params.comm_type is CommType.SERIAL:
                self.transport, _ = await asyncio.wait_for(self.call_create(), within)
            else:
                await self._connect(within)
        except TimeoutError as error:
            raise WireLostError(f"no connection within {within:g} s") from error
        except (OSError, ValueError, TerminalError) as error:
            # A serial port may be open by now, in a frame of the error: locked for who comes next.
            traceback.clear_frames(error.__traceback__)
            if isinstance(error, OSError):
                taken = "exclusively lock" in str(error)
                raise (WireTakenError if taken else WireLostError)(reason_of(error)) from error
            # ValueError: a host name or a serial setting that the system does not take.
            # A terminal error: a setting that the serial port itself refuses, such as a parity.
            raise WireSettingError(reason_of(error)) from error
        if self.transport.is_closing():
            # Lost before it was ours: nobody would wake a request on it. The reason comes later.
            with suppress(TimeoutError):
                await asyncio.wait_for(self._gone.wait(), within)
            reason = f" ({reason_of(self._lost)})" if self._lost is not None else ""
            raise WireLostError(
                f"the other side closed the connection at once{reason}"
            ) from self._lost

    async def _connect(self, within: float) -> None:
        """Connect to the first address that takes it; each has its share of the time left."""
        host, until = self.comm_params.host, self.loop.time() + within
        try:
            addresses = await asyncio.wait_for(find_addresses(host), within)
        except TimeoutError as error:
            raise WireLostError(f"no name server answered within {within:g} s") from error
        for left, address in zip(range(len(addresses), 0, -1), addresses, strict=True):
            self.init_setup_connect_listen(address, self.comm_params.port)
            create: Callable[..., Any] = self.call_create
            if self.comm_params.sslctx is not None:
                create = partial(create, server_hostname=self._server_name)
            try:
                share = (until - self.loop.time()) / left
                self.transport, _ = await asyncio.wait_for(create(), share)
            except OSError:  # a time-out is one
                if left == 1:
                    raise
            else:
                return

    def close(self, reconnect: bool = False) -> None:
        """Close the transport at once; it is not opened again by itself."""
        transport = self.transport
        super().close(reconnect)
        if self.comm_params.sslctx is not None and transport is not None:
            # Our farewell is sent; waiting for the other side's would outlive a short event loop.
            transport.abort()  # type: ignore[attr-defined]

    async def exchange(
        self, unit: int, request: Request, within: float, late: Late | None = None
    ) -> bytes:
        """Send one request and return the PDU of its answer, regular or exception.

        Args:
            unit: the unit id.
            request: what to ask.
            within: seconds to wait.
            late: recognises late replies to other requests, which are passed over.

        Raises:
            TimeoutError: no answer in time.
            WireClosedError: the other side closed a connection on which it had answered before.
            WireLostError: the transport was lost meanwhile.
            WrongReplyError: what came is not an answer to this request.
        """
        if not self.is_open:
            raise WireLostError("the connection is closed")
        transaction = next(_TRANSACTIONS)
        reply: asyncio.Future[bytes] = self.loop.create_future()
        self._waiting = _Waiting(request, unit, transaction, late, reply)
        timer = self.loop.call_later(within, self._fail, TimeoutError())
        try:
            self._buffer = b""
            self.heard_noise = False
            self._send(self._framing.encode(unit, transaction, request.pdu))
            answer = await reply
            self.answers += 1
            return answer
        except (TimeoutError, asyncio.CancelledError):
            self._unanswered.add(transaction)
            if self._buffer and self._framing.numbered and not self._datagrams:
                # The rest of a frame would be taken for the beginning of the next one.
                self.close()
            raise
        finally:
            timer.cancel()
            self._waiting = None

    def callback_new_connection(self) -> ModbusProtocol:
        """Part of pymodbus' transport: of servers only."""
        raise NotImplementedError("a wire is a client's end")

    def callback_connected(self) -> None:
        """Part of pymodbus' transport: nothing to do."""

    def callback_disconnected(self, exc: Exception | None) -> None:
        """Part of pymodbus' transport: wake a request whose connection is lost."""
        if self.answers and (exc is None or isinstance(exc, BrokenPipeError)):
            self._fail(WireClosedError("the connection was closed after the last answer"))
            return
        self._lost = exc
        self._gone.set()
        reason = f" ({reason_of(exc)})" if exc is not None else ""
        self._fail(WireLostError(f"the connection was dropped{reason}"))

    def error_received(self, exc: Exception) -> None:
        """Part of pymodbus' transport: a datagram came back as undeliverable."""
        self._fail(WireLostError(reason_of(exc)))

    def data_received(self, data: bytes) -> None:
        """Called by the event loop: judge what has arrived, keep the beginning of a frame."""
        self._buffer += data
        self.heard_noise = True
        while self._waiting is not None and not self._waiting.reply.done():
            try:
                used, frame = self._framing.decode(self._buffer)
            except FramingError as error:
                # A datagram that is no frame may come from anywhere: the reply comes in another.
                if not self._datagrams:
                    self._fail(WrongReplyError(str(error)))
                break
            self._buffer = self._buffer[used:]
            if frame is None:
                return
            self.heard_noise = bool(self._buffer)
            self._judge(self._waiting, frame)
        # No task waits for what is left.
        self._buffer = b""

    def datagram_received(self, data: bytes, addr: tuple[Any, ...] | None) -> None:  # noqa: ARG002
        """Called by the event loop: a datagram is a whole frame, or it is none."""
        self._buffer = b""
        self.data_received(data)
        self._buffer = b""

    def callback_data(self, data: bytes, addr: tuple[Any, ...] | None = None) -> int:  # noqa: ARG002
        """Part of pymodbus' transport, which `data_received` goes past."""
        return len(data)

    def _send(self, frame: bytes) -> None:
        if self._datagrams:
            self.transport.sendto(frame)  # type: ignore[attr-defined]
        else:
            self.transport.write(frame)  # type: ignore[attr-defined]

    def _judge(self, waiting: _Waiting, frame: Frame) -> None:
        if self._framing.numbered and frame.transaction != waiting.transaction:
            # A late answer is harmless; by any other one, the two ends of a stream have lost count.
            is_late = frame.transaction in self._unanswered
            self._unanswered.discard(frame.transaction)
            if not (self._datagrams or is_late):
                error = WrongReplyError("the answer to another request")
                error.transaction = frame.transaction
                self._fail(error)
        elif frame.unit != waiting.unit and waiting.unit != 0:
            # On a shared line it is the late answer of another unit.
            if self._framing.numbered:
                error = WrongReplyError(f"an answer of unit {frame.unit}, not {waiting.unit}")
                error.unit = frame.unit
                self._fail(error)
        elif waiting.request.is_regular(frame.pdu) or waiting.request.is_exception(frame.pdu):
            waiting.reply.set_result(frame.pdu)
        elif waiting.late is None or not waiting.late(frame.pdu):
            self._fail(_misfit(waiting.request, frame.pdu))

    def _fail(self, error: Exception) -> None:
        if self._waiting is not None:
            with suppress(asyncio.InvalidStateError):
                self._waiting.reply.set_exception(error)


def _misfit(request: Request, pdu: bytes) -> WrongReplyError:
    held = request.registers_of(pdu)
    if not 0 < held < request.count:
        return WrongReplyError("an answer of the wrong kind or length")
    error = WrongReplyError(f"{held} of {request.count} registers")
    error.registers = held
    return error
