"""One Modbus connection: requests one at a time, own reconnects, every reply checked.

pymodbus frames and sends; what to do when a device is silent, late or wrong is decided here. After
a time-out or a reply that does not fit, the connection is dropped: whatever still arrives on it can
then never be taken for the answer to a later request. The next request connects again, after a
pause that grows with every failure in a row.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress

from pymodbus.client.base import ModbusBaseClient
from pymodbus.exceptions import ConnectionException, ModbusException, ModbusIOException
from pymodbus.pdu import ModbusPDU

from fieldlink.links.backoff import Backoff
from fieldlink.links.clock import Clock
from fieldlink.links.errors import (
    ExceptionReplyError,
    LinkError,
    LinkTimeoutError,
    LinkUnreachableError,
    ReplyMismatchError,
)
from fieldlink.links.turns import Turns
from fieldlink.registers import Table

__all__ = ["ClientFactory", "ModbusConnection"]

ClientFactory = Callable[[Callable[[bool], None]], ModbusBaseClient]
"""Builds a fresh client; the argument is pymodbus' ``trace_connect``."""

_Send = Callable[[ModbusBaseClient], Awaitable[ModbusPDU]]
_Fits = Callable[[ModbusPDU], bool]


class ModbusConnection:
    """A connection to one device that heals itself.

    Args:
        device: the device's name, for messages.
        where: its address as people write it, for messages.
        unit: the unit id.
        make_client: builds a client with ``retries=0`` and ``reconnect_delay=0``.
        backoff: the pauses between attempts.
        clock: for the pauses.
    """

    def __init__(
        self,
        device: str,
        where: str,
        unit: int,
        make_client: ClientFactory,
        backoff: Backoff,
        clock: Clock,
    ) -> None:
        self._device = device
        self._where = where
        self._unit = unit
        self._make_client = make_client
        self._backoff = backoff
        self._clock = clock
        self._turns = Turns()
        self._client: ModbusBaseClient | None = None
        self._waiting_for_reply = False
        self._last_error = "not tried yet"
        self.requests = 0
        self.connects = 0

    async def read(self, table: Table, address: int, count: int) -> list[int]:
        """Read ``count`` registers or bits (as 0 and 1) of ``table``.

        Raises:
            LinkError: see `fieldlink.links.errors`.
        """

        def send(client: ModbusBaseClient) -> Awaitable[ModbusPDU]:
            method = {
                Table.HOLDING: client.read_holding_registers,
                Table.INPUT: client.read_input_registers,
                Table.COIL: client.read_coils,
                Table.DISCRETE: client.read_discrete_inputs,
            }[table]
            return method(address, count=count, device_id=self._unit)

        def fits(reply: ModbusPDU) -> bool:
            if reply.function_code != table.read_function:
                return False
            if table.is_bits:
                # Bits come in whole bytes.
                return count <= len(reply.bits) < count + 8
            return len(reply.registers) == count

        reply = await self._request(f"reading {_span(table, address, count)}", send, fits)
        if table.is_bits:
            return [int(bit) for bit in reply.bits[:count]]
        return list(reply.registers)

    async def write_many(self, address: int, words: Sequence[int]) -> None:
        """Write holding registers with one FC16; overtakes waiting reads, is never repeated."""
        values = list(words)
        await self._request(
            f"writing {_span(Table.HOLDING, address, len(values))}",
            lambda client: client.write_registers(address, values, device_id=self._unit),
            lambda reply: (
                reply.function_code == 16
                and reply.address == address
                and reply.count == len(values)
            ),
            urgent=True,
        )

    async def write_one(self, address: int, word: int) -> None:
        """Write one holding register with FC6; overtakes waiting reads, is never repeated."""
        await self._request(
            f"writing {_span(Table.HOLDING, address, 1)}",
            lambda client: client.write_register(address, word, device_id=self._unit),
            lambda reply: (
                reply.function_code == 6
                and reply.address == address
                and list(reply.registers) == [word]
            ),
            urgent=True,
        )

    async def close(self) -> None:
        """Drop the connection; a later request would open it again."""
        self._drop()
        await asyncio.sleep(0)

    async def _request(
        self, what: str, send: _Send, fits: _Fits, *, urgent: bool = False
    ) -> ModbusPDU:
        async with self._turns.take(urgent=urgent):
            client = await self._connected()
            self.requests += 1
            self._waiting_for_reply = True
            try:
                reply = await send(client)
            except ConnectionException as error:
                raise self._failed(
                    LinkUnreachableError(
                        self._device,
                        f"{self._where} dropped the connection while {what}",
                        "it is tried again by itself; look at the device if it persists",
                    )
                ) from error
            except ModbusIOException as error:
                raise self._failed(
                    LinkTimeoutError(
                        self._device,
                        f"{self._where} did not answer within "
                        f"{client.comm_params.timeout_connect:g} s while {what}",
                        "check the unit id, or raise the device's timeout",
                    )
                ) from error
            except ModbusException as error:
                raise self._failed(
                    ReplyMismatchError(
                        self._device, f"{what}: {error}", "check the device's protocol"
                    )
                ) from error
            except asyncio.CancelledError:
                # The reply may still come: nobody must find it on this connection.
                self._drop()
                raise
            finally:
                self._waiting_for_reply = False
            # pymodbus lets transaction id 0 pass for any request.
            if reply.transaction_id != client.ctx.request_transaction_id:
                raise self._mismatch(f"{what} got the answer to another request")
            self._backoff.succeeded()
            if reply.isError():
                raise ExceptionReplyError(self._device, what, reply.exception_code)
            if not fits(reply):
                raise self._mismatch(f"{what} got an answer of the wrong kind or length")
            return reply

    async def _connected(self) -> ModbusBaseClient:
        if self._client is not None and self._client.connected:
            return self._client
        self._drop()
        wait = self._backoff.remaining(self._clock.monotonic())
        if wait > 0.0:
            raise LinkUnreachableError(
                self._device,
                f"{self._where}: {self._last_error}",
                f"next attempt in {wait:.1f} s (failures in a row: {self._backoff.failures})",
            )
        client = self._make_client(self._on_connection)
        self._client = client
        try:
            connected = await client.connect()
        except BaseException:
            self._drop()
            raise
        if not connected:
            raise self._failed(
                LinkUnreachableError(
                    self._device,
                    f"no connection to {self._where}",
                    "check that the device is on, its host and port, and the network between",
                )
            )
        self.connects += 1
        return client

    def _mismatch(self, what: str) -> LinkError:
        return self._failed(
            ReplyMismatchError(
                self._device,
                f"{self._where}: {what}",
                "the connection is opened anew; if it persists, look for a second master or a "
                "faulty gateway",
            )
        )

    def _failed(self, error: LinkError) -> LinkError:
        self._last_error = error.what
        self._backoff.failed(self._clock.monotonic())
        self._drop()
        return error

    def _drop(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()

    def _on_connection(self, connected: bool) -> None:
        """Wake a request whose connection is lost; pymodbus would let it run into its time-out."""
        if connected or not self._waiting_for_reply or self._client is None:
            return
        reply = self._client.ctx.response_future
        with suppress(asyncio.InvalidStateError):
            reply.set_exception(ConnectionException("connection lost while waiting for a reply"))


def _span(table: Table, address: int, count: int) -> str:
    if count == 1:
        return f"{table} {address}"
    return f"{table} {address} to {address + count - 1}"
