"""The systemd unit of one site, from the package's own template.

    unit_of(site, program=Path("/opt/fieldlink/bin/fieldlink"), user="fieldlink").text

A system unit sees a read-only machine and may write the site's data folder and nothing else. A
user's unit runs with the rights that the user has.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from fieldlink.errors import FieldlinkError
from fieldlink.site import Site

__all__ = ["STATE_ROOT", "ServiceUnit", "UnitError", "render_unit", "unit_of"]

STATE_ROOT = Path("/var/lib")
"""Below it systemd itself makes the data folder, with the right owner."""

_HOMES = (Path("/home"), Path("/root"), Path("/run/user"))
_SHARED_TMP = (Path("/tmp"), Path("/var/tmp"))
_ACCOUNT = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,30}")
_PLAIN = re.compile(r"[A-Za-z0-9:_./@%+=,-]+")


class UnitError(FieldlinkError):
    """A site that cannot become a unit."""


@dataclass(frozen=True, slots=True)
class ServiceUnit:
    """A unit.

    Attributes:
        name: the service's name, without ``.service``.
        text: the unit file.
        data_dir: the folder that the daemon writes.
        user: whose rights it has; None for a user's own unit.
        made_by_systemd: whether systemd makes the data folder.
        program: the ``fieldlink`` that it runs.
    """

    name: str
    text: str
    data_dir: Path
    user: str | None
    made_by_systemd: bool
    program: Path

    @property
    def file_name(self) -> str:
        """The name of the unit file."""
        return f"{self.name}.service"


def unit_of(
    site: Site,
    *,
    program: Path,
    user: str | None = "fieldlink",
    name: str | None = None,
    python: Path | None = None,
) -> ServiceUnit:
    """Return the unit of a site.

    Args:
        site: the checked site.
        program: the ``fieldlink`` executable.
        user: the account it runs under; None for a unit of the user who installs it.
        name: the service's name; ``fieldlink-`` and the site's name unless given.
        python: where the Python is that runs the program. A virtual environment in /opt may stand
            on one in somebody's home (pyenv, uv), which the unit must not hide.

    Raises:
        UnitError: a name or a path cannot stand in a unit.
    """
    unit_name = _unit_name(name or f"fieldlink-{site.name}")
    if user is not None and not _ACCOUNT.fullmatch(user):
        raise UnitError(f"{user[:60]!r} is not the name of an account; give one with --run-as")
    data_dir = _absolute(site.data_dir)
    below_state = data_dir.is_relative_to(STATE_ROOT) and data_dir != STATE_ROOT
    made = user is not None and below_state
    writable = [] if made else [data_dir]
    if site.report.folder is not None:
        folder = _absolute(data_dir / site.report.folder)
        if not folder.is_relative_to(data_dir):
            writable.append(folder)
    site_file = _absolute(site.path)
    runs = (program, *(() if python is None else (_absolute(python),)))
    touched = (site_file, data_dir, *runs, *writable)
    at_home = any(path.is_relative_to(home) for path in touched for home in _HOMES)
    in_tmp = any(path.is_relative_to(tmp) for path in touched for tmp in _SHARED_TMP)
    text = render_unit(
        heading=f"# Made by fieldlink service for {_one_line(str(site_file))}",
        title=_escaped(_one_line(site.name)),
        program=_quoted(str(program), in_command=True),
        site=_quoted(str(site_file), in_command=True),
        user=user,
        serial=any(device.serial_port for device in site.devices.values()),
        state_directory=_quoted(str(data_dir.relative_to(STATE_ROOT))) if made else "",
        writable=" ".join(_quoted(str(path)) for path in writable),
        protect_home="read-only" if at_home else "yes",
        private_tmp="no" if in_tmp else "yes",
    )
    return ServiceUnit(unit_name, text, data_dir, user, made, program)


def render_unit(
    *,
    heading: str,
    title: str,
    program: str,
    site: str,
    user: str | None,
    serial: bool,
    state_directory: str,
    writable: str = "",
    protect_home: str = "yes",
    private_tmp: str = "yes",
) -> str:
    """Fill in the template; every value as systemd reads it."""
    return _template().render(
        heading=heading,
        title=title,
        program=program,
        site=site,
        user=user,
        for_user=user is None,
        serial=serial,
        state_directory=state_directory,
        cache="%C/fieldlink",
        writable=writable,
        protect_home=protect_home,
        private_tmp=private_tmp,
    )


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("fieldlink.systemd"),
        undefined=StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    return environment.get_template("fieldlink.service.j2")


def _unit_name(wanted: str) -> str:
    """Return a name that systemd takes: what it does not allow becomes a hyphen."""
    name = re.sub(r"[^A-Za-z0-9:_.-]+", "-", wanted.removesuffix(".service")).strip("-.")
    if not name or len(name) > 200:
        raise UnitError(
            f"a service cannot be named {wanted[:60]!r}; give a name of letters and digits "
            "with --name"
        )
    return name


def _absolute(path: Path) -> Path:
    return path.absolute().resolve()


def _one_line(text: str) -> str:
    if any(not character.isprintable() for character in text):
        raise UnitError(f"{text[:60]!r} holds characters that cannot stand in a unit; rename it")
    return text


def _escaped(text: str) -> str:
    """Return a text in which systemd finds no specifier."""
    return text.replace("%", "%%")


def _quoted(text: str, *, in_command: bool = False) -> str:
    """Return a path as one word of a unit; in a command, $ would begin a variable."""
    escaped = _escaped(_one_line(text))
    if in_command:
        escaped = escaped.replace("$", "$$")
    if _PLAIN.fullmatch(escaped):
        return escaped
    inner = escaped.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{inner}"'
