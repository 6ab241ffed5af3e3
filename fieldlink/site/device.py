"""``[devices.NAME]``: how a device is reached, what it supports, and what it holds."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from fieldlink.registers import ORDERS
from fieldlink.site.base import Model
from fieldlink.site.host import find_fault_of_host, one_name
from fieldlink.site.opcua import OPCUA_PORT, OpcuaSettings

__all__ = ["Address", "Device", "Model", "Quirks", "Seconds", "Tls"]

Address = Annotated[int, Field(ge=0, le=0xFFFF)]
Seconds = Annotated[float, Field(ge=0.001, le=1e8)]
"""A time of a plant: from a millisecond, below which no scan is, to three years."""
Factor = Annotated[float, Field(ge=0.001, le=1e6)]
"""How many times faster something is."""
Pause = Annotated[float, Field(ge=0, le=60)]

TLS_PORT = 802
"""The port that the Modbus Security specification (MB-TCP-Security v2.1) registers."""

_NEEDS_HOST = ("modbus-tcp", "modbus-rtu-tcp", "modbus-udp", "modbus-tls", "opcua")
_SERIAL_KEYS = ("serial_port", "plc_serial_port", "baud", "parity", "data_bits", "stop_bits")


class Tls(Model):
    """``[devices.NAME.tls]``: certificates of a modbus-tls device (PEM files)."""

    ca: Path
    """Certificates that may have signed the device's own, relative to the site file."""
    cert: Path | None = None
    """Our certificate, which Modbus Security demands of a client."""
    key: Path | None = None
    """Private key of cert, without a password."""
    server_name: str | None = None
    """Name in the device's certificate, where that is not its host."""
    plc_cert: Path | None = None
    """Certificate of the simulated PLC, when it serves the device."""
    plc_key: Path | None = None
    """Private key of plc_cert, without a password."""

    @model_validator(mode="after")
    def _pair(self) -> Self:
        if (self.cert is None) != (self.key is None):
            raise ValueError("cert and key belong together; give both or neither")
        if (self.plc_cert is None) != (self.plc_key is None):
            raise ValueError("plc_cert and plc_key belong together; give both or neither")
        return self


class Quirks(Model):
    """``[devices.NAME.quirks]``: what this device needs done in another way; all off by default."""

    pause_after_connect: Pause = 0.0
    """Seconds between opening the connection and the first request."""
    pause_between_requests: Pause = 0.0
    """Seconds from a reply to the next request."""
    close_after_scan: bool = False
    """Whether the connection is closed after every scan, for devices with too few of them."""
    one_request_per_tag: bool = False
    """Whether every tag is asked for alone; OP and PV are then of different moments."""
    probe_after_timeout: bool = False
    """Whether the first reply after a time-out must prove that it is not a late one; RTU always."""


def _default_port(keys: dict[str, Any]) -> int:
    return {"modbus-tls": TLS_PORT, "opcua": OPCUA_PORT}.get(str(keys.get("link")), 502)


