"""What must hold between the table ``[notify]`` and the rest of a site."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from fieldlink.site.checked_site import Site
from fieldlink.site.errors import Problem
from fieldlink.site.named_files import find_missing
from fieldlink.site.toml_source import TomlSource

__all__ = ["notify_fits"]

_FILES = {
    "web_hook": ("url_file", "token_file", "ca"),
    "mail": ("password_file", "ca"),
}


def notify_fits(site: Site, source: TomlSource) -> Iterator[Problem]:
    """Yield what is wrong with the files that ``[notify]`` names."""
    notify = site.file.notify
    if notify is None:
        return
    files: dict[tuple[str, ...], Path | None] = {
        ("notify", table, key): getattr(settings, key)
        for table, keys in _FILES.items()
        if (settings := getattr(notify, table)) is not None
        for key in keys
    }
    yield from find_missing(site, source, files)
