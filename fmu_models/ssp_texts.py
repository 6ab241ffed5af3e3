"""Texts and binary data of a system of FMUs: start values only, nothing that goes between FMUs."""

from __future__ import annotations

from collections.abc import Mapping

from .errors import PlantFileError
from .ssp_structure import Link, SystemStructure
from .summary import FmuSummary
from .variable_types import LEFT_OUT

__all__ = ["leave_out_texts"]


def leave_out_texts(structure: SystemStructure, parts: Mapping[str, FmuSummary]) -> list[str]:
    """Take the outputs that are not numbers out of a system; return their names.

    Raises:
        PlantFileError: an output that is not a number feeds a component.
    """
    for component, links in structure.links.items():
        for name, link in links.items():
            kind = _kind_of(link, parts)
            if kind in LEFT_OUT:
                raise PlantFileError(
                    f"{structure.file}: {component}: {name} is fed by "
                    f"{link.component}.{link.name}, a variable of the type {kind}; only numbers "
                    "pass between FMUs, remove this connection"
                )
    found = []
    for name, link in structure.outputs.items():
        start = structure.starts.get("", {}).get(link.name) if not link.component else None
        if _kind_of(link, parts) in LEFT_OUT or (start is not None and start.is_text):
            found.append(name)
    for name in found:
        del structure.outputs[name]
    return found


def _kind_of(link: Link, parts: Mapping[str, FmuSummary]) -> str:
    part = parts.get(link.component)
    variable = part.variable(link.name) if part is not None else None
    return variable.type if variable is not None else ""
