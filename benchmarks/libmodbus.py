"""libmodbus through its C interface: the peer of the interoperability tests and the link benchmark.

python -m benchmarks.libmodbus tcp            # a server; prints its port
python -m benchmarks.libmodbus rtu PORT UNIT  # a server on a serial port; prints "ready"
"""

from __future__ import annotations

import argparse
import ctypes
import ctypes.util
import socket
from collections.abc import Sequence

__all__ = ["LibModbus", "LibModbusMissingError", "library", "serve"]

HOST = "127.0.0.1"
REGISTERS = 1000
LONGEST_ADU = 260


class LibModbusMissingError(Exception):
    """libmodbus is not installed."""


class _Mapping(ctypes.Structure):
    """``modbus_mapping_t`` of modbus.h."""

    _fields_ = (
        ("nb_bits", ctypes.c_int),
        ("start_bits", ctypes.c_int),
        ("nb_input_bits", ctypes.c_int),
        ("start_input_bits", ctypes.c_int),
        ("nb_input_registers", ctypes.c_int),
        ("start_input_registers", ctypes.c_int),
        ("nb_registers", ctypes.c_int),
        ("start_registers", ctypes.c_int),
        ("tab_bits", ctypes.POINTER(ctypes.c_uint8)),
        ("tab_input_bits", ctypes.POINTER(ctypes.c_uint8)),
        ("tab_input_registers", ctypes.POINTER(ctypes.c_uint16)),
        ("tab_registers", ctypes.POINTER(ctypes.c_uint16)),
    )


def library() -> ctypes.CDLL:
    """Load libmodbus.

    Raises:
        LibModbusMissingError: it is not installed.
    """
    name = ctypes.util.find_library("modbus")
    if name is None:
        raise LibModbusMissingError("libmodbus is not installed (Debian package libmodbus5)")
    lib = ctypes.CDLL(name, use_errno=True)
    lib.modbus_new_tcp.restype = ctypes.c_void_p
    lib.modbus_new_rtu.restype = ctypes.c_void_p
    lib.modbus_mapping_new.restype = ctypes.POINTER(_Mapping)
    lib.modbus_get_float_abcd.restype = ctypes.c_float
    lib.modbus_strerror.restype = ctypes.c_char_p
    return lib


class LibModbus:
    """A client; every call blocks and raises OSError with libmodbus' words.

    Args:
        port: TCP port on loopback, or the path of a serial port.
        unit: the unit id.
        baud: of a serial port.
    """

    def __init__(self, port: int | str, unit: int = 1, baud: int = 19200) -> None:
        self._library = library()
        if isinstance(port, int):
            context = self._library.modbus_new_tcp(HOST.encode(), port)
        else:
            context = self._library.modbus_new_rtu(port.encode(), baud, ctypes.c_char(b"N"), 8, 1)
        self._context = ctypes.c_void_p(context)
        self._library.modbus_set_slave(self._context, unit)
        self._library.modbus_set_response_timeout(self._context, 5, 0)
        self._check(self._library.modbus_connect(self._context))

    def read(self, address: int, count: int) -> list[int]:
        """Read holding registers."""
        words = (ctypes.c_uint16 * count)()
        self._check(self._library.modbus_read_registers(self._context, address, count, words))
        return list(words)

    def read_inputs(self, address: int, count: int) -> list[int]:
        """Read input registers."""
        words = (ctypes.c_uint16 * count)()
        self._check(self._library.modbus_read_input_registers(self._context, address, count, words))
        return list(words)

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write holding registers."""
        values = (ctypes.c_uint16 * len(words))(*words)
        self._check(
            self._library.modbus_write_registers(self._context, address, len(words), values)
        )

    def real(self, words: Sequence[int]) -> float:
        """Decode a float with libmodbus' own function."""
        return float(self._library.modbus_get_float_abcd((ctypes.c_uint16 * 2)(*words)))

    def close(self) -> None:
        """Close the connection."""
        self._library.modbus_close(self._context)
        self._library.modbus_free(self._context)

    def _check(self, result: int) -> None:
        if result < 0:
            raise OSError(self._library.modbus_strerror(ctypes.get_errno()).decode())


def serve(port: str | None, unit: int = 1, baud: int = 19200) -> None:
    """Answer requests until the process ends: on a serial port, or on TCP when it is None.

    Holding register n holds n, input register n holds 1000 + n, coil and discrete input n hold
    whether n is odd.
    """
    lib = library()
    mapping = lib.modbus_mapping_new(REGISTERS, REGISTERS, REGISTERS, REGISTERS)
    for i in range(REGISTERS):
        mapping.contents.tab_registers[i] = i
        mapping.contents.tab_input_registers[i] = 1000 + i
        mapping.contents.tab_bits[i] = mapping.contents.tab_input_bits[i] = i % 2
    if port is None:
        with socket.socket() as probe:
            probe.bind((HOST, 0))
            number = probe.getsockname()[1]
        context = ctypes.c_void_p(lib.modbus_new_tcp(HOST.encode(), number))
        listener = lib.modbus_tcp_listen(context, 4)
        print(number, flush=True)
        while True:
            lib.modbus_tcp_accept(context, ctypes.byref(ctypes.c_int(listener)))
            _answer(lib, context, mapping)
            lib.modbus_close(context)
    context = ctypes.c_void_p(lib.modbus_new_rtu(port.encode(), baud, ctypes.c_char(b"N"), 8, 1))
    lib.modbus_set_slave(context, unit)
    if lib.modbus_connect(context) < 0:
        raise OSError(lib.modbus_strerror(ctypes.get_errno()).decode())
    print("ready", flush=True)
    while True:
        _answer(lib, context, mapping)


def _answer(lib: ctypes.CDLL, context: ctypes.c_void_p, mapping: ctypes._Pointer[_Mapping]) -> None:
    query = (ctypes.c_uint8 * LONGEST_ADU)()
    while (length := lib.modbus_receive(context, query)) >= 0:
        if length > 0:
            lib.modbus_reply(context, query, length, mapping)


def main() -> None:
    parser = argparse.ArgumentParser(description="Serve with libmodbus")
    parser.add_argument("kind", choices=("tcp", "rtu"))
    parser.add_argument("port", nargs="?")
    parser.add_argument("unit", nargs="?", type=int, default=1)
    arguments = parser.parse_args()
    serve(arguments.port if arguments.kind == "rtu" else None, arguments.unit)


if __name__ == "__main__":
    main()
