"""``[opcua_server]``: what the daemon shows to OPC UA clients, and who may look."""

from __future__ import annotations

from pathlib import Path
from typing import Self

from pydantic import Field, model_validator

from fieldlink.site.base import Model, is_loopback
from fieldlink.site.opcua import OPCUA_PORT

__all__ = ["OpcuaServerSettings"]


class OpcuaServerSettings(Model):
    """``[opcua_server]``: a read-only OPC UA server of loops and devices; needs the extra opcua."""

    host: str = "127.0.0.1"
    """Address to bind; other machines reach it only with cert, and with a password or trusted."""
    port: int = Field(default=OPCUA_PORT, ge=0, le=0xFFFF)
    """TCP port; 0 picks a free one."""
    cert: Path | None = None
    """The server's certificate (PEM or DER), relative to the site file; every connection is then
    encrypted."""
    key: Path | None = None
    """Private key of cert, without a password."""
    application_uri: str = Field(default="urn:fieldlink:server", min_length=1)
    """The server's application URI; it must be the one in cert."""
    username: str | None = Field(default=None, min_length=1)
    """User name that clients have to give; anonymous clients are accepted unless given."""
    password_file: Path | None = None
    """File with the password and nothing else, relative to the site file."""
    trusted: tuple[Path, ...] = ()
    """Certificates of the clients that may connect; any client unless given."""
    max_clients: int = Field(default=20, ge=1, le=500)
    """Most connections at a time; one more is closed at once."""

    @property
    def is_local(self) -> bool:
        """Whether only this machine can reach it."""
        return is_loopback(self.host)

    @model_validator(mode="after")
    def _guarded(self) -> Self:
        if (self.cert is None) != (self.key is None):
            raise ValueError("cert and key belong together; give both or neither")
        if (self.username is None) != (self.password_file is None):
            raise ValueError("username and password_file belong together; give both or neither")
        if self.trusted and self.cert is None:
            raise ValueError(
                "trusted is about the clients of an encrypted server; add its cert and key"
            )
        known = self.username is not None or bool(self.trusted)
        if not self.is_local and not (self.cert is not None and known):
            raise ValueError(
                f'host = "{self.host}" lets other machines in; add cert and key, and either '
                'username with password_file or trusted certificates, or bind to "127.0.0.1"'
            )
        return self
