"""What a system of FMUs is, as one: its own inputs and outputs, and its components' variables."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from .ssp_components import extract_components, summarise_components
from .ssp_file import read_system
from .ssp_starts import resolve_starts
from .ssp_structure import SystemStructure
from .ssp_texts import leave_out_texts
from .start_values import StartValue
from .summary import FmuSummary, UnitDefinition, VariableSummary

__all__ = ["summarise_system"]

_WORDS = {"true": "1", "false": "0"}
_SHOWN = ("parameter", "output", "local")


def summarise_system(file: Path) -> FmuSummary:
    """Describe a system without running anything of it.

    A component's variable is ``component.variable``; its inputs are shown as locals when something
    feeds them.

    Raises:
        PlantFileError: the archive, the system or one of its FMUs cannot be read.
    """
    structure = read_system(file)
    with tempfile.TemporaryDirectory(prefix="fieldlink-ssp-") as folder:
        files = extract_components(file, structure.sources, Path(folder))
        parts = summarise_components(file, files)
    left_out = leave_out_texts(structure, parts)
    variables = [
        _variable(name, "input", unit, _input_start(structure, parts, name))
        for name, unit in structure.inputs.items()
    ]
    variables += [_variable(name, "parameter", "") for name in structure.parameters]
    variables += [
        _variable(name, "output", _unit_of(parts, link.component, link.name))
        for name, link in structure.outputs.items()
    ]
    units: dict[str, UnitDefinition] = {}
    order = ", then ".join(structure.order())
    warnings = [
        f"the master is Jacobi, as in the recorded run: {order} step side by side"
        if structure.master == "jacobi"
        else f"one step goes through {order} (Gauss-Seidel)"
    ]
    if left_out:
        warnings.append(f"outputs left out, they are not numbers: {', '.join(left_out)}")
    unknown = list(structure.ignored)
    for component, part in parts.items():
        links = structure.links[component]
        given, ignored = resolve_starts(structure, component, part)
        unknown += ignored
        for v in part.variables:
            role = v.causality if v.causality in _SHOWN else "local"
            start = _shown(given[v.name]) if v.name in given else v.start
            variables.append(replace(v, name=f"{component}.{v.name}", causality=role, start=start))
            if v.causality == "input" and v.name not in links and v.name not in given:
                warnings.append(f"input {component}.{v.name} is fed by nothing")
        units |= {unit.name: unit for unit in part.units}
        warnings += [f"{component}: {text}" for text in part.warnings]
    if unknown:
        warnings.append(f"start values for names that do not exist: {', '.join(unknown)}")
    steps = [part.step_size for part in parts.values() if part.step_size]
    stops = [part.stop_time for part in parts.values() if part.stop_time is not None]
    return FmuSummary(
        file=file,
        name=structure.name,
        fmi_version="SSP 1.0",
        description=", ".join(f"{c}: {part.name}" for c, part in parts.items()),
        tool="",
        kinds=("system of FMUs",),
        platforms=tuple(sorted(set.intersection(*(set(p.platforms) for p in parts.values())))),
        runs_here=all(part.runs_here for part in parts.values()),
        has_sources=all(part.has_sources for part in parts.values()),
        bytes=file.stat().st_size,
        extracted_bytes=sum(part.bytes for part in parts.values()),
        start_time=structure.start or 0.0,
        stop_time=structure.stop if structure.stop is not None else max(stops, default=None),
        step_size=structure.step or min(steps, default=None),
        tolerance=None,
        can_restore=False,
        states=sum(part.states for part in parts.values()),
        units=tuple(units.values()),
        variables=tuple(variables),
        warnings=tuple(warnings),
    )


def _shown(value: StartValue) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def _unit_of(parts: dict[str, FmuSummary], component: str, name: str) -> str:
    found = parts[component].variable(name) if component in parts else None
    return found.unit if found is not None else ""


def _input_start(structure: SystemStructure, parts: dict[str, FmuSummary], name: str) -> str:
    """Return at which value an input of the system stands where none is given.

    It is that of the system, else that of the first component that it feeds.
    """
    given = structure.starts.get("", {}).get(name)
    if given is not None and given.is_text:
        return given.text()
    if given is not None:
        return f"{given.number(structure.unit_of.get(('', name)), {}):g}"
    for component, links in structure.links.items():
        for variable, link in links.items():
            if (link.component, link.name) != ("", name):
                continue
            starts, _ = resolve_starts(structure, component, parts[component])
            described = parts[component].variable(variable)
            own = described.start if described is not None else ""
            if described is not None and described.type == "String":
                return str(starts.get(variable, own))
            inside = starts.get(variable, float(_WORDS.get(own, own)) if own else None)
            value = None if inside is None else link.invert(float(inside))
            if value is not None:
                return f"{value:g}"
    straight = any(not o.component and o.name == name for o in structure.outputs.values())
    return "0" if straight else ""


def _variable(name: str, causality: str, unit: str, start: str = "") -> VariableSummary:
    return VariableSummary(
        name=name,
        type="Real",
        causality=causality,
        variability="continuous",
        unit=unit,
        start=start,
        low="",
        high="",
        description="of the system",
        settable=causality != "output",
        scalar=True,
        items=(),
        shape=(),
        sized_by=(),
    )
