"""Examples of every command, for its ``--help``: what to type next."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["EXAMPLES", "FIRST_STEPS", "PANELS", "examples_of"]

FIRST_STEPS = """\
**What next?**

No plant at hand: `fieldlink demo`

A recorded loop: `fieldlink identify FC101.csv`, and for many `fieldlink assess recordings/`

A PLC: `fieldlink scan 192.168.1.10`, then `fieldlink init vendor.xlsx --host 192.168.1.10` with its
list of registers, `fieldlink check site.toml`, `fieldlink run site.toml`

A running site: `fieldlink status site.toml`, `fieldlink report site.toml`

Completion in the shell: `fieldlink --install-completion`
"""

EXAMPLES: Mapping[str, tuple[str, ...]] = {
    "identify": (
        "identify FC101.csv --plot FC101.png",
        "identify export.csv --op FC101.OUT --pv FC101.PV --period 5",
        "identify FC101.csv --window 1000:3000 --json",
    ),
    "diagnose": (
        "diagnose FC101.csv --plot FC101.png",
        "diagnose recordings/ --json",
        "diagnose site.toml --hours 8",
    ),
    "assess": (
        "assess recordings/ --every 1d --out assessment",
        "assess history.sqlite --since 2026-01-01 --workers 4 --out assessment",
    ),
    "demo": ("demo", "demo --hold 600", "demo --recording FC101.csv --output demo-FC101"),
    "init": (
        "init vendor.xlsx --host 192.168.1.10",
        "init vendor.csv --host 192.168.1.10 --unit 5 --out area1.toml",
        "init map.csv --host 192.168.1.10 --data export.csv --trial",
        "init map.csv --loop FC101=FIC101.OUT,FT101.PV --auto-values 1 --yes",
    ),
    "check": ("check site.toml", "check site.toml --json"),
    "schema": ("schema > site.schema.json",),
    "plant": (
        "plant site.toml",
        "plant site.toml --port 15020 --speed 20",
        "plant site.toml --operator-switch",
    ),
    "run": ("run site.toml", "run site.toml --read-only --duration 3600"),
    "rehearse": ("rehearse", "rehearse NAME --report rehearsal", "rehearse --all --self-test"),
    "simulate": ("simulate example1", "simulate example1 --identified --plot study.png"),
    "compensate": (
        "compensate site.toml --loop FC101",
        "compensate site.toml --loop FC101 --write --duration 3600",
    ),
    "web": ("web site.toml", "web data/history.sqlite --port 8080"),
    "status": ("status site.toml", "status site.toml --json"),
    "events": ("events site.toml --last 20", "events site.toml --follow"),
    "withdraw": ('withdraw site.toml FC101 --reason "valve is being repaired"',),
    "report": (
        "report site.toml",
        "report site.toml --for technician --out list.pdf",
        "report recordings/ --format csv --out list.csv",
        "report history.sqlite --json",
    ),
    "work": (
        "work site.toml",
        'work site.toml FC101 --state planned --owner Meyer --note "next stop"',
        'work site.toml FC101 --state done --at 2026-03-12 --note "packing replaced"',
    ),
    "backup": ("backup site.toml backup.sqlite",),
    "export": (
        "export site.toml --loop FC101 --from 2026-11-21 --out FC101.csv",
        "export site.toml --table estimates --out estimates.parquet",
    ),
    "support-bundle": (
        "support-bundle site.toml --out bundle.zip",
        "support-bundle --out bundle.zip",
    ),
    "service show": ("service show site.toml",),
    "service install": (
        "service install /etc/fieldlink/plant1/site.toml",
        "service install site.toml --user",
    ),
    "scan": (
        "scan 192.168.1.10",
        "scan /dev/ttyUSB0 --units 1-32 --tables holding --baud 9600",
        "scan 192.168.1.10 --out map.csv",
        "scan 192.168.1.10 --first 1000 --last 4999 --thorough",
    ),
    "read": (
        "read site.toml FC101.OP FC101.PV",
        "read 192.168.1.10 holding:104:float32 input:7",
        "read /dev/ttyUSB0 0 1 2 --unit 5",
    ),
    "write": ("write site.toml FC101.SP 42.5", "write 192.168.1.10 holding:104:float32 42.5"),
    "warm-up": ("warm-up",),
    "notify test": ("notify test site.toml", "notify test site.toml --json"),
    "map import": (
        "map import vendor.xlsx --out map.csv",
        "map import vendor.csv --column tag=Typ --addresses modicon",
    ),
    "map export": ("map export site.toml plc --out map.csv",),
    "fmu info": ("fmu info plant.fmu",),
    "fmu run": ("fmu run plant.fmu --stop 600 --out run.csv", "fmu run fourtank --plot run.png"),
    "fmu sweep": ("fmu sweep example1 --runs 100 --random stick_band=4:12 --out sweep.csv",),
    "fmu new": ("fmu new my_plant",),
    "fmu loop": ("fmu loop plant.fmu --op u --pv y --stick-band 4",),
}
"""By command, what follows ``fieldlink``."""


PANELS: Mapping[str, tuple[str, ...]] = {
    "Judge loops": ("identify", "diagnose", "assess", "report", "work"),
    "Set up a site": ("init", "scan", "read", "write", "map", "check", "schema"),
    "Run it": (
        "run",
        "service",
        "web",
        "status",
        "events",
        "withdraw",
        "compensate",
        "backup",
        "export",
        "support-bundle",
        "notify",
        "warm-up",
    ),
    "Try it without a plant": ("demo", "plant", "rehearse", "simulate", "fmu"),
}
"""The sections of the list of commands; a command of none stands under the last heading."""


def examples_of(command: str) -> str | None:
    """Return the examples as Markdown; None for a command without any."""
    lines = EXAMPLES.get(command)
    if not lines:
        return None
    shown = "\n\n".join(f"`fieldlink {line}`" for line in lines)
    return f"**Examples**\n\n{shown}"
