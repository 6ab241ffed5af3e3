"""``[devices.NAME.opcua]``: how an OPC UA server is asked, and with which security."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from fieldlink.site.base import Model

__all__ = ["NODE_ID", "OPCUA_PORT", "OpcuaSettings"]

OPCUA_PORT = 4840
"""The port that IANA registers for OPC UA's binary protocol."""

NODE_ID = re.compile(
    r"(ns=\d{1,5};|nsu=[^;]+;)?(i=\d{1,10}|s=.+|g=[0-9a-fA-F]{8}(-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12})"
)
"""A node id as OPC UA writes it (Part 6, 5.3.1.10); nsu= names the namespace by its URI."""


class OpcuaSettings(Model):
    """``[devices.NAME.opcua]``: how an OPC UA server is asked; for link = "opcua"."""

    path: str = ""
    """Path of the server's address after host and port, such as /UA/Server."""
    mode: Literal["read", "subscribe"] = "read"
    """Whether every scan reads all values, or the server reports them when they change."""
    security: Literal["none", "Basic256Sha256", "Aes128_Sha256_RsaOaep", "Aes256_Sha256_RsaPss"] = (
        "none"
    )
    """Security policy; every other than none needs cert and key."""
    encrypt: bool = True
    """Whether messages are signed and encrypted; with false they are signed only."""
    cert: Path | None = None
    """Our certificate (PEM or DER), relative to the site file."""
    key: Path | None = None
    """Private key of cert, without a password."""
    server_cert: Path | None = None
    """The server's certificate; with it no other server is talked to."""
    application_uri: str = "urn:fieldlink:client"
    """Our application URI; it must be the one in cert."""
    username: str | None = None
    """User name for the server; anonymous unless given."""
    password_file: Path | None = None
    """File with the password and nothing else, relative to the site file."""
    max_nodes: int = Field(default=500, ge=5, le=10_000)
    """Most nodes in one Read request; OP and PV of a loop are always in the same one."""
    exchange_node: str | None = None
    """Array of UInt16 that holds the exchange areas; base is an index into it."""

    @field_validator("exchange_node")
    @classmethod
    def _is_node_id(cls, text: str | None) -> str | None:
        if text is not None and NODE_ID.fullmatch(text) is None:
            raise ValueError(
                f'exchange_node = "{text}" is not a node id; write it like ns=2;s=FC101.Exchange'
            )
        return text

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.cert is None) != (self.key is None):
            raise ValueError("cert and key belong together; give both or neither")
        if (self.username is None) != (self.password_file is None):
            raise ValueError("username and password_file belong together; give both or neither")
        if self.security != "none" and (self.cert is None or self.server_cert is None):
            raise ValueError(
                f'security = "{self.security}" needs cert, key and server_cert; name the files, '
                'or use security = "none"'
            )
        if self.password_file is not None and self.security == "none":
            raise ValueError(
                "the password would cross the network unencrypted; choose a security policy, such "
                'as security = "Basic256Sha256"'
            )
        return self
