"""Systems of tanks (SSP 1.0) that the tests put together from elements, connections and values."""

from __future__ import annotations

import zipfile
from pathlib import Path

__all__ = [
    "CHAIN",
    "NAMESPACES",
    "OWN",
    "Minis",
    "binding",
    "bound",
    "component",
    "connection",
    "connector",
    "entry",
    "table",
    "tank",
    "values",
    "write",
]

Minis = dict[str, Path]

NAMESPACES = "".join(
    f' xmlns:{short}="http://ssp-standard.org/SSP1/SystemStructure{long}"'
    for short, long in (
        ("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"),
        ("ssm", "ParameterMapping"),
    )
)  # fmt: skip
UNITS = """<ssd:Units>
<ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit>
<ssc:Unit name="mm"><ssc:BaseUnit m="1" factor="0.001"/></ssc:Unit>
<ssc:Unit name="s"><ssc:BaseUnit s="1"/></ssc:Unit></ssd:Units>"""


def connector(name: str, kind: str, unit: str = "") -> str:
    mark = f' unit="{unit}"' if unit else ""
    return f'<ssd:Connector name="{name}" kind="{kind}"><ssc:Real{mark}/></ssd:Connector>'


def component(name: str, *connectors: str, more: str = "") -> str:
    return (
        f'<ssd:Component name="{name}" source="resources/tank.fmu">'
        f"<ssd:Connectors>{''.join(connectors)}</ssd:Connectors>{more}</ssd:Component>"
    )


def tank(name: str, unit: str = "", more: str = "") -> str:
    inflow = connector("tank.inflow[1]", "input", unit)
    return component(name, inflow, connector("tank.h", "output", "m"), more=more)


def connection(start: str, end: str, more: str = "") -> str:
    ends = []
    for side, text in (("start", start), ("end", end)):
        element, _, name = text.rpartition("/")
        ends.append(f'{side}Element="{element}" ' if element else "")
        ends.append(f'{side}Connector="{name}" ')
    return f"<ssd:Connection {''.join(ends)}>{more}</ssd:Connection>"


def write(
    file: Path, fmu: Path, elements: str, connections: str, *, own: str = "",
    bindings: str = "", extra: dict[str, str] | None = None, enumerations: str = "",
) -> Path:  # fmt: skip
    text = (
        f'<ssd:SystemStructureDescription name="two" version="1.0"{NAMESPACES}>'
        f'<ssd:System name="two"><ssd:Connectors>{own}</ssd:Connectors>{bindings}'
        f"<ssd:Elements>{elements}</ssd:Elements>"
        f"<ssd:Connections>{connections}</ssd:Connections></ssd:System>{enumerations}{UNITS}"
        '<ssd:DefaultExperiment startTime="0" stopTime="4"/></ssd:SystemStructureDescription>'
    )
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("SystemStructure.ssd", text)
        archive.write(fmu, "resources/tank.fmu")
        for name, content in (extra or {}).items():
            archive.writestr(name, content)
    return file


OWN = connector("feed", "input") + connector("level", "output", "m")
CHAIN = (
    connection("feed", "first/tank.inflow[1]")
    + connection("first/tank.h", "second/tank.inflow[1]")
    + connection("second/tank.h", "level")
)


def values(*parameters: str) -> str:
    inside = "".join(
        f'<ssv:Parameter name="{name}">{value}</ssv:Parameter>'
        for name, _, value in (text.partition("=") for text in parameters)
    )
    return (
        f'<ssv:ParameterSet{NAMESPACES} version="1.0" name="p"><ssv:Parameters>{inside}'
        "</ssv:Parameters></ssv:ParameterSet>"
    )


def binding(*parameters: str, mapping: str = "", attributes: str = "") -> str:
    inside = f"<ssd:ParameterValues>{values(*parameters)}</ssd:ParameterValues>"
    if mapping:
        inside += (
            f'<ssd:ParameterMapping><ssm:ParameterMapping{NAMESPACES} version="1.0">{mapping}'
            "</ssm:ParameterMapping></ssd:ParameterMapping>"
        )
    return f"<ssd:ParameterBinding{attributes}>{inside}</ssd:ParameterBinding>"


def bound(*bindings: str) -> str:
    return f"<ssd:ParameterBindings>{''.join(bindings)}</ssd:ParameterBindings>"


def entry(source: str, target: str, change: str) -> str:
    return f'<ssm:MappingEntry source="{source}" target="{target}">{change}</ssm:MappingEntry>'


def table(kind: str, *pairs: tuple[str, str]) -> str:
    entries = "".join(f'<ssc:MapEntry source="{a}" target="{b}"/>' for a, b in pairs)
    return f"<ssc:{kind}MappingTransformation>{entries}</ssc:{kind}MappingTransformation>"
