"""Why a certificate, a key or a TLS connection is refused, in words of people.

tls_words(error)  # "the key does not belong to the certificate"
"""

from __future__ import annotations

import re
import ssl
from collections.abc import Iterable
from pathlib import Path

from fieldlink.file_at import why_no_file

__all__ = ["distrust_remedy", "tls_remedy", "tls_words"]

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


def tls_words(error: Exception, files: Iterable[Path] = ()) -> str:
    """Return what is wrong.

    Args:
        error: as the ssl module raised it.
        files: that were to be read: one that is not there is named.
    """
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is refused: {error.verify_message.rstrip('.')}"
    if isinstance(error, ssl.SSLError):
        if "PEM lib" in str(error):
            return _NO_PEM
        if alert := _ALERT.search(str(error)):
            return f"it ends TLS: {alert[1]}"
        return _SAID.get(error.reason or "", _SOURCE.sub("", _SOURCE.sub("", str(error))))
    missing = ((file, why_no_file(file)) for file in files)
    named = next((f"{file}: {why}" for file, why in missing if why), None)
    return named or getattr(error, "strerror", None) or str(error)


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
