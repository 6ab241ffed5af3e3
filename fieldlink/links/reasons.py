"""Why a connection cannot be made or a serial port not be opened, in words of people."""

from __future__ import annotations

import os
import re
import ssl

from fieldlink.tls_words import tls_words

try:
    from termios import error as TerminalError  # noqa: N812
except ImportError:  # pragma: no cover  (a system without terminals has no such errors)
    TerminalError = OSError  # type: ignore[misc,assignment]

__all__ = ["TerminalError", "reason_of"]

_ERRNO = re.compile(r"\[Errno (\d+)\]|\((\d+), '")
"""How Python and pyserial write the system's number of an error inside their own words."""


def reason_of(error: Exception) -> str:
    """Return why; ``error`` is as asyncio, the ssl module or pyserial raised it."""
    if isinstance(error, ssl.SSLError):
        return tls_words(error)
    text = getattr(error, "strerror", None) or str(error) or "the other side ended the connection"
    if "exclusively lock" in text:
        text = "another program uses the port"
    elif "returned no data" in text:
        text = "the port is gone, or another program reads from it"
    elif numbers := ["".join(found) for found in _ERRNO.findall(str(error))]:
        # What asyncio and pyserial add is the address or the port, as Python writes them.
        text = ", ".join(dict.fromkeys(os.strerror(int(number)) for number in numbers))
    if isinstance(error, TerminalError) and not isinstance(error, OSError):
        number, said = (*error.args, "")[:2] if error.args else (None, "")
        text = f"the serial port refuses its settings ({said or number})"
    return str(text).rstrip(".")
