"""Putting a unit where systemd finds it, and never overwriting one that was changed."""

from __future__ import annotations

import os
import pwd
import shlex
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from fieldlink.systemd.unit import ServiceUnit, UnitError
from fieldlink.unfinished_file import write_whole

__all__ = ["Installed", "Outcome", "install_unit", "next_commands", "unit_folder"]

SYSTEM_FOLDER = Path("/etc/systemd/system")
"""Where an administrator's units are (systemd.unit(5))."""


class Outcome(Enum):
    """The outcome of an installation."""

    WRITTEN = "written"
    REPLACED = "replaced"
    UNCHANGED = "unchanged"


@dataclass(frozen=True, slots=True)
class Installed:
    """An installed unit: its file, and what was done."""

    file: Path
    outcome: Outcome


def unit_folder(*, for_user: bool) -> Path:
    """Return the folder of units, the system's or that of the user who asks."""
    if not for_user:
        return SYSTEM_FOLDER
    base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(base) / "systemd" / "user"


def install_unit(unit: ServiceUnit, folder: Path, *, replace: bool = False) -> Installed:
    """Write a unit into a folder.

    Raises:
        UnitError: another unit has its name and ``replace`` is not given, or the folder cannot be
            written.
    """
    file = folder / unit.file_name
    try:
        before = file.read_text(encoding="utf-8") if file.exists() else None
        if before == unit.text:
            return Installed(file, Outcome.UNCHANGED)
        if before is not None and not replace:
            raise UnitError(
                f"{file} is there already and differs; compare it with fieldlink service show, "
                "then pass --replace, or give the service another name with --name"
            )
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(file, unit.text.encode())
    except PermissionError as error:
        raise UnitError(
            f"{file} cannot be written by this user; run the command with sudo, or install a unit "
            "of your own with --user"
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        cause = getattr(error, "strerror", None) or "it is not a text"
        raise UnitError(f"{file} cannot be read or written ({cause})") from error
    return Installed(file, Outcome.WRITTEN if before is None else Outcome.REPLACED)


def next_commands(unit: ServiceUnit, site_file: Path) -> list[str]:
    """Return the commands left to type, in order; none of them is run."""
    control = "systemctl" if unit.user is not None else "systemctl --user"
    journal = "journalctl" if unit.user is not None else "journalctl --user"
    folder, file = shlex.quote(str(unit.data_dir)), shlex.quote(str(site_file))
    commands = []
    if unit.user is not None:
        if not _is_user(unit.user):
            commands.append(f"useradd --system --home-dir {folder} {unit.user}")
        if not unit.made_by_systemd:
            commands.append(f"install -d -m 750 -o {unit.user} -g {unit.user} {folder}")
        commands.append(f"sudo -u {unit.user} {shlex.quote(str(unit.program))} check {file}")
    else:
        commands.append("loginctl enable-linger   # so that it runs without a login")
    commands += [
        f"{control} daemon-reload",
        f"{control} enable --now {unit.name}",
        f"{journal} -u {unit.name} -f",
    ]
    return commands


def _is_user(name: str) -> bool:
    try:
        pwd.getpwnam(name)
    except KeyError:
        return False
    return True
