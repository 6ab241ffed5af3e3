"""FMUs of FMI 3 with what few tools export, of ``sources/odd3.c``; see there."""

from __future__ import annotations

import zipfile
from pathlib import Path

import fmpy

from fmu_models.compilers import compile_library, host_platform
from fmu_models.packing import _header_folder

SOURCES = Path(__file__).with_name("sources")

_VARIABLES = """
<Float64 name="t" valueReference="0" causality="independent" variability="continuous"/>
<Float64 name="time" valueReference="1" causality="output" variability="continuous"/>
<UInt64 name="n" valueReference="2" causality="structuralParameter" variability="fixed" start="3"/>
<Float64 name="u" valueReference="3" causality="input" variability="continuous" start="0 0 0">
<Dimension valueReference="2"/></Float64>
<Float64 name="y" valueReference="4" causality="output" variability="continuous">
<Dimension valueReference="2"/></Float64>
<Float64 name="m" valueReference="5" causality="local" variability="continuous">
<Dimension start="2"/><Dimension start="3"/></Float64>
<Boolean name="flag" valueReference="6" causality="input" variability="discrete" start="false"/>
<Enumeration name="mode" valueReference="7" causality="input" variability="discrete" start="1"
 declaredType="Mode"/>
<Float64 name="x" valueReference="8" causality="output" variability="continuous" initial="exact"
 start="1"/>
<Int32 name="count" valueReference="9" causality="output" variability="discrete"/>
<Binary name="blob" valueReference="10" causality="output"/>
<Clock name="ticks" valueReference="11" causality="output" intervalVariability="triggered"/>
<Float64 name="gain" valueReference="12" causality="parameter" variability="tunable" start="1"/>
<Float64 name="stop_at" valueReference="13" causality="parameter" variability="fixed"
 start="1e9"/>
<Float64 name="der(x)" valueReference="14" causality="local" variability="continuous"
 derivative="8"/>
<Boolean name="low" valueReference="15" causality="output" variability="discrete"/>
<Float64 name="indicator" valueReference="16" causality="local" variability="continuous"/>
<String name="names" valueReference="17" causality="parameter" variability="fixed">
<Dimension start="2"/><Start value="a"/><Start value="b"/></String>
<Binary name="key" valueReference="18" causality="parameter" variability="fixed"><Start value="00"/>
</Binary>
"""


_CLOCKED = """
<Clock name="beat" valueReference="20" causality="input" intervalVariability="constant"
 intervalDecimal="0.5" shiftDecimal="0.25"/>
<Float64 name="held" valueReference="21" causality="output" variability="discrete"/>
<Clock name="alarm" valueReference="22" causality="input" intervalVariability="countdown"/>
<Int32 name="alarms" valueReference="23" causality="output" variability="discrete"/>
<Int32 name="beats" valueReference="24" causality="output" variability="discrete"/>
<Clock name="bell" valueReference="25" causality="input" intervalVariability="triggered"/>
"""


def _description(events: bool, experiment: str) -> str:
    capabilities = 'canGetAndSetFMUState="true" canSerializeFMUState="true"'
    more = 'hasEventMode="true" mightReturnEarlyFromDoStep="true"' if events else ""
    more += ' providesIntermediateUpdate="true"'
    return (
        '<?xml version="1.0"?><fmiModelDescription fmiVersion="3.0" modelName="odd" '
        'instantiationToken="{odd}" generationTool="by hand">'
        f'<ModelExchange modelIdentifier="odd3" {capabilities}/>'
        f'<CoSimulation modelIdentifier="odd3" {capabilities} {more} '
        'canHandleVariableCommunicationStepSize="true"/>'
        '<TypeDefinitions><EnumerationType name="Mode"><Item name="slow" value="1"/>'
        '<Item name="fast" value="2"/></EnumerationType></TypeDefinitions>'
        f"<DefaultExperiment {experiment}/><ModelVariables>{_VARIABLES}</ModelVariables>"
        '<ModelStructure><Output valueReference="1"/><Output valueReference="4"/>'
        '<Output valueReference="8"/><Output valueReference="9"/><Output valueReference="10"/>'
        '<Output valueReference="11"/><Output valueReference="15"/>'
        '<ContinuousStateDerivative valueReference="14"/><InitialUnknown valueReference="1"/>'
        '<InitialUnknown valueReference="4"/><InitialUnknown valueReference="9"/>'
        '<InitialUnknown valueReference="10"/><InitialUnknown valueReference="11"/>'
        '<InitialUnknown valueReference="14"/><InitialUnknown valueReference="15"/>'
        '<EventIndicator valueReference="16"/></ModelStructure></fmiModelDescription>'
    )


def make(folder: Path) -> dict[str, Path]:
    """Build ``plain``, ``events`` (event mode), ``long`` (1e8 s) and ``fixed`` (steps)."""
    suffix = fmpy.sharedLibraryExtension
    library = folder / f"odd3{suffix}"
    compile_library(SOURCES / "odd3.c", (SOURCES, _header_folder()), library, host_platform())
    made: dict[str, Path] = {}
    for key, events, experiment in (
        ("plain", False, 'startTime="0" stopTime="5" stepSize="0.25"'),
        ("events", True, 'startTime="0" stopTime="5" stepSize="0.25"'),
        ("long", False, 'startTime="0" stopTime="1e8"'),
        ("long-own-step", False, 'startTime="0" stopTime="1e8" stepSize="1"'),
    ):
        made[key] = folder / f"{key}.fmu"
        with zipfile.ZipFile(made[key], "w") as archive:
            archive.writestr("modelDescription.xml", _description(events, experiment))
            archive.write(library, f"binaries/{fmpy.platform_tuple}/odd3{suffix}")
    for key, source in (("clocked", "events"), ("clocked-fixed", "events")):
        made[key] = folder / f"{key}.fmu"
        with zipfile.ZipFile(made[source]) as old, zipfile.ZipFile(made[key], "w") as new:
            for name in old.namelist():
                content = old.read(name)
                if name == "modelDescription.xml":
                    content = content.replace(
                        b"</ModelVariables>", _CLOCKED.encode() + b"</ModelVariables>"
                    )
                    if key == "clocked-fixed":
                        content = content.replace(b'StepSize="true"', b'StepSize="false"')
                new.writestr(name, content)
    made["fixed"] = folder / "fixed.fmu"
    with zipfile.ZipFile(made["plain"]) as source, zipfile.ZipFile(made["fixed"], "w") as copy:
        for name in source.namelist():
            content = source.read(name)
            copy.writestr(name, content.replace(b'StepSize="true"', b'StepSize="false"'))
    return made
