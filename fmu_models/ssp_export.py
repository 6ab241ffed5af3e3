"""Write a run as a system (SSP 1.0) that repeats it: FMUs, start values, experiment, what came out.

    export_run(summarise(Path("tank.fmu")), Path("tank.ssp"), RunExport({"k": 2.0}, 0.0, 60.0, 1.0))

An ``.ssp`` is copied, with the start values of the run bound to the whole system, where they win
over its own. A single FMU becomes a system of one component. The step and the master stand in an
annotation, which other tools skip; recordings lie in ``extra/fieldlink``.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fmpy.ssp import ssd as reader
from lxml import etree

from .errors import PlantError
from .ssp_file import RUN_TYPE, read_structure
from .ssp_structure import Master
from .start_values import StartValue
from .summary import FmuSummary, VariableSummary

__all__ = ["RunExport", "export_run"]

_NS = reader.ns
_STRUCTURE = "SystemStructure.ssd"
_FOLDER = "extra/fieldlink"
_DIMENSIONS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True, slots=True)
class RunExport:
    """What was run.

    Attributes:
        start_values: that were given, by variable, in its own unit.
        start, stop, step: seconds.
        master: of a system; None for one FMU.
        recordings: contents of further files by name, such as the table of the run.
    """

    start_values: Mapping[str, StartValue]
    start: float
    stop: float
    step: float
    master: Master | None = None
    recordings: Mapping[str, bytes] = field(default_factory=dict)


def export_run(fmu: FmuSummary, target: Path, run: RunExport) -> None:
    """Write a system that repeats a run.

    Args:
        fmu: of the FMU or system that was run.
        target: the ``.ssp`` to write.
        run: what was run.

    Raises:
        PlantError: the file cannot be written.
    """
    is_system = fmu.file.suffix == ".ssp"
    component = "".join(c if c.isalnum() else "_" for c in fmu.name) or "fmu"
    resource = f"resources/{fmu.file.stem}.fmu"
    root = read_structure(fmu.file) if is_system else _wrap(fmu, component, resource)
    prefix = "" if is_system else f"{component}."
    _bind(root.find("ssd:System", _NS), fmu, run.start_values, prefix)
    _note_experiment(root, run)
    etree.cleanup_namespaces(root)
    content = etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
    try:
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(_STRUCTURE, content)
            if is_system:
                with zipfile.ZipFile(fmu.file) as source:
                    for name in source.namelist():
                        if name != _STRUCTURE and not name.startswith(f"{_FOLDER}/"):
                            archive.writestr(name, source.read(name))
            else:
                archive.write(fmu.file, resource)
            for name, recording in run.recordings.items():
                archive.writestr(f"{_FOLDER}/{name}", recording)
    except OSError as error:
        raise PlantError(
            f"{target}: it cannot be written ({error.strerror}); "
            "check the folder and the free space"
        ) from error


def _tag(short: str, name: str) -> str:
    return f"{{{_NS[short]}}}{name}"


def _add(parent: Any, short: str, tag: str, /, **attributes: str) -> Any:
    return etree.SubElement(parent, _tag(short, tag), attributes)


def _wrap(fmu: FmuSummary, component: str, resource: str) -> Any:
    """Return the structure of a system with one component and the same inputs and outputs."""
    root = etree.Element(
        _tag("ssd", "SystemStructureDescription"), nsmap=_NS, name=fmu.name, version="1.0"
    )
    system = _add(root, "ssd", "System", name=fmu.name)
    shown = [v for v in fmu.variables if v.causality in ("input", "output") and _kind(v)]
    own = _add(system, "ssd", "Connectors")
    elements = _add(system, "ssd", "Elements")
    element = _add(elements, "ssd", "Component", name=component, source=resource)
    inner = _add(element, "ssd", "Connectors")
    connections = _add(system, "ssd", "Connections")
    for v in shown:
        for place in (own, inner):
            connector = _add(place, "ssd", "Connector", name=v.name, kind=v.causality)
            _declare(connector, v)
        inside = "endElement" if v.causality == "input" else "startElement"
        names = {"startConnector": v.name, "endConnector": v.name}
        _add(connections, "ssd", "Connection", **{inside: component}, **names)
    enumerations = [v for v in shown if v.items]
    if enumerations:
        place = _add(root, "ssd", "Enumerations")
        for v in enumerations:
            found = _add(place, "ssc", "Enumeration", name=v.name)
            for value, item in v.items:
                _add(found, "ssc", "Item", name=item, value=str(value))
    used = {v.unit for v in shown}
    units = [unit for unit in fmu.units if unit.name in used and unit.dimension]
    if units:
        place = _add(root, "ssd", "Units")
        for unit in units:
            base = {n: str(e) for n, e in zip(_DIMENSIONS, unit.dimension, strict=True) if e}
            base |= {"factor": repr(unit.factor), "offset": repr(unit.offset)}
            _add(_add(place, "ssc", "Unit", name=unit.name), "ssc", "BaseUnit", **base)
    defined = {unit.name for unit in units}
    for declared in root.iter(_tag("ssc", "Real")):
        if declared.get("unit") not in defined:
            declared.attrib.pop("unit", None)
    return root


def _kind(variable: VariableSummary) -> str:
    """Return SSP's type of a variable; empty for arrays, text and binary data, which have none."""
    if not variable.scalar:
        return ""
    if variable.type in ("Real", "Float64", "Float32"):
        return "Real"
    if variable.type in ("Boolean", "Enumeration"):
        return variable.type
    return "Integer" if "Int" in variable.type else ""


