"""CRC-16/MODBUS (polynomial 0x8005 reflected, start 0xFFFF), over registers."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["crc16", "crc16_bytes"]


def _table_entry(byte: int) -> int:
    crc = byte
    for _ in range(8):
        crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc


_TABLE = tuple(_table_entry(byte) for byte in range(256))


def crc16(words: Iterable[int]) -> int:
    """Return the CRC of 16-bit ``words``, each taken as high byte, then low byte.

    That is the order of the bytes on the wire, whatever word order the values in them have.
    """
    crc = 0xFFFF
    for word in words:
        crc = (crc >> 8) ^ _TABLE[(crc ^ (word >> 8)) & 0xFF]
        crc = (crc >> 8) ^ _TABLE[(crc ^ word) & 0xFF]
    return crc


def crc16_bytes(data: bytes) -> int:
    """Return the CRC of ``data``; on a serial line its low byte is sent first."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ _TABLE[(crc ^ byte) & 0xFF]
    return crc
