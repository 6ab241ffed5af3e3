"""From a model's C file to ``modelDescription.xml``: the table of variables is the single source.

The C compiler expands the rows of ``VARIABLES(X)`` into the model's variables, this module reads
the same rows (`read_model`) and writes the description for FMI 2 and FMI 3 (`describe`).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as ET

from .errors import PlantBuildError

__all__ = ["FmiVersion", "ModelSource", "Variable", "describe", "read_model"]

FmiVersion = Literal[2, 3]

_KINDS = ("input", "output", "fixed", "tunable")
_TYPES = ("Real", "Integer")
_ROW = re.compile(
    r"X\(\s*(?P<name>\w+),\s*(?P<kind>\w+),\s*(?P<type>\w+),\s*(?P<start>[^,]+),\s*(?P<low>[^,]+),"
    r'\s*(?P<high>[^,]+),\s*"(?P<unit>[^"]*)",\s*"(?P<text>[^"]*)"\s*\)'
)
# Exponents of the SI base units and the factor to them; all the units of the catalogue.
_UNITS: dict[str, dict[str, str]] = {
    "%": {"factor": "0.01"},
    "1": {},
    "s": {"s": "1"},
    "m": {"m": "1"},
    "m3/h": {"m": "3", "s": "-1", "factor": repr(1 / 3600)},
    "bar": {"kg": "1", "m": "-1", "s": "-2", "factor": "1e5"},
    "kPa": {"kg": "1", "m": "-1", "s": "-2", "factor": "1e3"},
    "degC": {"K": "1", "offset": "273.15"},
    "K": {"K": "1"},
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "N/m": {"kg": "1", "s": "-2"},
    "N.s/m": {"kg": "1", "s": "-1"},
    "kg": {"kg": "1"},
    "m/s": {"m": "1", "s": "-1"},
    "m2": {"m": "2"},
}


@dataclass(frozen=True, slots=True)
class Variable:
    """A row of a model's table; ``low`` and ``high`` are infinite where there is no bound."""

    name: str
    kind: str
    type: str
    start: float
    low: float
    high: float
    unit: str
    text: str


@dataclass(frozen=True, slots=True)
class ModelSource:
    """What the build reads out of a model's C file."""

    name: str
    file: Path
    description: str
    base_step: float
    default_step: float
    variables: tuple[Variable, ...]


def read_model(file: Path) -> ModelSource:
    """Read the defines and the table of variables of a model's C file.

    Raises:
        PlantBuildError: the file lacks one of them, or a row cannot be read.
    """
    text = file.read_text(encoding="utf-8")
    comment = re.match(r"/\*(.*?)\*/", text, re.DOTALL)
    table = re.search(r"#define VARIABLES\(X\)((?:.*\\\n)*.*)", text)
    if comment is None or table is None:
        raise PlantBuildError(f"{file.name}: no comment at the top, or no VARIABLES(X) table")
    rows = table.group(1)
    variables = tuple(_variable(file, match) for match in _ROW.finditer(rows.replace("\\\n", " ")))
    if not variables or len(variables) != len(re.findall(r"\bX\(", rows)):
        raise PlantBuildError(
            f"{file.name}: a row of VARIABLES cannot be read; the form is "
            'X(name, kind, type, start, low, high, "unit", "text"), without commas in the numbers'
        )
    first_paragraph = re.split(r"\n \*\s*\n", comment.group(1))[0]
    return ModelSource(
        name=_define(text, "MODEL_IDENTIFIER", file),
        file=file,
        description=" ".join(first_paragraph.replace("\n *", " ").split()),
        base_step=float(_define(text, "BASE_STEP", file)),
        default_step=float(_define(text, "DEFAULT_STEP", file)),
        variables=variables,
    )


def _define(text: str, name: str, file: Path) -> str:
    match = re.search(rf"^#define {name} (\S+)$", text, re.MULTILINE)
    if match is None:
        raise PlantBuildError(f"{file.name}: #define {name} is missing")
    return match.group(1)


def _variable(file: Path, match: re.Match[str]) -> Variable:
    if match["kind"] not in _KINDS or match["type"] not in _TYPES:
        raise PlantBuildError(
            f"{file.name}: {match['name']}: kind must be one of {_KINDS} and type one of {_TYPES}; "
            f"got {match['kind']}, {match['type']}"
        )
    if match["unit"] and match["unit"] not in _UNITS:
        raise PlantBuildError(
            f"{file.name}: {match['name']}: unit {match['unit']!r} is not known; add it to "
            "the units of fmu_models/describe.py"
        )
    start, low, high = (_number(match[key]) for key in ("start", "low", "high"))
    return Variable(
        match["name"], match["kind"], match["type"], start, low, high, match["unit"], match["text"]
    )


def _number(text: str) -> float:
    return float(text.strip().replace("ANY", "inf"))


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
        ET.SubElement(ET.SubElement(definitions, "Unit", name=unit), "BaseUnit", _UNITS[unit])


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
