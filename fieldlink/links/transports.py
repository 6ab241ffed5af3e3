"""From a device of the site file to the line that its requests travel on."""

from __future__ import annotations

import ssl
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from pymodbus.transport import CommParams, CommType

from fieldlink.file_at import stamp_of_file
from fieldlink.links.errors import LinkUnreachableError
from fieldlink.links.frames import Framing, MbapFraming, RtuFraming
from fieldlink.links.line import LineSettings
from fieldlink.links.wire import Wire
from fieldlink.site import Device, Tls
from fieldlink.site.check_warnings import BITS_PER_BYTE
from fieldlink.site.host import one_name
from fieldlink.tls_words import client_context, tls_words

__all__ = ["TlsFilesError", "client_tls", "line_settings"]

SHORTEST_RTU_GAP = 0.00175
"""Seconds between frames above 19200 baud (Modbus over serial line V1.02, 2.5.1.1)."""

_NETWORK = {
    "modbus-tcp": CommType.TCP,
    "modbus-rtu-tcp": CommType.TCP,
    "modbus-udp": CommType.UDP,
    "modbus-tls": CommType.TLS,
}


class TlsFilesError(LinkUnreachableError):
    """The certificates of a device cannot be used now."""


def line_settings(
    device: Device,
    name: str = "",
    resolve: Callable[[str | Path], Path] = Path,
    *,
    timeout: float | None = None,
) -> LineSettings:
    """Return how the line of a Modbus device is opened and paced.

    Args:
        device: the device.
        name: its name, for messages.
        resolve: turns a path of the site file into one that can be opened.
        timeout: seconds for opening, instead of the device's.

    Certificates are read for the first connection, and again when a file has changed: to make a
    wire raises `TlsFilesError` when they cannot be used.
    """
    seconds = device.timeout if timeout is None else timeout
    quirks = device.quirks
    framing: Framing = RtuFraming() if device.is_rtu else MbapFraming()
    gap, per_byte = quirks.pause_between_requests, 0.0
    if device.link == "modbus-rtu":
        per_byte = BITS_PER_BYTE / device.baud
        gap = max(gap, SHORTEST_RTU_GAP, 3.5 * per_byte)
        params = CommParams(
            comm_type=CommType.SERIAL,
            comm_name=name,
            host=device.serial_port or "",
            baudrate=device.baud,
            bytesize=device.data_bits,
            parity=device.parity[0].upper(),
            stopbits=device.stop_bits,
            timeout_connect=seconds,
        )
    else:
        params = CommParams(
            comm_type=_NETWORK[device.link],
            comm_name=name,
            host=device.host or "",
            port=device.port,
            timeout_connect=seconds,
        )

    tls = None if device.tls is None else _RenewedTls(device.tls, name, resolve)

    def make_wire() -> Wire:
        if tls is None:
            return Wire(params, framing)
        return Wire(replace(params, sslctx=tls.context()), framing, tls.tls.server_name)

    return LineSettings(
        make_wire=make_wire,
        numbered=framing.numbered,
        keeps_open=device.is_rtu or device.link == "modbus-udp" or _medium(device) is not None,
        key=_medium(device),
        place=None if _NETWORK.get(device.link) in (None, CommType.UDP) else _place(device),
        timeout=seconds,
        pause_after_connect=quirks.pause_after_connect,
        gap=gap,
        per_byte=per_byte,
    )


def client_tls(tls: Tls, name: str, resolve: Callable[[str | Path], Path] = Path) -> ssl.SSLContext:
    """Return the client's side of Modbus Security: TLS 1.2 or newer, both sides proved.

    Raises:
        TlsFilesError: a file cannot be read or does not fit.
    """
    given = [path for path in (tls.ca, tls.cert, tls.key) if path is not None]
    files = [resolve(path) for path in given]
    try:
        return client_context(files)
    except (OSError, ValueError) as error:
        named = ", ".join(map(str, given))
        raise TlsFilesError(
            name,
            f"the certificates ({named}) cannot be used: {tls_words(error, files)}",
            "give PEM files that belong together, and a key without a password",
        ) from error


class _RenewedTls:
    """A client's side of TLS, made again for the next connection when a file was replaced.

    Not for every one: to read a bundle of all the world's authorities takes 30 ms.
    """

    def __init__(self, tls: Tls, name: str, resolve: Callable[[str | Path], Path]) -> None:
        self.tls, self._name, self._resolve = tls, name, resolve
        self._made: tuple[list[object], ssl.SSLContext] | None = None

    def context(self) -> ssl.SSLContext:
        """Return it; errors as `client_tls`."""
        given = (self.tls.ca, self.tls.cert, self.tls.key)
        stamps: list[object] = [
            stamp_of_file(self._resolve(path)) for path in given if path is not None
        ]
        if self._made is None or self._made[0] != stamps:
            self._made = None
            self._made = stamps, client_tls(self.tls, self._name, self._resolve)
        return self._made[1]


def _medium(device: Device) -> tuple[object, ...] | None:
    """Return the line that several devices share; None for a device with its own line."""
    if device.link == "modbus-rtu":
        return ("serial", device.serial_port)
    if device.link == "modbus-rtu-tcp":
        return ("gateway", *_place(device))
    if device.link in ("modbus-tcp", "modbus-tls") and device.quirks.close_after_scan:
        return ("connection", *_place(device), device.tls)
    return None


def _place(device: Device) -> tuple[str, int]:
    return (one_name(device.host or ""), device.port)
