"""Build the example of a system of FMUs: ``python -m fmu_models.example_system --output .``

Controller, sticky valve and process are an FMU each; ``loop.ssp`` connects them. It is the same
loop as ``example1`` with its controller inside and without noise.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import zipfile
from pathlib import Path

from .errors import PlantBuildError
from .packing import build_source
from .tables import SOURCES

__all__ = ["build_example_system", "main"]

_MODELS = ("loop_controller", "loop_valve", "loop_process")
_STRUCTURE = """\
<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription name="loop" version="1.0"
 xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
 xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
<ssd:System name="loop">
<ssd:Connectors>
<ssd:Connector name="sp" kind="input"><ssc:Real/></ssd:Connector>
<ssd:Connector name="op" kind="output"><ssc:Real unit="%"/></ssd:Connector>
<ssd:Connector name="pv" kind="output"><ssc:Real/></ssd:Connector>
<ssd:Connector name="stem" kind="output"><ssc:Real unit="%"/></ssd:Connector>
</ssd:Connectors>
<ssd:Elements>
<ssd:Component name="controller" source="resources/loop_controller.fmu">
<ssd:Connectors>
<ssd:Connector name="pv" kind="input"><ssc:Real/></ssd:Connector>
<ssd:Connector name="sp" kind="input"><ssc:Real/></ssd:Connector>
<ssd:Connector name="op" kind="output"><ssc:Real unit="%"/></ssd:Connector>
</ssd:Connectors>
<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>
<ssv:ParameterSet version="1.0" name="start"><ssv:Parameters>
<ssv:Parameter name="op_start"><ssv:Real value="40"/></ssv:Parameter>
<ssv:Parameter name="pv"><ssv:Real value="40"/></ssv:Parameter>
</ssv:Parameters></ssv:ParameterSet>
</ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>
</ssd:Component>
<ssd:Component name="valve" source="resources/loop_valve.fmu">
<ssd:Connectors>
<ssd:Connector name="op" kind="input"><ssc:Real unit="%"/></ssd:Connector>
<ssd:Connector name="stem" kind="output"><ssc:Real unit="%"/></ssd:Connector>
</ssd:Connectors>
</ssd:Component>
<ssd:Component name="process" source="resources/loop_process.fmu">
<ssd:Connectors>
<ssd:Connector name="stem" kind="input"><ssc:Real unit="%"/></ssd:Connector>
<ssd:Connector name="pv" kind="output"><ssc:Real/></ssd:Connector>
</ssd:Connectors>
</ssd:Component>
</ssd:Elements>
<ssd:Connections>
<ssd:Connection startConnector="sp" endElement="controller" endConnector="sp"/>
<ssd:Connection startElement="process" startConnector="pv"
 endElement="controller" endConnector="pv"/>
<ssd:Connection startElement="controller" startConnector="op" endElement="valve" endConnector="op"/>
<ssd:Connection startElement="valve" startConnector="stem"
 endElement="process" endConnector="stem"/>
<ssd:Connection startElement="controller" startConnector="op" endConnector="op"/>
<ssd:Connection startElement="process" startConnector="pv" endConnector="pv"/>
<ssd:Connection startElement="valve" startConnector="stem" endConnector="stem"/>
</ssd:Connections>
</ssd:System>
<ssd:DefaultExperiment startTime="0" stopTime="1000"/>
</ssd:SystemStructureDescription>
"""


def build_example_system(folder: Path) -> Path:
    """Build the three FMUs (FMI 3) and put them into ``loop.ssp``; return its path.

    Raises:
        PlantBuildError: no compiler, or the folder cannot be written.
    """
    target = folder / "loop.ssp"
    with tempfile.TemporaryDirectory(prefix="fieldlink-ssp-") as work:
        built = {
            name: build_source(SOURCES / "loop" / f"{name}.c", output=Path(work))[-1]
            for name in _MODELS
        }
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
                archive.writestr("SystemStructure.ssd", _STRUCTURE)
                for name, fmu in built.items():
                    archive.write(fmu, f"resources/{name}.fmu")
        except OSError as error:
            raise PlantBuildError(
                f"{target}: it cannot be written ({error.strerror}); "
                "check the folder and the free space"
            ) from error
    return target


def main(arguments: list[str] | None = None) -> int:
    """Build the example; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m fmu_models.example_system", description=main.__doc__
    )
    parser.add_argument("--output", type=Path, default=Path(), help="folder of loop.ssp")
    options = parser.parse_args(arguments)
    try:
        print(build_example_system(options.output))
    except PlantBuildError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
