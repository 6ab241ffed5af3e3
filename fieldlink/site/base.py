"""What every table of a site file has in common."""

from __future__ import annotations

from ipaddress import ip_address

from pydantic import BaseModel, ConfigDict

__all__ = ["Model", "is_loopback"]


class Model(BaseModel):
    """What every table of a site file is: frozen, strict, without unknown keys."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )


def is_loopback(host: str) -> bool:
    """Whether a host name or address is this machine's own."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
