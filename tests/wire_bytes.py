"""Bytes on the wire, by code that shares nothing with the links that are tested."""

from __future__ import annotations

import struct

__all__ = ["crc"]


def crc(data: bytes) -> bytes:
    """The CRC of Modbus over serial line (V1.02, appendix B), bit by bit; low byte first."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = (register >> 1) ^ 0xA001 if register & 1 else register >> 1
    return struct.pack("<H", register)
