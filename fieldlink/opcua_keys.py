"""Certificates and keys of OPC UA, checked before the library that uses them gets them.

They are told by what is in them: PEM text has many endings, of which asyncua knows ``.pem`` alone.
"""

from __future__ import annotations

from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey, RSAPublicKey

__all__ = ["KeyFileError", "find_fault_of_uri", "load_certificate", "read_certificate", "read_key"]


class KeyFileError(Exception):
    """A certificate or key cannot be used.

    Not a `FieldlinkError`: the server's process imports nothing of the daemon.

    Attributes:
        what: the file, and what is wrong with it.
        remedy: what to do.
    """

    def __init__(self, what: str, remedy: str) -> None:
        super().__init__(f"{what}; {remedy}")
        self.what, self.remedy = what, remedy


def load_certificate(data: bytes) -> x509.Certificate:
    """Return the certificate in PEM text or DER.

    Raises:
        ValueError: there is none.
    """
    if _is_text(data):
        return x509.load_pem_x509_certificate(data)
    return x509.load_der_x509_certificate(data)


def read_certificate(file: str | Path) -> x509.Certificate:
    """Return the certificate in a file, PEM or DER.

    Raises:
        KeyFileError: there is none, or it is of another kind than OPC UA's policies take.
    """
    try:
        certificate = load_certificate(_read(file))
    except ValueError as error:
        raise KeyFileError(
            f"{file} holds no certificate", "give a certificate as PEM or DER file"
        ) from error
    if not isinstance(certificate.public_key(), RSAPublicKey):
        raise KeyFileError(
            f"{file} is not a certificate of an RSA key", "make one with an RSA key of 2048 bits"
        )
    return certificate


def find_fault_of_uri(certificate: x509.Certificate, uri: str) -> str:
    """Return how a certificate differs from an application URI, which it has to name; or empty."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName)
        uris = names.value.get_values_for_type(x509.UniformResourceIdentifier)
    except x509.ExtensionNotFound:
        uris = []
    if uri in uris:
        return ""
    return f"names {uris[0]}" if uris else "names no application URI"


def read_key(file: str | Path, certificate: x509.Certificate) -> RSAPrivateKey:
    """Return the private key of a certificate, from a PEM or DER file.

    Raises:
        KeyFileError: there is none, it has a password, or it is of another certificate.
    """
    data = _read(file)
    try:
        if _is_text(data):
            key = serialization.load_pem_private_key(data, None)
        else:
            key = serialization.load_der_private_key(data, None)
    except TypeError as error:
        raise KeyFileError(f"{file} has a password", "give the key without one") from error
    except ValueError as error:
        raise KeyFileError(
            f"{file} holds no private key", "give the key as PEM or DER file"
        ) from error
    if not isinstance(key, RSAPrivateKey) or key.public_key() != certificate.public_key():
        raise KeyFileError(
            f"the key in {file} does not belong to the certificate",
            "give the key of that certificate",
        )
    return key


def _is_text(data: bytes) -> bool:
    return b"-----BEGIN" in data


def _read(file: str | Path) -> bytes:
    try:
        return Path(file).read_bytes()
    except OSError as error:
        raise KeyFileError(
            f"the file {file} cannot be read: {error.strerror}", "check its path and permissions"
        ) from error
