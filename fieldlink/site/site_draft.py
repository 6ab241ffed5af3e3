"""A first site file as text: one Modbus device, loops whose tags are known, write-back off."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from fieldlink.registers import Tag
from fieldlink.site.errors import Problem, SiteError
from fieldlink.site.loop_proposal import ROLES
from fieldlink.site.map_export import map_as_csv
from fieldlink.unfinished_file import created, remove_unfinished

__all__ = ["PLACEHOLDER", "SiteDraft", "map_path_of", "refuse_existing"]

PLACEHOLDER = "192.0.2.10"
"""Host of a site file whose PLC is not known yet: an address for examples (RFC 5737)."""

_BARE = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True, slots=True)
class SiteDraft:
    """What a first site file says.

    Attributes:
        path: the site file; the register map is beside it.
        loops: loop to role to tag.
        host, port, unit: the PLC.
        period: seconds between samples.
        auto_values: values of a mode tag that mean automatic.
        source: the file that the tags are from.
    """

    path: Path
    loops: Mapping[str, Mapping[str, str]]
    host: str
    port: int
    unit: int
    period: float
    auto_values: tuple[float, ...]
    source: str

    def write(self, tags: Mapping[str, Tag]) -> None:
        """Write the map (the loops' tags, none of them writable) and the site file.

        Raises:
            SiteError: a file exists or cannot be written.
        """
        used = dict.fromkeys(tag for roles in self.loops.values() for tag in roles.values())
        kept = [replace(tags[name], writable=False) for name in used]
        map_path = map_path_of(self.path)
        refuse_existing(self.path, map_path)
        _create(map_path, map_as_csv(kept))
        try:
            _create(self.path, self.text)
        except SiteError:
            # The map alone would stand in the way of the next attempt.
            remove_unfinished(map_path)
            raise

    @property
    def text(self) -> str:
        """The site file."""
        lines = [
            f"# Made by fieldlink init from {_comment(self.source)}. Every key: fieldlink schema",
            "",
            "[site]",
            f"name = {_quote(self.path.stem)}",
            "",
            "[devices.plc]",
            'link = "modbus-tcp"',
            f"host = {_quote(self.host)}",
            f"port = {self.port}",
            f"unit = {self.unit}",
            f"register_map = {_quote(map_path_of(self.path).name)}",
        ]
        for name, roles in self.loops.items():
            key = name if _BARE.fullmatch(name) else _quote(name)
            lines += ["", f"[loops.{key}]", 'device = "plc"']
            lines += [f"{role} = {_quote(roles[role])}" for role in ROLES if role in roles]
            if "mode" in roles:
                values = ", ".join(f"{value:.15g}" for value in self.auto_values)
                lines.append(f"auto_values = [{values}]")
            lines.append(f"period = {self.period!r}")
            lines.append("writeback = { enabled = false }")
        return "\n".join(lines) + "\n"


def map_path_of(site: Path) -> Path:
    """Return the file of the register map beside a new site file.

    Raises:
        SiteError: the path has no name of a file, as ``.`` has none.
    """
    if site.name in ("", ".."):
        raise SiteError([Problem(str(site), "", "is a folder", "name a new file with --out")])
    return site.with_name(f"{site.stem}-map.csv")


def refuse_existing(*paths: Path) -> None:
    """Raise SiteError for the files that exist."""
    problems = [
        Problem(str(path), "", "the file exists", "choose another name with --out")
        for path in paths
        if os.path.exists(path)
    ]
    if problems:
        raise SiteError(problems)


def _create(path: Path, text: str) -> None:
    try:
        with created(path) as file:
            file.write(text)
    except OSError as error:
        message = f"cannot be written ({error.strerror or error})"
        raise SiteError([Problem(str(path), "", message, "choose another path")]) from error


def _quote(text: str) -> str:
    """Return a basic string of TOML, whose escapes are those of JSON."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _comment(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)