class Device(Model):
    """``[devices.NAME]``: one PLC, simulated plant or recording, and how to reach it."""

    link: Literal[
        "modbus-tcp",
        "modbus-rtu",
        "modbus-rtu-tcp",
        "modbus-udp",
        "modbus-tls",
        "opcua",
        "fmu",
        "recording",
    ]
    """Kind of link: Modbus on a transport, OPC UA, a plant in lockstep, or recorded data."""
    host: str | None = None
    """Host name or address; needed for Modbus over a network and for OPC UA."""
    port: int = Field(default_factory=_default_port, ge=1, le=0xFFFF)
    """TCP or UDP port; 802 unless given for modbus-tls, 4840 for opcua."""
    serial_port: str | None = None
    """Serial port of modbus-rtu, such as /dev/ttyUSB0; devices that share it take turns."""
    plc_serial_port: str | None = None
    """Serial port of the simulated PLC, the other end of serial_port."""
    baud: int = Field(default=19200, ge=50, le=4_000_000)
    """Bits per second of the serial line."""
    parity: Literal["none", "even", "odd"] = "even"
    """Parity of the serial line."""
    data_bits: Literal[8] = 8
    """Data bits of the serial line; RTU has no other number."""
    stop_bits: Literal[1, 2] = 1
    """Stop bits of the serial line; Modbus wants 2 with parity none."""
    unit: int = Field(default=1, ge=0, le=255)
    """Modbus unit id; 1 to 247 on a serial line."""
    word_order: Literal["big", "little"] = "big"
    """Order of the words of a value longer than one register; big is most significant first."""
    byte_order: Literal["big", "little"] = "big"
    """Order of the bytes inside each register of a mapped tag."""
    register_map: Path | None = None
    """CSV file with the tags, relative to the site file; needed unless link = "recording"."""
    timeout: Seconds = 0.5
    """Seconds to wait for an answer, besides what its bytes take on a serial line."""
    retry_after_max: Seconds = 5.0
    """Longest pause in seconds between two attempts to reach a device that does not answer."""
    max_gap: int = Field(default=8, ge=0, le=124)
    """Unused registers read along to join two tags in one request."""
    max_registers: int = Field(default=125, ge=1, le=125)
    """Most registers in one read request."""
    ranges: tuple[tuple[Address, Address], ...] = ()
    """Readable address ranges (first, last), both included; no request crosses their borders."""
    speed: Factor = 1.0
    """Plant seconds per second of the wall clock, for a simulated plant."""
    pace: Literal["clock", "reader", "plant"] = "clock"
    """Who paces a simulated plant that is served: the clock; the clock, but a scan waits until a
    client has read the one before; or the plant as fast as it can."""
    tls: Tls | None = None
    """Certificates; needed for modbus-tls."""
    opcua: OpcuaSettings = OpcuaSettings()
    """How an OPC UA server is asked."""
    quirks: Quirks = Quirks()
    """What this device needs done in another way."""

    @property
    def is_modbus(self) -> bool:
        """Whether the device speaks Modbus, on whatever transport."""
        return self.link.startswith("modbus-")

    @property
    def is_opcua(self) -> bool:
        """Whether the device is an OPC UA server."""
        return self.link == "opcua"

    @property
    def is_stepped(self) -> bool:
        """Whether time goes on only when the device is scanned: a simulation or recordings."""
        return not (self.is_modbus or self.is_opcua)

    @property
    def is_rtu(self) -> bool:
        """Whether requests are framed as on a serial line, without a transaction id."""
        return self.link in ("modbus-rtu", "modbus-rtu-tcp")

    @property
    def where(self) -> str:
        """The device's address as people write it; empty for what has none."""
        if self.is_opcua:
            return f"opc.tcp://{self.host}:{self.port}{self.opcua.path}"
        if self.link == "modbus-rtu":
            serial = f"{self.baud} {self.data_bits}{self.parity[0].upper()}{self.stop_bits}"
            return f"{self.serial_port} ({serial}) unit {self.unit}"
        return f"{self.host}:{self.port} unit {self.unit}" if self.is_modbus else ""

    @property
    def endpoint(self) -> tuple[object, ...]:
        """What two devices of a site share when they are one unit of one PLC."""
        if self.link == "modbus-rtu":
            return (self.serial_port, self.unit)
        host = one_name(self.host or "")
        if self.is_opcua:
            return (host, self.port, self.opcua.path)
        return (host, self.port, self.unit) if self.is_modbus else ()

    @field_validator("word_order", "byte_order", mode="before")
    @classmethod
    def _is_one_order(cls, order: object) -> object:
        """Explain the name that manuals give to both orders, such as CDAB."""
        if isinstance(order, str) and (pair := ORDERS.get(order.upper())) is not None:
            raise ValueError(
                f'{order} names two orders; write word_order = "{pair[0]}" and '
                f'byte_order = "{pair[1]}"'
            )
        return order

    @field_validator("data_bits", mode="before")
    @classmethod
    def _is_rtu_frame(cls, bits: object) -> object:
        if bits == 7:
            raise ValueError(
                "data_bits = 7 is of Modbus ASCII, which is not supported; set the device to RTU, "
                "and data_bits = 8"
            )
        return bits

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.link in _NEEDS_HOST and not self.host:
            raise ValueError(
                f'link = "{self.link}" needs a host; add host = "192.0.2.10" or the like'
            )
        if self.host and (fault := find_fault_of_host(self.host)):
            raise ValueError(fault)
        if self.link == "modbus-rtu":
            if not self.serial_port:
                raise ValueError(
                    'link = "modbus-rtu" needs a serial_port; add serial_port = "/dev/ttyUSB0" or '
                    'the like, or use link = "modbus-rtu-tcp" with the host of a gateway'
                )
        elif given := [key for key in _SERIAL_KEYS if self._differs(key)]:
            raise ValueError(
                f'{given[0]} is of a serial line, link is "{self.link}"; remove it, or use '
                'link = "modbus-rtu"'
            )
        if self.is_rtu and not 1 <= self.unit <= 247:
            raise ValueError(
                f"unit {self.unit} is not valid on a serial line; give the device's own, from 1 to "
                "247"
            )
        if (self.link == "modbus-tls") != (self.tls is not None):
            raise ValueError(
                'link = "modbus-tls" and the table tls belong together; add tls = { ca = "ca.pem", '
                'cert = "client.pem", key = "client.key" } or remove it'
            )
        if not self.is_opcua and self.opcua != OpcuaSettings():
            raise ValueError(
                f'the table opcua is for link = "opcua", this is "{self.link}"; remove it'
            )
        if self.link != "recording" and self.register_map is None:
            raise ValueError(f'link = "{self.link}" needs a register_map; name its CSV file')
        return self

    def _differs(self, key: str) -> bool:
        return bool(getattr(self, key) != type(self).model_fields[key].default)

    @model_validator(mode="after")
    def _ordered_ranges(self) -> Self:
        for first, last in self.ranges:
            if first > last:
                raise ValueError(f"ranges: [{first}, {last}] is the wrong way round; exchange them")
        ordered = sorted(self.ranges)
        for (_, end), (start, _) in pairwise(ordered):
            if start <= end:
                raise ValueError(f"ranges overlap at {start}; merge them")
        return self
