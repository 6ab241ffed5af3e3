"""Why a certificate, a key or a TLS connection is refused, in words of people.

tls_words(error)  # "the key does not belong to the certificate"
"""

from __future__ import annotations

import re
import ssl
from collections.abc import Iterable
from pathlib import Path

from fieldlink.file_at import why_no_file

__all__ = ["certificate_remedy", "tls_words"]

_SAID = {
    "KEY_VALUES_MISMATCH": "the key does not belong to the certificate",
    "NO_CERTIFICATE_OR_CRL_FOUND": "the file of the authority (ca) holds no certificate",
}
_NO_PEM = "a certificate or key is not PEM text, or stands in the other's file"
_SOURCE = re.compile(r"^\[[^\]]*\] |\s*\(_ssl\.c:\d+\)$")
"""What OpenSSL and Python add: the name of the fault, and a line of their source."""


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
        return _SAID.get(error.reason or "", _SOURCE.sub("", _SOURCE.sub("", str(error))))
    missing = ((file, why_no_file(file)) for file in files)
    named = next((f"{file}: {why}" for file, why in missing if why), None)
    return named or getattr(error, "strerror", None) or str(error)


def certificate_remedy(error: Exception, ca: str) -> str:
    """Return what to do about a peer's certificate that is refused; empty where it is not that.

    Args:
        error: as the ssl module raised it.
        ca: the setting that names the authority's file.
    """
    if not isinstance(error, ssl.SSLCertVerificationError):
        return ""
    return _REMEDIES.get(error.verify_code, f"name the file of its authority in {ca}")


_REMEDIES = {
    9: "check this machine's clock",
    10: "renew it there, or check this machine's clock",
    62: "write the host as the certificate names it, or renew it with this name",
    64: "write the host as the certificate names it, or renew it with this address",
}
"""By OpenSSL's X509_V_ERR: not valid yet, expired, another host name, another address."""
