"""Files that a site file names and that have to exist: certificates, keys, passwords."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from fieldlink.file_at import why_no_file
from fieldlink.site.checked_site import Site
from fieldlink.site.errors import Problem
from fieldlink.site.toml_source import TomlSource

__all__ = ["find_missing"]


def find_missing(
    site: Site, source: TomlSource, files: Mapping[tuple[str, ...], Path | None]
) -> Iterator[Problem]:
    """Yield a problem for each file that is not there; ``files`` are paths by their keys."""
    for key, path in files.items():
        if path is not None and (why := why_no_file(site.resolve(path))):
            message = f"there is no file {site.resolve(path)} ({why})"
            yield source.problem(key, message, "correct the path")
