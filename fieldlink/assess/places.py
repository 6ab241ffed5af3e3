"""What the user names, as places: files, folders, site files, descriptions, database addresses."""

from __future__ import annotations

import os
from pathlib import Path

from fieldlink.assess.errors import AssessError
from fieldlink.assess.job import Place
from fieldlink.file_at import why_no_file
from fieldlink.printable import as_text

__all__ = ["place_of"]


def place_of(text: str) -> Place:
    """Return the place that a path or an address names.

    Raises:
        AssessError: there is no such file, or a TOML file is neither a site nor a description.
        SiteError: a TOML file is wrong.
        StoreError: it is not a database address.
    """
    if "://" in text:
        from fieldlink.store.database import shown

        return Place("historian", text, shown(text))
    path, text = Path(text), as_text(text)
    if not os.path.isdir(path) and (why := why_no_file(path)):
        raise AssessError(f"there is no file or folder {text} ({why}); check the path")
    if path.suffix.lower() == ".toml":
        return _described(path, text)
    return Place("files", str(path.absolute()), text)


def _described(path: Path, text: str) -> Place:
    from fieldlink.site.toml_source import TomlSource

    if "sql" in TomlSource(path).data:
        from fieldlink.assess.readers.sql_description import read_description

        return Place("sql", read_description(path).model_dump_json(), text)
    from fieldlink.site import load_site

    site = load_site(path)
    return Place("historian", site.historian_url, site.historian_shown)
