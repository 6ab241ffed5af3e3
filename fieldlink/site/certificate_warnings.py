"""Certificates that are over, not begun, soon over, or none, for ``fieldlink check``."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from importlib.util import find_spec
from pathlib import Path

from fieldlink.site.checked_site import Site
from fieldlink.site.device import Tls
from fieldlink.site.mqtt import MqttTls
from fieldlink.tls_words import client_context, tls_words

__all__ = ["find_certificate_warnings"]

SOON = timedelta(days=30)
"""Time enough to get a certificate and have it trusted."""


def find_certificate_warnings(site: Site) -> Iterator[str]:
    """Yield a sentence for each certificate that is, or soon will be, no good.

    A server's own is still believed after its time: it is known, and polling must not end on a
    day that nobody thought of. Servers may refuse ours.
    """
    if find_spec("cryptography") is None:
        return
    yield from _unusable(site)
    yield from _other_uris(site)
    for what, file, remedy in _certificates(site):
        if file is not None and (fault := _fault_of(site.resolve(file))):
            yield f"{what} {file} {fault}; {remedy}"


def _unusable(site: Site) -> Iterator[str]:
    """Yield a sentence for each set of files with which no TLS connection can be made."""
    tables: dict[str, Tls | MqttTls | None] = {
        f"device {name}: tls": device.tls for name, device in site.devices.items()
    }
    if site.file.mqtt is not None:
        tables["mqtt.tls"] = site.file.mqtt.tls
    for what, tls in tables.items():
        if tls is None:
            continue
        files = [site.resolve(path) for path in (tls.ca, tls.cert, tls.key) if path is not None]
        try:
            client_context(files)
        except (OSError, ValueError) as error:
            yield (
                f"{what}: {tls_words(error, files)}; give PEM files that belong together, and a "
                "key without a password"
            )


def _other_uris(site: Site) -> Iterator[str]:
    """Yield a sentence for each certificate of ours that names another URI than the site file."""
    from fieldlink.opcua_keys import KeyFileError, find_fault_of_uri, read_certificate

    for name, device in site.devices.items():
        settings = device.opcua
        if settings.cert is None:
            continue
        try:
            certificate = read_certificate(site.resolve(settings.cert))
        except KeyFileError:
            continue  # told with its date
        if fault := find_fault_of_uri(certificate, settings.application_uri):
            yield (
                f"device {name}: cert {settings.cert} {fault}, and application_uri is "
                f"{settings.application_uri}: the server may refuse it; make them agree"
            )


def _certificates(site: Site) -> Iterator[tuple[str, Path | None, str]]:
    """Yield each certificate that the site names: what it is, its file, and what to do about it."""
    for name, device in site.devices.items():
        made = "the server may refuse it: make a new one, and let the server trust it"
        yield f"device {name}: cert", device.opcua.cert, made
        put = "it is still believed: have the server given a new one, and put it in"
        yield f"device {name}: server_cert", device.opcua.server_cert, put
        if device.tls is not None:
            yield f"device {name}: tls.cert", device.tls.cert, "the device may refuse it: renew it"
    yield "web.tls_certificate", site.web.tls_certificate, "browsers refuse it: renew it"
    if (mqtt := site.file.mqtt) is not None and mqtt.tls is not None:
        yield "mqtt.tls.cert", mqtt.tls.cert, "the broker may refuse it: renew it"
    if (server := site.file.opcua_server) is not None:
        remedy = "clients may refuse it: renew it, and start the daemon again"
        yield "opcua_server.cert", server.cert, remedy


def _fault_of(file: Path) -> str:
    from fieldlink.opcua_keys import load_certificate

    try:
        certificate = load_certificate(file.read_bytes())
    except (OSError, ValueError):
        return "cannot be read as a certificate"
    now = datetime.now(UTC)
    if now < certificate.not_valid_before_utc:
        return f"is valid from {certificate.not_valid_before_utc:%Y-%m-%d} on only"
    if now > certificate.not_valid_after_utc:
        return f"was valid until {certificate.not_valid_after_utc:%Y-%m-%d}"
    if now + SOON > certificate.not_valid_after_utc:
        return f"is valid until {certificate.not_valid_after_utc:%Y-%m-%d} only"
    return ""
