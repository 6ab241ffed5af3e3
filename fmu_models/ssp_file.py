"""Read a system of FMUs, an ``.ssp`` archive of SSP 1.0 (System Structure and Parameterization).

FMPy checks the schema and reads parameter values and mappings. Connections are read here, because
FMPy drops their transformations and the connectors' units. Systems inside systems are flattened:
what stays is, for every input of every component, the output or system input that feeds it.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

from fmpy.ssp import ssd as reader
from lxml import etree

from .archive import MAX_ENTRIES, MAX_EXTRACTED_BYTES
from .errors import PlantFileError
from .ssp_flattening import flatten
from .ssp_structure import SystemStructure
from .ssp_values import find_complaint

__all__ = ["RUN_TYPE", "read_structure", "read_system"]

_NS = reader.ns

_MAY_BE_EMPTY = ("Connectors", "Connections", "Elements", "ParameterBindings")
RUN_TYPE = "fieldlink.run"
"""Type of the annotation that keeps step and master of a recorded run."""


def read_structure(file: Path) -> Any:
    """Return the root of ``SystemStructure.ssd``, checked against the schema.

    Raises:
        PlantFileError: no SSP archive, or not valid.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            entries = archive.infolist()
            if (
                sum(e.file_size for e in entries) > MAX_EXTRACTED_BYTES
                or len(entries) > MAX_ENTRIES
            ):
                raise PlantFileError(f"{file}: it would extract to more than 1024 MB")
            parser = etree.XMLParser(resolve_entities=False, no_network=True)
            root = etree.fromstring(archive.read("SystemStructure.ssd"), parser)
    except (OSError, KeyError, zipfile.BadZipFile, etree.XMLSyntaxError) as error:
        why = error.strerror if isinstance(error, OSError) else error.args[0]
        raise PlantFileError(
            f"{file}: it is not an SSP archive (a zip file with SystemStructure.ssd): {why}"
        ) from error
    for name in _MAY_BE_EMPTY:  # the schema wants them left out, some tools write them empty
        for element in list(root.iter(f"{{{_NS['ssd']}}}{name}")):
            if len(element) == 0:
                element.getparent().remove(element)
    try:
        reader.validate_tree(root, "SystemStructureDescription.xsd")
    except Exception as error:  # FMPy raises nothing narrower
        what = find_complaint(error)
        raise PlantFileError(f"{file}: SystemStructure.ssd is not valid SSP 1.0: {what}") from error
    return root


def read_system(file: Path) -> SystemStructure:
    """Read and flatten a system; nothing of its FMUs is run.

    Raises:
        PlantFileError: no SSP archive, not valid, or it uses what is not supported; the place and
            the reason are named.
    """
    root = read_structure(file)
    system = root.find("ssd:System", _NS)
    structure = SystemStructure(file, system.get("name") or root.get("name"))
    experiment = root.find("ssd:DefaultExperiment", _NS)
    if experiment is not None:
        structure.start = _number(experiment.get("startTime"))
        structure.stop = _number(experiment.get("stopTime"))
        for note in experiment.iterfind(f"*/ssc:Annotation[@type='{RUN_TYPE}']/*", _NS):
            structure.step = _number(note.get("step"))
            structure.master = "jacobi" if note.get("master") == "jacobi" else "gauss-seidel"
    flatten(root, structure)
    return structure


def _number(text: str | None) -> float | None:
    return None if text is None else float(text)
