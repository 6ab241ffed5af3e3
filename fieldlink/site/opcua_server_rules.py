"""What must hold between the table ``[opcua_server]`` and the files that it names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from fieldlink.site.checked_site import Site
from fieldlink.site.errors import Problem
from fieldlink.site.named_files import find_missing
from fieldlink.site.toml_source import TomlSource

__all__ = ["opcua_server_fits"]


def opcua_server_fits(site: Site, source: TomlSource) -> Iterator[Problem]:
    """Yield what is wrong with the files that ``[opcua_server]`` names."""
    settings = site.file.opcua_server
    if settings is None:
        return
    keys = ("cert", "key", "password_file")
    files: dict[tuple[str, ...], Path | None] = {
        ("opcua_server", key): getattr(settings, key) for key in keys
    }
    yield from find_missing(site, source, files)
    for path in settings.trusted:
        yield from find_missing(site, source, {("opcua_server", "trusted"): path})
