"""Where a simulated PLC listens: TCP, RTU over TCP, UDP, TLS or a serial port.

The servers are pymodbus'; what differs is stated here. Bytes that make no request are
dropped without an answer, as devices do, and never raise inside the event loop. A TLS stream is cut
into frames by their length, because a record need not hold exactly one.
"""

from __future__ import annotations

import socket
import ssl
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerBase, FramerRTU, FramerSocket, FramerType
from pymodbus.pdu import ModbusPDU
from pymodbus.server import (
    ModbusSerialServer,
    ModbusTcpServer,
    ModbusTlsServer,
    ModbusUdpServer,
)
from pymodbus.server.base import ModbusBaseServer
from pymodbus.simulator import SimDevice

from fieldlink.errors import FieldlinkError
from fieldlink.lab.plc.modbus_device import CHECKED_REQUESTS
from fieldlink.tls_words import tls_words

__all__ = ["LOOPBACK", "Listening", "PortError", "listen"]

LOOPBACK = "127.0.0.1"


class PortError(FieldlinkError):
    """The server cannot listen where the site file says."""


@dataclass(frozen=True, slots=True)
class Listening:
    """Where and how to listen.

    Attributes:
        link: the kind of link that its clients use, such as ``"modbus-tcp"``.
        host: address to bind; the caller decides whether that is loopback.
        port: 0 picks a free one.
        serial_port: of modbus-rtu: the port to open.
        baud, parity, data_bits, stop_bits: of the serial line; parity N, E or O.
        cert, key: of modbus-tls: the server's certificate.
        ca: of modbus-tls: who signs the certificates that clients must show.
    """

    link: str = "modbus-tcp"
    host: str = LOOPBACK
    port: int = 0
    serial_port: str = ""
    baud: int = 19200
    parity: str = "N"
    data_bits: int = 8
    stop_bits: int = 1
    cert: Path | None = None
    key: Path | None = None
    ca: Path | None = None

    @property
    def answers_for_others(self) -> bool:
        """Whether unused unit ids get an exception; on a serial line they are silent."""
        return self.link not in ("modbus-rtu", "modbus-rtu-tcp")

    @property
    def where(self) -> str:
        """The place as people write it."""
        return self.serial_port if self.link == "modbus-rtu" else f"{self.host}:{self.port}"


class _Tolerant:
    """Drops what cannot be decoded, where pymodbus would raise or answer to noise."""

    def handleFrame(  # noqa: N802
        self, data: bytes, exp_devid: int, exp_tid: int
    ) -> tuple[int, ModbusPDU | None]:
        try:
            found: tuple[int, ModbusPDU | None] = super().handleFrame(  # type: ignore[misc]
                data, exp_devid, exp_tid
            )
        except (ModbusException, struct.error, IndexError, ValueError):
            return len(data), None
        return found


class _Mbap(_Tolerant, FramerSocket):
    pass


class _Datagram(_Mbap):
    """Keeps nothing of a datagram: the next one, of whatever client, is a frame of its own."""

    def handleFrame(  # noqa: N802
        self, data: bytes, exp_devid: int, exp_tid: int
    ) -> tuple[int, ModbusPDU | None]:
        _, pdu = super().handleFrame(data, exp_devid, exp_tid)
        return len(data), pdu


class _Rtu(_Tolerant, FramerRTU):
    """Hears every request on the line and lets those to other units pass."""

    units: frozenset[int] = frozenset()

    def handleFrame(  # noqa: N802
        self, data: bytes, exp_devid: int, exp_tid: int
    ) -> tuple[int, ModbusPDU | None]:
        used, pdu = super().handleFrame(data, exp_devid, exp_tid)
        return used, pdu if pdu is not None and pdu.dev_id in self.units else None


def _framer(link: str, devices: list[SimDevice]) -> type[FramerBase]:
    if "rtu" not in link:
        return _Datagram if link == "modbus-udp" else _Mbap
    return type("_RtuOfUnits", (_Rtu,), {"units": frozenset(device.id for device in devices)})


async def listen(devices: list[SimDevice], place: Listening) -> tuple[ModbusBaseServer, int]:
    """Open a Modbus server and return it with the port it got (0 on a serial line).

    Args:
        devices: one device per unit id, each id once.
        place: where to listen.

    Raises:
        PortError: the port is taken, there is none of that name, or the certificates do not serve.
    """
    options: dict[str, Any] = {"custom_pdu": CHECKED_REQUESTS}
    server: ModbusBaseServer
    if place.link == "modbus-rtu":
        server = ModbusSerialServer(
            devices,
            port=place.serial_port,
            baudrate=place.baud,
            parity=place.parity,
            bytesize=place.data_bits,
            stopbits=place.stop_bits,
            ignore_missing_devices=True,
            reconnect_delay=0,
            **options,
        )
    else:
        kind = socket.SOCK_DGRAM if place.link == "modbus-udp" else socket.SOCK_STREAM
        options["address"] = (_bindable(place, kind), place.port)
        if place.link == "modbus-tls":
            server = ModbusTlsServer(
                devices, sslctx=_server_tls(place), framer=FramerType.SOCKET, **options
            )
        elif place.link == "modbus-udp":
            server = ModbusUdpServer(devices, **options)
        elif place.link == "modbus-rtu-tcp":
            server = ModbusTcpServer(
                devices, framer=FramerType.RTU, ignore_missing_devices=True, **options
            )
        else:
            server = ModbusTcpServer(devices, **options)
    server.framer = _framer(place.link, devices)
    try:
        await server.serve_forever(background=True)
    except RuntimeError as error:
        raise PortError(
            f"cannot listen on {place.where}: {error}; check that it is there and no other program "
            "uses it"
        ) from error
    return server, _port_of(server.transport)


def _port_of(transport: Any) -> int:
    if sockets := getattr(transport, "sockets", None):
        return int(sockets[0].getsockname()[1])
    name = transport.get_extra_info("sockname")
    return int(name[1]) if name else 0


def _bindable(place: Listening, kind: socket.SocketKind) -> str:
    """Return the one address to bind, or say why it is not available.

    pymodbus logs the reason and keeps it from its caller. One address, because a name with several
    would get a port of its own for each when the system chooses them.
    """
    try:
        found = socket.getaddrinfo(place.host, place.port, type=kind, flags=socket.AI_PASSIVE)
        family, kind, protocol, _, address = min(found, key=lambda entry: entry[0])
        with socket.socket(family, kind, protocol) as probe:
            if kind is socket.SOCK_STREAM:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            if kind is socket.SOCK_STREAM:
                probe.listen(1)
    except OSError as error:
        raise PortError(
            f"cannot listen on {place.where}: {error.strerror or error}; stop what listens there, "
            "or choose another port in the site file or with --port (0 picks a free one)"
        ) from error
    return str(address[0])


def _server_tls(place: Listening) -> ssl.SSLContext:
    """Return the server's side of Modbus Security: a client without a certificate is refused."""
    if place.cert is None or place.key is None or place.ca is None:
        raise PortError(
            f"{place.where}: a simulated PLC with TLS needs a certificate of its own; "
            "give plc_cert and plc_key in the device's table tls"
        )
    try:
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=place.ca)
        context.load_cert_chain(place.cert, place.key)
    except (OSError, ValueError) as error:
        files = (place.cert, place.key, place.ca)
        raise PortError(
            f"{place.where}: the certificates ({', '.join(map(str, files))}) cannot be "
            f"used: {tls_words(error, files)}; give PEM files that belong together"
        ) from error
    context.verify_mode = ssl.CERT_REQUIRED
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    return context
