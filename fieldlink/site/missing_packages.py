"""What a site asks for and this installation has no package for, for ``fieldlink check``."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec

from fieldlink.site.checked_site import Site

__all__ = ["find_missing_packages"]


def find_missing_packages(site: Site) -> Iterator[str]:
    """Yield a sentence for each part of the site file that needs a package which is not here."""
    for what, package, extra in _needed(site):
        if find_spec(package) is None:
            yield (
                f"{what} needs {package}, which is not installed here: run would not start; "
                f"pip install 'fieldlink[{extra}]'"
            )


def _needed(site: Site) -> Iterator[tuple[str, str, str]]:
    """Yield what needs a package, the package, and the extra that brings it."""
    file = site.file
    for name, device in site.devices.items():
        if device.is_opcua:
            yield f"device {name}", "asyncua", "opcua"
    if site.historian_url.startswith("postgresql"):
        yield "historian.url", "psycopg", "postgresql"
    if file.mqtt is not None:
        yield "the table [mqtt]", "paho", "mqtt"
    if file.opcua_server is not None:
        yield "the table [opcua_server]", "asyncua", "opcua"
    if file.notify is not None and file.notify.web_hook is not None:
        yield "the table [notify.web_hook]", "httpx", "notify"
