"""FMUs as other tools export them, of ``sources/mini1.c`` and ``mini2.c``: no wrapper of ours."""

from __future__ import annotations

import zipfile
from pathlib import Path

import fmpy

from fmu_models.compilers import compile_library, host_platform
from fmu_models.packing import _header_folder

SOURCES = Path(__file__).with_name("sources")

# name, value reference, type, causality and variability, further attributes; the names are those
# that Dymola, OpenModelica and Simulink write.
ROWS = (
    ("tank.inflow[1]", 0, "Real", "input", "continuous", 'start="0" unit="m3/s"'),
    ("tank.h", 1, "Real", "output", "continuous", 'start="0" unit="m"'),
    ("der(tank.h)", 2, "Real", "local", "continuous", 'unit="m/s"'),
    ("pump.on", 3, "Boolean", "input", "discrete", 'start="{true}"'),
    ("mode", 4, "{enum}", "input", "discrete", 'start="1"'),
    ("alarm", 5, "Boolean", "output", "discrete", ""),
    ("batch", 6, "Integer", "output", "discrete", ""),
    ("fault", 7, "Integer", "parameter", "tunable", 'start="0"'),
    ("label", 8, "String", "parameter", "fixed", 'start=""'),
)

UNITS2 = """<UnitDefinitions>
<Unit name="m"><BaseUnit m="1"/><DisplayUnit name="mm" factor="1000"/></Unit>
<Unit name="m/s"><BaseUnit m="1" s="-1"/></Unit>
<Unit name="m3/s"><BaseUnit m="3" s="-1"/></Unit>
</UnitDefinitions>
<TypeDefinitions><SimpleType name="Mode"><Enumeration>
<Item name="slow" value="1"/><Item name="fast" value="2"/>
</Enumeration></SimpleType></TypeDefinitions>"""


def _variable1(row: tuple[str, int, str, str, str, str]) -> str:
    name, reference, kind, causality, variability, rest = row
    if causality == "parameter":
        causality, variability = "internal", "parameter"
    causality = {"local": "internal"}.get(causality, causality)
    kind = kind.format(enum="Integer")
    rest = "" if causality == "output" else rest.format(true="true")
    return (
        f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}" '
        f'variability="{variability}"><{kind} {rest}/></ScalarVariable>'
    )


def _variable2(row: tuple[str, int, str, str, str, str]) -> str:
    name, reference, kind, causality, variability, rest = row
    kind = kind.format(enum="Enumeration")
    declared = 'declaredType="Mode"' if kind == "Enumeration" else ""
    initial = {"output": 'initial="calculated"', "local": 'initial="calculated"'}.get(causality, "")
    if causality == "output":
        rest = rest.replace('start="0"', "")
        initial = 'initial="exact"' if name == "tank.h" else initial
        rest = f'start="0" {rest}' if name == "tank.h" else rest
    if name == "der(tank.h)":
        rest += ' derivative="2"'
    return (
        f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}" '
        f'variability="{variability}" {initial}><{kind} {declared} {rest.format(true="true")}/>'
        "</ScalarVariable>"
    )


def _description1(exchange: bool) -> str:
    rows = "".join(_variable1(row) for row in ROWS if row[0] != "fault")
    implementation = (
        ""
        if exchange
        else "<Implementation><CoSimulation_StandAlone>"
        '<Capabilities canHandleVariableCommunicationStepSize="true"/>'
        "</CoSimulation_StandAlone></Implementation>"
    )
    return (
        '<?xml version="1.0"?><fmiModelDescription fmiVersion="1.0" modelName="mini" '
        'modelIdentifier="mini1" guid="{mini}" numberOfContinuousStates="1" '
        'numberOfEventIndicators="1" generationTool="by hand">'
        '<UnitDefinitions><BaseUnit unit="m"><DisplayUnitDefinition displayUnit="mm" gain="1000"/>'
        '</BaseUnit></UnitDefinitions><DefaultExperiment startTime="0" stopTime="10"/>'
        f"<ModelVariables>{rows}</ModelVariables>{implementation}</fmiModelDescription>"
    )


def _description2() -> str:
    rows = "".join(_variable2(row) for row in ROWS)
    return (
        '<?xml version="1.0"?><fmiModelDescription fmiVersion="2.0" modelName="mini" '
        'guid="{mini}" numberOfEventIndicators="1" variableNamingConvention="structured" '
        'generationTool="by hand">'
        '<ModelExchange modelIdentifier="mini2" canGetAndSetFMUstate="true" '
        'canSerializeFMUstate="true"/>'
        '<CoSimulation modelIdentifier="mini2" canGetAndSetFMUstate="true" '
        'canSerializeFMUstate="true" canHandleVariableCommunicationStepSize="true"/>'
        f'{UNITS2}<DefaultExperiment startTime="0" stopTime="10" tolerance="1e-8"/>'
        f"<ModelVariables>{rows}</ModelVariables><ModelStructure>"
        '<Outputs><Unknown index="2"/><Unknown index="6"/><Unknown index="7"/></Outputs>'
        '<Derivatives><Unknown index="3"/></Derivatives><InitialUnknowns><Unknown index="6"/>'
        '<Unknown index="7"/></InitialUnknowns></ModelStructure></fmiModelDescription>'
    )


def make(folder: Path) -> dict[str, Path]:
    """Build ``fmi1-cs``, ``fmi1-me`` and ``fmi2`` (both kinds) into ``folder``."""
    made: dict[str, Path] = {}
    suffix = fmpy.sharedLibraryExtension
    for name in ("mini1", "mini2"):
        compile_library(
            SOURCES / f"{name}.c",
            (SOURCES, _header_folder()),
            folder / f"{name}{suffix}",
            host_platform(),
        )
    for key, library, description in (
        ("fmi1-cs", "mini1", _description1(False)),
        ("fmi1-me", "mini1", _description1(True)),
        ("fmi2", "mini2", _description2()),
    ):
        file = folder / f"{key}.fmu"
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("modelDescription.xml", description)
            entry = f"binaries/{fmpy.platform}/{library}{suffix}"
            archive.write(folder / f"{library}{suffix}", entry)
        made[key] = file
    return made
