"""What a ``host`` of the site file may look like: an address or a name, and nothing around it."""

from __future__ import annotations

from ipaddress import ip_address

__all__ = ["find_fault_of_host", "one_name"]

_LOOPBACK = ("localhost", "127.0.0.1", "::1")
"""Names of this machine; 127.0.0.2 and the like may each be another device."""


def one_name(host: str) -> str:
    """Return the same text for hosts that are written in several ways and are one."""
    try:
        host = str(ip_address(host))
    except ValueError:
        host = host.casefold().removesuffix(".")
    return _LOOPBACK[0] if host in _LOOPBACK else host


def find_fault_of_host(host: str) -> str:
    """Say what is wrong with a host, and what to do; empty when it may be one."""
    try:
        ip_address(host)
    except ValueError:
        pass
    else:
        return ""
    given = f"host = {host!r}".replace("'", '"')
    if strange := next((char for char in host if not (char.isalnum() or char in "-._")), ""):
        what = "a blank" if strange.isspace() else strange
        return (
            f"{given} has {what}, which no address and no name has; give the address or the name "
            "alone, and the port as port = 502"
        )
    if all(part.isdigit() for part in host.split(".")):
        return f"{given} is no address; give four numbers from 0 to 255, or a name"
    return ""
