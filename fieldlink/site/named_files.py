"""Files that a site file names and that have to exist: certificates, keys, passwords."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from fieldlink.site.checked_site import Site
from fieldlink.site.errors import Problem
from fieldlink.site.toml_source import TomlSource

__all__ = ["find_missing"]


def find_missing(
    site: Site, source: TomlSource, files: Mapping[tuple[str, ...], Path | None]
) -> Iterator[Problem]:
    """Yield a problem for each file that is not there; ``files`` are paths by their keys."""
    for key, path in files.items():
        if path is not None and not site.resolve(path).is_file():
            yield source.problem(key, f"there is no file {site.resolve(path)}", "correct the path")
