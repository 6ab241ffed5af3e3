"""The pages' certificate: whether it can be used, and a renewed one without a restart."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Sequence
from pathlib import Path

import structlog
import uvicorn

from fieldlink.file_at import stamp_of_file
from fieldlink.tls_words import no_password, tls_words

__all__ = ["fault_of", "follow_certificate"]

LOOK_EVERY = 60.0
"""Seconds between two looks at the files: a certificate is renewed days before its end."""

_log = structlog.get_logger(__name__)


def fault_of(files: Sequence[Path]) -> str:
    """Return why a server cannot use certificate and key; empty where it can."""
    return _load(ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), files)


async def follow_certificate(config: uvicorn.Config) -> None:
    """Use a certificate that is renewed while the server runs, for new connections.

    Args:
        config: of the server, loaded; without TLS there is nothing to follow.
    """
    context = config.ssl
    if context is None:
        return
    files = [Path(str(config.ssl_certfile)), Path(str(config.ssl_keyfile))]
    known = await asyncio.to_thread(lambda: [*map(stamp_of_file, files)])
    while True:
        await asyncio.sleep(LOOK_EVERY)
        found = await asyncio.to_thread(lambda: [*map(stamp_of_file, files)])
        if found == known:
            continue
        known = found
        # Tried apart first: a certificate whose key is still to come must not spoil the one in use.
        problem = await asyncio.to_thread(lambda: fault_of(files) or _load(context, files))
        if problem:
            _log.warning(
                "web.certificate_refused",
                error=problem,
                advice="the one before is used until certificate and key belong together",
            )
        else:
            _log.info("web.certificate_renewed", file=str(files[0]))


def _load(context: ssl.SSLContext, files: Sequence[Path]) -> str:
    """Load certificate and key; return what is wrong with them, empty where nothing is."""
    try:
        context.load_cert_chain(files[0], files[1], no_password)
    except (OSError, ValueError) as error:
        return tls_words(error, files)
    return ""
