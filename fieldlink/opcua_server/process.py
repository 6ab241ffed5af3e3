"""The server's process: settings and values come in as lines of JSON, and events go out as such.

    python -m fieldlink.opcua_server.process

The first line in holds the settings, each line after it a document for `Nodes.show`; a line goes
out when the server listens or cannot, and for every document taken. The process ends when its
input does: a daemon that was killed leaves no server behind.
"""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import os
import signal
import sys
from datetime import UTC, datetime
from typing import Any
from urllib.parse import quote

from asyncua import Server, ua
from asyncua.common.connection import TransportLimits
from asyncua.crypto import uacrypto
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey

from fieldlink.opcua_keys import KeyFileError, find_fault_of_uri, read_certificate, read_key
from fieldlink.opcua_server.access import BoundedServer, Doorkeeper, ReadOnlyRules
from fieldlink.opcua_server.nodes import Nodes

__all__ = ["main", "read_keys"]

NICENESS = 10
"""As the estimator's processes: the daemon's polls go first."""

MEMORY = 600_000_000
"""Bytes: six times what asyncua takes without loops, for 20 clients; a flood ends this process
only."""

MEMORY_A_LOOP = 500_000
"""Bytes: twice what the nodes of a loop take, so that clients may subscribe to all of them."""

LONGEST_LINE = 64 * 2**20
"""Bytes of a document: 5,000 loops have less than a tenth."""

MOST_BYTES = 4 * 2**20
"""Bytes of a client's request; the largest that reads has some hundred kilobytes."""

CHUNK = 65_535
"""Bytes of a buffer, the smallest that every client has to accept (Part 6, 7.1.2.3) and more."""

_POLICIES = (
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes128Sha256RsaOaep_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
)


def main() -> None:
    """Run until the input ends."""
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    _stand_back()
    asyncio.run(_serve())


def _stand_back() -> None:
    """Let the daemon go first, and let it decide when this process ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    bound_memory(0)
    if sys.platform != "win32":
        os.nice(NICENESS)


def bound_memory(loops: int) -> None:
    """Let this process take what it needs for so many loops, and not more."""
    if sys.platform != "win32":
        import resource

        most = MEMORY + MEMORY_A_LOOP * loops
        # without the right to raise it again, the hard limit stays
        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        soft = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


async def _serve() -> None:
    reader = asyncio.StreamReader(limit=LONGEST_LINE)
    await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), sys.stdin
    )
    settings = json.loads(await reader.readline())
    try:
        server = await _make_server(settings)
        nodes = Nodes(server)
        await nodes.build()
        await server.start()
    except KeyFileError as error:
        _tell(failed=str(error))
        return
    except OSError as error:
        _tell(failed=error.strerror or str(error))
        return
    _tell(port=server.bserver.port)
    try:
        while line := await reader.readline():
            document = json.loads(line)
            bound_memory(len(document["loops"]["names"]) + nodes.out_of_sight)
            await nodes.show(document)
            _tell(clients=len(server.bserver.clients))
    finally:
        await server.stop()


def _tell(**what: Any) -> None:
    print(json.dumps(what), flush=True)


async def _make_server(settings: dict[str, Any]) -> Server:
    uri, cert, key = (settings[name] for name in ("application_uri", "cert", "key"))
    trusted = [read_certificate(path) for path in settings["trusted"]]
    keys = None if cert is None else read_keys(cert, key, uri)
    doorkeeper = Doorkeeper(
        settings["username"],
        settings["password"],
        [uacrypto.der_from_x509(certificate) for certificate in trusted],
    )
    server = Server(iserver=BoundedServer(doorkeeper, settings["max_clients"]))
    # The standard's thousands of nodes stay to the end: half of a start was the search for garbage
    # among them.
    gc.disable()
    try:
        await server.init()
    finally:
        gc.freeze()
        gc.enable()
    server.limits = TransportLimits(
        max_recv_buffer=CHUNK,
        max_send_buffer=CHUNK,
        max_chunk_count=MOST_BYTES // CHUNK + 1,
        max_message_size=MOST_BYTES,
    )
    await server.set_application_uri(uri)
    server.set_server_name(f"fieldlink {settings['site']}")
    server.application_type = ua.ApplicationType.Server
    await server.set_build_info(
        "urn:fieldlink", "fieldlink", "fieldlink", settings["version"], "", datetime.now(UTC)
    )
    host = settings["host"]
    shown = f"[{host}]" if ":" in host else quote(host)
    server.set_endpoint(f"opc.tcp://{shown}:{settings['port']}/fieldlink")
    server.socket_address = (host, settings["port"])
    policies = [ua.SecurityPolicyType.NoSecurity]
    if keys is not None:
        policies = list(_POLICIES)
        server.iserver.certificate, server.iserver.private_key = keys
    server.set_security_policy(policies, permission_ruleset=ReadOnlyRules())
    token = ua.AnonymousIdentityToken
    server.set_identity_tokens(
        [token if settings["username"] is None else ua.UserNameIdentityToken]
    )
    return server


def read_keys(cert: str, key: str, uri: str) -> tuple[x509.Certificate, RSAPrivateKey]:
    """Return certificate and key of a server with this URI.

    Raises:
        KeyFileError: they cannot be used together.
    """
    certificate = read_certificate(cert)
    if found := find_fault_of_uri(certificate, uri):
        raise KeyFileError(f"{cert} {found} and the server is {uri}", "make them agree")
    return certificate, read_key(key, certificate)


if __name__ == "__main__":
    main()
