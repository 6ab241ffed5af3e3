"""Reading a site file: everything is checked at the door, and every error is reported at once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fieldlink.registers import Tag
from fieldlink.site.checked_site import Site
from fieldlink.site.errors import Problem, SiteError
from fieldlink.site.models import SiteFile
from fieldlink.site.node_map import read_node_map
from fieldlink.site.register_map import read_register_map
from fieldlink.site.rules import find_problems
from fieldlink.site.toml_source import TomlSource
from fieldlink.site.validation import validated

__all__ = ["load_site", "schema"]


def load_site(path: str | Path) -> Site:
    """Read a site file and the files it names.

    Raises:
        SiteError: with every problem found, its file, line or key, value and remedy.
    """
    source = TomlSource(Path(path))
    if "sql" in source.data and "site" not in source.data:
        remedy = "give it to fieldlink assess, or name a site file"
        what = "describes a historian's SQL table, and is no site file"
        raise SiteError([Problem(str(source.path), "", what, remedy)])
    file = validated(source, SiteFile)
    maps, problems = _read_maps(source, file)
    site = Site(source.path, file, maps)
    problems.extend(find_problems(site, source))
    if problems:
        raise SiteError(problems)
    return site


def schema() -> dict[str, Any]:
    """Return the JSON Schema of a site file."""
    return SiteFile.model_json_schema()


def _read_maps(
    source: TomlSource, file: SiteFile
) -> tuple[dict[str, Mapping[str, Tag]], list[Problem]]:
    maps: dict[str, Mapping[str, Tag]] = {}
    problems: list[Problem] = []
    for name, device in file.devices.items():
        if device.register_map is None:
            continue
        try:
            path = source.path.parent / device.register_map
            if device.is_opcua:
                maps[name] = read_node_map(path)
                continue
            maps[name] = read_register_map(
                path,
                word_order=device.word_order,
                byte_order=device.byte_order,
            )
        except SiteError as error:
            problems.extend(error.problems)
    return maps, problems