def _declare(connector: Any, variable: VariableSummary) -> None:
    kind = _kind(variable)
    attributes = {}
    if kind == "Real" and variable.unit:
        attributes["unit"] = variable.unit
    if kind == "Enumeration":
        attributes["name"] = variable.name
    _add(connector, "ssc", kind, **attributes)


def _bind(system: Any, fmu: FmuSummary, values: Mapping[str, StartValue], prefix: str) -> None:
    """Bind start values to the whole system, after the bindings that it has."""
    if not values:
        return
    bindings = system.find("ssd:ParameterBindings", _NS)
    if bindings is None:
        bindings = etree.Element(_tag("ssd", "ParameterBindings"))
        before = [
            c for c in system if etree.QName(c).localname in ("Connectors", "ElementGeometry")
        ]
        system.insert(len(before), bindings)
    place = _add(_add(bindings, "ssd", "ParameterBinding"), "ssd", "ParameterValues")
    known = _add(place, "ssv", "ParameterSet", version="1.0", name="recorded run")
    parameters = _add(known, "ssv", "Parameters")
    for name, value in values.items():
        parameter = _add(parameters, "ssv", "Parameter", name=prefix + name)
        _put_value(parameter, fmu.variable(name), value)


def _put_value(parameter: Any, variable: VariableSummary | None, value: StartValue) -> None:
    items = dict(variable.items) if variable is not None else {}
    if isinstance(value, str):
        _add(parameter, "ssv", "Enumeration" if value in items.values() else "String", value=value)
    elif int(value) in items:
        _add(parameter, "ssv", "Enumeration", value=items[int(value)])
    elif variable is not None and variable.type == "Boolean":
        _add(parameter, "ssv", "Boolean", value="true" if value else "false")
    else:
        _add(parameter, "ssv", "Real", value=repr(float(value)))


def _note_experiment(root: Any, run: RunExport) -> None:
    experiment = root.find("ssd:DefaultExperiment", _NS)
    if experiment is None:
        experiment = etree.Element(_tag("ssd", "DefaultExperiment"))
        before = [
            c for c in root if etree.QName(c).localname in ("System", "Enumerations", "Units")
        ]
        root.insert(len(before), experiment)
    experiment.set("startTime", repr(run.start))
    experiment.set("stopTime", repr(run.stop))
    annotations = experiment.find("ssd:Annotations", _NS)
    if annotations is None:
        annotations = _add(experiment, "ssd", "Annotations")
    for old in annotations.findall(f"ssc:Annotation[@type='{RUN_TYPE}']", _NS):
        annotations.remove(old)
    note = _add(annotations, "ssc", "Annotation", type=RUN_TYPE)
    step = {"step": repr(run.step)} | ({"master": run.master} if run.master else {})
    etree.SubElement(note, "run", step)
