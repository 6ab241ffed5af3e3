"""What is wrong with the plants of a site file, found before any of them is started.

The site's own rules know no FMU. Here each is opened as far as its archive goes: name or file,
library for this machine, variables of its loops, start values, and the controllers before it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from fieldlink.lab.plc.build import LoopSetup, PlcError
from fieldlink.site import Site
from fieldlink.site.errors import Problem, SiteError
from fieldlink.site.toml_source import Key, TomlSource
from fmu_models import PlantError, PlantInfo, StartValue, preview_plant

__all__ = ["check_plants"]


def check_plants(site: Site) -> None:
    """Check every FMU that a site file names, and the loops on it.

    Raises:
        SiteError: with every problem, its line, key and remedy.
    """
    source = TomlSource(site.path)
    problems = [
        problem
        for name, loop in site.loops.items()
        if loop.plant is not None and loop.plant.fmu is not None
        for problem in _plant_problems(source, LoopSetup.of(site, name))
    ]
    if problems:
        raise SiteError(problems)


def _plant_problems(source: TomlSource, owner: LoopSetup) -> Iterator[Problem]:
    table: Key = ("loops", owner.name, "plant")
    try:
        info = _preview(owner, {})
    except PlantError as error:
        yield _problem(source, (*table, "fmu"), error)
        return
    whole = True
    for setup in owner.sharing():
        for role, missing in setup.missing_variables(info).items():
            whole = False
            yield _problem(source, ("loops", setup.name, "plant", "variables", role), missing)
        if setup.settings.controller_kind == "fmu":
            continue
        try:
            setup.op_source()
        except PlcError as error:
            text = str(error).removeprefix(f"loop {setup.name}: ")
            yield _problem(source, ("loops", setup.name, "plant", "controller"), text)
    if whole:
        yield from _parameter_problems(source, (*table, "parameters"), owner)


def _parameter_problems(source: TomlSource, key: Key, owner: LoopSetup) -> Iterator[Problem]:
    """The start values together, since elements of an array belong together; then one by one."""
    try:
        _preview(owner, owner.start_values())
    except PlantError as error:
        alone = list(_single_problems(source, key, owner))
        yield from alone or [_problem(source, key, error)]


def _single_problems(source: TomlSource, key: Key, owner: LoopSetup) -> Iterator[Problem]:
    for name, value in owner.settings.parameters.items():
        try:
            _preview(owner, {name: value})
        except PlantError as error:
            yield _problem(source, (*key, name), error)


def _preview(owner: LoopSetup, parameters: Mapping[str, StartValue]) -> PlantInfo:
    return preview_plant(owner.model, period=owner.loop.period, parameters=parameters)


def _problem(source: TomlSource, key: Key, said: object) -> Problem:
    message, _, remedy = str(said).partition("; ")
    return source.problem(key, message, remedy or "correct it")
