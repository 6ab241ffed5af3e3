"""From a model's table of variables to ``modelDescription.xml`` for FMI 2 and FMI 3."""

from __future__ import annotations

import math
from typing import Literal
from xml.etree import ElementTree as ET

from .tables import UNITS, ModelSource, Variable

__all__ = ["FmiVersion", "describe"]

FmiVersion = Literal[2, 3]


def describe(model: ModelSource, version: FmiVersion, token: str) -> bytes:
    """Return ``modelDescription.xml`` of ``model`` for FMI ``version``, as UTF-8."""
    root = _fmi2(model, token) if version == 2 else _fmi3(model, token)
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text


def _root(model: ModelSource, version: str, token_name: str, token: str) -> ET.Element:
    return ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": model.name,
            token_name: token,
            "description": model.description,
            "generationTool": "fieldlink",
            "variableNamingConvention": "flat",
        },
    )


def _units(root: ET.Element, model: ModelSource) -> None:
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted({"s"} | {v.unit for v in model.variables if v.unit}):
        ET.SubElement(ET.SubElement(definitions, "Unit", name=unit), "BaseUnit", UNITS[unit])


def _experiment(root: ET.Element, model: ModelSource) -> None:
    ET.SubElement(
        root,
        "DefaultExperiment",
        startTime="0",
        stopTime=repr(1000 * model.default_step),
        stepSize=repr(model.default_step),
    )


def _attributes(variable: Variable) -> dict[str, str]:
    """Return what both versions say of a variable."""
    parameter = variable.kind in ("fixed", "tunable")
    changing = "continuous" if variable.type == "Real" else "discrete"
    return {
        "name": variable.name,
        "causality": "parameter" if parameter else variable.kind,
        "variability": variable.kind if parameter else changing,
        "description": variable.text,
    }


def _values(variable: Variable) -> dict[str, str]:
    """Return unit, bounds and start."""

    def text(value: float) -> str:
        return str(int(value)) if variable.type == "Integer" else repr(value)

    values = {"unit": variable.unit} if variable.unit and variable.type == "Real" else {}
    if math.isfinite(variable.low):
        values["min"] = text(variable.low)
    if math.isfinite(variable.high):
        values["max"] = text(variable.high)
    if variable.kind != "output":
        values["start"] = text(variable.start)
    return values


def _fmi2(model: ModelSource, token: str) -> ET.Element:
    root = _root(model, "2.0", "guid", token)
    simulation = ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=model.name,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    ET.SubElement(ET.SubElement(simulation, "SourceFiles"), "File", name=model.file.name)
    _units(root, model)
    _experiment(root, model)
    variables = ET.SubElement(root, "ModelVariables")
    structure = ET.SubElement(root, "ModelStructure")
    outputs = ET.SubElement(structure, "Outputs")
    unknowns = ET.SubElement(structure, "InitialUnknowns")
    for index, variable in enumerate(model.variables, start=1):
        attributes = _attributes(variable) | {"valueReference": str(index)}
        if variable.kind == "output":
            attributes["initial"] = "calculated"
            ET.SubElement(outputs, "Unknown", index=str(index))
            ET.SubElement(unknowns, "Unknown", index=str(index))
        scalar = ET.SubElement(variables, "ScalarVariable", attributes)
        ET.SubElement(scalar, variable.type, _values(variable))
    return root


def _fmi3(model: ModelSource, token: str) -> ET.Element:
    root = _root(model, "3.0", "instantiationToken", token)
    ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=model.name,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        fixedInternalStepSize=repr(model.base_step),
    )
    _units(root, model)
    _experiment(root, model)
    variables = ET.SubElement(root, "ModelVariables")
    ET.SubElement(
        variables,
        "Float64",
        name="time",
        valueReference="0",
        causality="independent",
        variability="continuous",
        unit="s",
        description="simulated time",
    )
    structure = ET.SubElement(root, "ModelStructure")
    outputs = [i for i, v in enumerate(model.variables, start=1) if v.kind == "output"]
    for index, variable in enumerate(model.variables, start=1):
        attributes = _attributes(variable) | {"valueReference": str(index)}
        if variable.kind == "output":
            attributes["initial"] = "calculated"
        tag = "Float64" if variable.type == "Real" else "Int32"
        ET.SubElement(variables, tag, attributes | _values(variable))
    for tag in ("Output", "InitialUnknown"):
        for index in outputs:
            ET.SubElement(structure, tag, valueReference=str(index))
    return root
