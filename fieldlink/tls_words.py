"""Why a certificate, a key or a TLS connection is refused, in words of people.

tls_words(error)  # "the key does not belong to the certificate"
"""

from __future__ import annotations

import errno
import os
import re
import ssl
from collections.abc import Iterable, Sequence
from pathlib import Path

from fieldlink.file_at import why_no_file

__all__ = ["client_context", "distrust_remedy", "no_password", "tls_remedy", "tls_words"]

_SAID = {
    "KEY_VALUES_MISMATCH": "the key does not belong to the certificate",
    "NO_CERTIFICATE_OR_CRL_FOUND": "the file of the authority (ca) holds no certificate",
}
_NO_PEM = "a certificate or key is not PEM text, or stands in the other's file"
_SOURCE = re.compile(r"^\[[^\]]*\] |\s*\(_ssl\.c:\d+\)$")
"""What OpenSSL and Python add: the name of the fault, and a line of their source."""
_ALERT = re.compile(r"(?:sslv3|tlsv1|tlsv13) alert ([\w ]+\w)")
"""How OpenSSL writes what the other side said when it ended TLS (RFC 8446, 6)."""
_OF_VERSIONS = ("TLSV1_ALERT_PROTOCOL_VERSION", "UNSUPPORTED_PROTOCOL", "WRONG_SSL_VERSION")
_NO_TLS = ("WRONG_VERSION_NUMBER", "HTTP_REQUEST", "RECORD_LAYER_FAILURE")


def client_context(files: Sequence[Path]) -> ssl.SSLContext:
    """Return a client's side of TLS 1.2 or newer.

    Args:
        files: that of the authorities, and, where we have one, our certificate and its key.

    Raises:
        OSError, ValueError: a file cannot be read or does not fit; `tls_words` says why.
    """
    ca, *ours = files
    context = ssl.create_default_context(cafile=ca)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    if ours:
        cert, key = ours
        context.load_cert_chain(cert, key, no_password)
    return context


def no_password() -> str:
    """Refuse to give a key's password; OpenSSL would ask for it on the terminal.

    Raises:
        ValueError: always.
    """
    raise ValueError("the key has a password")


def tls_words(error: Exception, files: Iterable[Path] = ()) -> str:
    """Return what is wrong.

    Args:
        error: as the ssl module raised it.
        files: that were to be read: one that cannot be is named.
    """
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is refused: {error.verify_message.rstrip('.')}"
    if isinstance(error, ssl.SSLError):
        if "PEM lib" in str(error):
            return _NO_PEM
        if alert := _ALERT.search(str(error)):
            return f"it ends TLS: {alert[1]}"
        return _SAID.get(error.reason or "", _SOURCE.sub("", _SOURCE.sub("", str(error))))
    missing = ((file, why_no_file(file) or _why_unreadable(file)) for file in files)
    named = next((f"{file}: {why}" for file, why in missing if why), None)
    return named or getattr(error, "strerror", None) or str(error)


def _why_unreadable(file: Path) -> str:
    return "" if os.access(file, os.R_OK) else os.strerror(errno.EACCES)


def tls_remedy(error: BaseException | None, ca: str, cert: str = "", host: str = "the host") -> str:
    """Return what to do about TLS that does not come about; empty where it is not that.

    Args:
        error: as the ssl module or the event loop raised it.
        ca: the setting that names the authority's file.
        cert: the setting that names our certificate; empty without one.
        host: the settings that say which name the certificate has to have.
    """
    if isinstance(error, ssl.SSLCertVerificationError):
        remedy = _REMEDIES.get(error.verify_code, "name the file of its authority in {ca}")
        return remedy.format(ca=ca, host=host)
    if isinstance(error, ConnectionResetError) and not error.args:
        # Of asyncio alone: the other side went away in the middle of the handshake.
        return f"check that its port is for TLS, or {distrust_remedy(cert)}"
    if not isinstance(error, ssl.SSLError):
        return ""
    if error.reason in _OF_VERSIONS:
        return "it has to speak TLS 1.2 or newer: renew its software"
    if error.reason in _NO_TLS:
        return "its port is not for TLS: correct the port"
    return distrust_remedy(cert) if cert and _ALERT.search(str(error)) else ""


def distrust_remedy(cert: str) -> str:
    """Return what to do about a peer that may not trust our certificate; ``cert`` names it."""
    return f"give it a {cert} that is still valid and that it trusts"


_REMEDIES = {
    9: "check this machine's clock",
    10: "renew it there, or check this machine's clock",
    62: "write {host} as the certificate names it, or renew it with this name",
    64: "write {host} as the certificate names it, or renew it with this address",
}
"""By OpenSSL's X509_V_ERR: not valid yet, expired, another host name, another address."""
