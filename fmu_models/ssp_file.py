"""Read a system of FMUs, an ``.ssp`` archive of SSP 1.0 (System Structure and Parameterization).

FMPy checks the schema and reads parameter values and mappings. Connections are read here, because
FMPy drops their transformations and the connectors' units. Systems inside systems are flattened:
what stays is, for every input of every component, the output or system input that feeds it.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from fmpy.ssp import ssd as reader
from lxml import etree

from .archive import MAX_ENTRIES, MAX_EXTRACTED_BYTES
from .errors import PlantFileError
from .ssp_changes import Change, apply_changes
from .ssp_values import SiUnit, Start, find_complaint

__all__ = ["Link", "Master", "SystemStructure", "read_structure", "read_system"]

_NS = reader.ns


Master = Literal["gauss-seidel", "jacobi"]
RUN_TYPE = "fieldlink.run"
"""Type of the annotation that keeps step and master of a recorded run."""


@dataclass(frozen=True, slots=True)
class Link:
    """Where a value comes from, and what happens to it on its way.

    ``component`` is empty for an input or a parameter of the whole system.
    """

    component: str
    name: str
    changes: tuple[Change, ...] = ()

    def convert(self, value: float) -> float:
        """Return the value at this end of the connection."""
        return apply_changes(self.changes, value)

    def invert(self, value: float) -> float | None:
        """Return what must go in to get ``value`` out; None where a table does not say."""
        for change in reversed(self.changes):
            found = change.invert(value)
            if found is None:
                return None
            value = found
        return value


@dataclass(slots=True)
class SystemStructure:
    """A flattened system.

    Attributes:
        file: the archive.
        name: of the system.
        sources: by component (``sub.valve`` inside a system ``sub``), its FMU in the archive.
        starts: by component, start values by variable; by "" those of the system itself.
        unit_of: units of connectors by ``(component, variable)``, where they are defined.
        links: by component and input, what feeds it.
        parameter_links: by component and parameter, which parameter of the system sets it.
        inputs: of the whole system, with units.
        parameters: of the whole system, those that set one of a component.
        outputs: of the whole system, what feeds them.
        ignored: names of start values that no component has a place for.
        start, stop: of the default experiment in seconds, None where not given.
        step, master: of the recorded run that the archive is an export of; None for none.
    """

    file: Path
    name: str
    sources: dict[str, str] = field(default_factory=dict)
    starts: dict[str, dict[str, Start]] = field(default_factory=dict)
    unit_of: dict[tuple[str, str], SiUnit] = field(default_factory=dict)
    links: dict[str, dict[str, Link]] = field(default_factory=dict)
    parameter_links: dict[str, dict[str, Link]] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)
    parameters: tuple[str, ...] = ()
    outputs: dict[str, Link] = field(default_factory=dict)
    ignored: list[str] = field(default_factory=list)
    start: float | None = None
    stop: float | None = None
    step: float | None = None
    master: Master | None = None

    def order(self) -> list[str]:
        """Return the components in the order in which they step.

        A component comes after those that feed it; a loop is begun by the one that is named first.
        """
        left, placed = list(self.sources), []
        while left:
            ready = (
                c
                for c in left
                if all(
                    link.component not in left or link.component == c
                    for link in self.links.get(c, {}).values()
                )
            )
            chosen = next(ready, left[0])
            left.remove(chosen)
            placed.append(chosen)
        return placed


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
    from .ssp_flattening import flatten

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
