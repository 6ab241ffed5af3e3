"""Describe one FMU from its archive: version, kinds, platforms, variables, warnings."""

from __future__ import annotations

import math
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import ValidationError
from fmpy.validation import validate_fmu

from .archive import (
    KINDS,
    MODEL_EXCHANGE,
    has_sources,
    kinds,
    library_name,
    parse_description,
    platforms,
)
from .arrays import resolve_shape
from .summary import FmuSummary, UnitDefinition, VariableSummary
from .unit_details import UnitDetails, read_unit_details
from .variable_types import LEFT_OUT, is_settable

__all__ = ["summarise_fmu"]

_MOST_PROBLEMS = 20
_MOST_NAMES = 10
_MOST_CHECKED_NAMES = 1000
"""FMPy parses each name by a grammar, 4 ms for one: the names of larger FMUs are not checked."""
_MOST_LETTERS = 300
"""Of a problem: one of FMPy's lists every variable."""


def summarise_fmu(file: Path) -> FmuSummary:
    """Describe one FMU without running anything of it.

    Raises:
        PlantFileError: no such file, not a zip, too large, no model description that can be read.
    """
    description = parse_description(file)
    with zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
    names = [entry.filename for entry in entries]
    offered = kinds(description)
    runnable = [kind for kind in offered if kind in KINDS]
    here = any(library_name(description, kind) in names for kind in runnable)
    experiment = description.defaultExperiment
    details = read_unit_details(file)
    variables = tuple(_variable(v, details) for v in description.modelVariables)
    first = None
    if runnable:
        exchange = runnable[0] == MODEL_EXCHANGE
        first = description.modelExchange if exchange else description.coSimulation
    summary = FmuSummary(
        file=file,
        name=description.modelName,
        fmi_version=description.fmiVersion,
        description=description.description or "",
        tool=" ".join(
            filter(None, (description.generationTool, description.generationDateAndTime))
        ),
        kinds=offered,
        platforms=platforms(names),
        runs_here=here,
        has_sources=has_sources(names),
        bytes=file.stat().st_size,
        extracted_bytes=sum(entry.file_size for entry in entries),
        start_time=_number(experiment, "startTime") or 0.0,
        stop_time=_number(experiment, "stopTime"),
        step_size=_number(experiment, "stepSize"),
        tolerance=_number(experiment, "tolerance"),
        can_restore=bool(first and first.canGetAndSetFMUstate and first.canSerializeFMUstate),
        states=int(description.numberOfContinuousStates or 0),
        units=tuple(_unit(unit, details) for unit in description.unitDefinitions),
        variables=variables,
        warnings=(),
    )
    return _with_warnings(summary, description, first)


def _number(experiment: Any, name: str) -> float | None:
    value = getattr(experiment, name, None) if experiment else None
    return float(value) if value else None


def _variable(variable: Any, details: UnitDetails) -> VariableSummary:
    declared = variable.declaredType
    items = tuple((int(item.value), item.name) for item in declared.items) if declared else ()
    return VariableSummary(
        name=variable.name,
        type=variable.type,
        causality=variable.causality,
        variability=variable.variability,
        unit=variable.unit or (declared.unit if declared else None) or "",
        start=variable.start or "",
        low=variable.min or (declared.min if declared else None) or "",
        high=variable.max or (declared.max if declared else None) or "",
        description=variable.description or "",
        settable=is_settable(variable) or variable.causality == "structuralParameter",
        scalar=not variable.dimensions,
        items=items,
        shape=resolve_shape(variable, {}),
        sized_by=tuple(d.variable.name if d.variable else "" for d in variable.dimensions or ()),
        relative=details.relative.get(
            variable.name, bool(declared is not None and declared.relativeQuantity)
        ),
    )


def _finite(text: Any, default: float) -> float:
    """A number of a unit; the default where it is missing or not a finite number."""
    value = float(text or default)
    return value if math.isfinite(value) else default


def _unit(unit: Any, details: UnitDetails) -> UnitDefinition:
    base = unit.baseUnit
    names = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
    return UnitDefinition(
        name=unit.name,
        dimension=tuple(int(getattr(base, n) or 0) for n in names) if base else (),
        factor=_finite(base.factor, 1.0) if base else 1.0,
        offset=_finite(base.offset, 0.0) if base else 0.0,
        shown=tuple(
            (d.name, _finite(d.factor, 1.0), _finite(d.offset, 0.0))
            for d in unit.displayUnits
            if (unit.name, d.name) not in details.inverse
        ),
    )


def _with_warnings(summary: FmuSummary, description: Any, interface: Any) -> FmuSummary:
    warnings: list[str] = []
    if interface is None:
        warnings.append("it offers neither co-simulation nor model exchange: it cannot be run")
    elif not summary.runs_here:
        hint = (
            "; its sources can be compiled with: fmpy compile FILE" if summary.has_sources else ""
        )
        warnings.append(f"it has no library for this platform ({fmpy.platform_tuple}){hint}")
    if interface is not None and interface.needsExecutionTool:
        warnings.append("it needs the tool that exported it (or its run time) on this machine")
    if summary.kinds == (MODEL_EXCHANGE,):
        warnings.append("it has no solver of its own (model exchange only): CVode integrates it")
    if summary.stop_time is None:
        warnings.append("it names no stop time: give one")
    if not summary.can_restore:
        warnings.append("it offers no serialised state: no snapshots")
    texts = [v.name for v in summary.variables if v.type == "String" and v.settable]
    if texts:
        warnings.append(f"texts that can be given at the start: {_enumerate_some(texts)}")
    for kind, why in LEFT_OUT.items():
        names = [v.name for v in summary.variables if v.type == kind and v.name not in texts]
        if names:
            warnings.append(f"left out, {why}: {_enumerate_some(names)}")
    idle = [
        v.name
        for v in description.modelVariables
        if v.type == "Clock" and v.causality == "input" and v.intervalVariability == "triggered"
    ]
    if idle:
        warnings.append(f"input clocks that nothing triggers here: {_enumerate_some(idle)}")
    if not any(v.causality == "output" for v in summary.variables):
        warnings.append("it has no outputs: name what to watch")
    for v in summary.variables:
        if v.causality == "input" and not v.start:
            warnings.append(f"input {v.name} has no start value: it needs one")
    return replace(summary, warnings=(*warnings, *_problems(summary, description)))


def _shorten(text: str) -> str:
    return text if len(text) <= _MOST_LETTERS else f"{text[:_MOST_LETTERS]} ..."


def _enumerate_some(names: list[str]) -> str:
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(names[:_MOST_NAMES]) + more


def _problems(summary: FmuSummary, description: Any) -> list[str]:
    """Return what FMPy's validation has to say."""
    file = str(summary.file)
    try:
        if len(summary.variables) <= _MOST_CHECKED_NAMES:
            found = validate_fmu(file)
        else:
            found = []
            fmpy.read_model_description(file, validate=True, validate_model_structure=True)
    except ValidationError as error:
        found = list(error.problems)
    except Exception as error:  # noqa: BLE001  FMPy raises nothing narrower; it is shown
        found = [f"it could not be validated: {error}"]
    first = [_shorten(text.splitlines()[0].strip()) for text in found[:_MOST_PROBLEMS]]
    shown = [f"not quite FMI {description.fmiVersion}: {text}" for text in first]
    if len(found) > _MOST_PROBLEMS:
        shown.append(f"and {len(found) - _MOST_PROBLEMS} more of the kind")
    return shown
