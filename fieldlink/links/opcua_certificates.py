"""A session's security: our certificate and key, and whether the server shows the one we know.

A server with another one cannot read what is encrypted for the known one: it ends the connection or
says nothing at all. So it is asked, without encryption, what its certificate is.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

from asyncua import Client, ua
from asyncua.crypto import security_policies
from asyncua.crypto.uacrypto import CertProperties, der_from_x509, pem_from_key
from asyncua.ua.uaerrors import UaError
from cryptography import x509
from cryptography.hazmat.primitives.hashes import SHA1

from fieldlink.opcua_keys import KeyFileError, read_certificate, read_key
from fieldlink.site.opcua import OpcuaSettings

__all__ = ["find_stranger", "secure"]


async def secure(
    client: Client, settings: OpcuaSettings, resolve: Callable[[str | Path], Path]
) -> None:
    """Have a client sign its messages, and encrypt them where the settings ask for it.

    Args:
        client: that is not connected yet.
        settings: with a security policy and the files that it needs.
        resolve: turns a path of the site file into one that can be opened.

    Raises:
        KeyFileError: a certificate or the key cannot be used.
    """
    assert settings.cert is not None
    assert settings.key is not None
    assert settings.server_cert is not None
    policy = getattr(security_policies, f"SecurityPolicy{settings.security.replace('_', '')}")
    mode = ua.MessageSecurityMode
    cert = read_certificate(resolve(settings.cert))
    key = read_key(resolve(settings.key), cert)
    server = read_certificate(resolve(settings.server_cert))
    await client.set_security(
        policy,
        CertProperties(der_from_x509(cert), "der"),
        CertProperties(pem_from_key(key), "pem"),
        server_certificate=CertProperties(der_from_x509(server), "der"),
        mode=mode.SignAndEncrypt if settings.encrypt else mode.Sign,
    )


async def find_stranger(where: str, known: Path, within: float) -> str:
    """Return the thumbprint of the server's certificate when it is not the known one.

    Args:
        where: address of the server.
        known: file with its certificate, PEM or DER.
        within: seconds for the question.

    Returns:
        SHA-1 in hexadecimal, as servers show it; empty when it is the known one, or not told.
    """
    client = Client(where, timeout=within)
    try:
        async with asyncio.timeout(within):
            endpoints = await client.connect_and_get_server_endpoints()
        shown = {bytes(one.ServerCertificate) for one in endpoints if one.ServerCertificate}
        # A server may send those who signed it behind its own.
        own = [x509.load_der_x509_certificate(_first_of(chain)) for chain in shown]
        mine = read_certificate(known)
    except (TimeoutError, OSError, UaError, ValueError, KeyFileError):
        return ""
    finally:
        client.disconnect_socket()
    if not own or mine in own:
        return ""
    return own[0].fingerprint(SHA1()).hex()


def _first_of(chain: bytes) -> bytes:
    """Return the first of certificates in DER, one behind the other."""
    if len(chain) > 4 and chain[1] == 0x82:
        return chain[: 4 + int.from_bytes(chain[2:4])]
    return chain
