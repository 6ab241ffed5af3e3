"""The site that stands for a scenario: written as files, so that it passes the door of every site.

The same two files, with another link, connect the daemon to a real PLC of that layout.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

from fieldlink.lab.rehearse.models import Scenario
from fieldlink.site import Site, SiteError, load_site

__all__ = ["DEVICE", "LOOP", "write_site"]

DEVICE, LOOP = "plc", "LOOP"


def write_site(scenario: Scenario, file: Path, folder: Path) -> Site:
    """Write the site of a scenario into a folder and load it.

    Args:
        scenario: the scenario.
        file: where it was read; paths in it are relative to that.
        folder: for ``site.toml`` and ``registers.csv``.

    Raises:
        SiteError: what the scenario asks for makes no site, with the place and the remedy.
    """
    registers = (files("fieldlink.lab.rehearse") / "templates" / "registers.csv").read_text("utf-8")
    (folder / "registers.csv").write_text(registers, "utf-8")
    (folder / "site.toml").write_text(_site(scenario, file), "utf-8")
    try:
        return load_site(folder / "site.toml")
    except SiteError as error:
        # The file that the user has, not one that is gone by then.
        problems = [replace(problem, file=str(file), line=None) for problem in error.problems]
        raise SiteError(problems) from error


def _site(scenario: Scenario, file: Path) -> str:
    daemon, controller, plant = scenario.daemon, scenario.controller, scenario.plant
    loop: dict[str, object] = {
        "device": DEVICE,
        **{role: f"{LOOP}.{role.upper()}" for role in ("op", "pv", "sp", "mode", "scan")},
        "period": plant.period,
        "window": daemon.window,
    }
    if daemon.estimate_every is not None:
        loop["estimate_every"] = daemon.estimate_every
    own = plant.fmu.endswith((".fmu", ".ssp"))
    hosted: dict[str, object] = {
        "fmu": str((file.parent / plant.fmu).resolve()) if own else plant.fmu,
        "controller": controller.kind,
        "compensate": controller.compensate,
        "seed": scenario.scenario.seed,
        "parameters": dict(plant.parameters),
        "variables": plant.variables.model_dump(include={"op", "op_scale", "pv", "stem"}),
    }
    if controller.kind == "pi":
        hosted["pi"] = {"gain": controller.gain, "integral_time": controller.integral_time}
    tables: dict[str, Mapping[str, object]] = {
        "site": {"name": scenario.scenario.title},
        # a rehearsal is about the write-back; why its one loop swings is known
        "findings": {"enabled": False},
        f"devices.{DEVICE}": {"link": "fmu", "register_map": "registers.csv"},
        f"loops.{LOOP}": loop,
        f"loops.{LOOP}.estimator": {"criterion": daemon.criterion},
        f"loops.{LOOP}.writeback": {
            "enabled": daemon.write_back,
            "loop_id": 1,
            "base": 100,
            "limits": {"stick_band": daemon.stick_band, "slip_jump": daemon.slip_jump},
            "deadband": daemon.deadband,
            "min_interval": daemon.min_interval,
            "valid_for": daemon.valid_for,
            "min_windows": daemon.min_windows,
        },
        f"loops.{LOOP}.plant": hosted,
    }
    return "\n".join(_table(name, content) for name, content in tables.items())


def _table(name: str, content: Mapping[str, object]) -> str:
    return "\n".join([f"[{name}]", *(f"{k} = {_value(v)}" for k, v in content.items()), ""])


def _value(value: object) -> str:
    """TOML of plain values; what JSON and TOML write alike is left to JSON."""
    if isinstance(value, Mapping):
        pairs = ", ".join(f"{json.dumps(k)} = {_value(v)}" for k, v in value.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    return json.dumps(value)
