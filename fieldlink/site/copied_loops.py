"""What copy and paste leaves behind: one tag in two roles, one pair of tags in two loops.

All of it can be meant (two controllers on one valve for a time), so these are warnings.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from fieldlink.registers import DataType, Tag
from fieldlink.site.checked_site import Site
from fieldlink.site.folded_warnings import Warned, fold, shown
from fieldlink.site.models import Loop

__all__ = ["find_copies"]

_FLOATS = (DataType.FLOAT32, DataType.FLOAT64)


def find_copies(site: Site) -> Iterator[str]:
    """Yield a sentence for what looks like copies, and for each kind of tag in the wrong place."""
    pairs: dict[tuple[str, str, str], list[str]] = {}
    names: dict[str, list[str]] = {}
    for name, loop in site.loops.items():
        pairs.setdefault((loop.device, loop.op, loop.pv), []).append(name)
        names.setdefault(name.casefold(), []).append(name)
    for (device, op, pv), (first, *copies) in pairs.items():
        if copies:
            which = f"{copies[0]} was copied, correct its tags"
            if len(copies) > 1:
                which = "they were copied, correct the tags of all but one"
            yield (
                f"loops {_listed(first, copies)}: {_all(copies)} have OP {op} and PV {pv} of "
                f"device {device}: if {which}"
            )
    for first, *others in names.values():
        if others:
            yield (
                f"loops {_listed(first, others)}: their names differ in case only, and are easily "
                "confused: rename one"
            )
    yield from fold(
        warned
        for name, loop in site.loops.items()
        for warned in _roles(name, loop, site.maps.get(loop.device, {}))
    )


def _listed(first: str, others: list[str]) -> str:
    return f"{first} and {others[0]}" if len(others) == 1 else shown([first, *others])


def _all(copies: list[str]) -> str:
    return "both" if len(copies) == 1 else "all"


def _roles(name: str, loop: Loop, tags: Mapping[str, Tag]) -> Iterator[Warned]:
    taken = {loop.op: "OP", loop.pv: "PV"}
    for role in ("sp", "mode", "scan"):
        tag: str | None = getattr(loop, role)
        if tag is None:
            continue
        if tag in taken:
            remedy = f"correct {role}, or remove it"
            yield Warned(
                "loop",
                name,
                f"{role} is {tag}, its {taken[tag]} too: {remedy}",
                f"{role} and {taken[tag]} are one tag: {remedy}",
            )
        elif role == "scan" and _holds_a_float(tags.get(tag)):
            kind = (
                f"{tags[tag].data_type}: a counter of the PLC's cycles is a whole number; correct "
                "scan, or remove it"
            )
            yield Warned("loop", name, f"scan is {tag}, a {kind}", f"scan is a {kind}")
        taken.setdefault(tag, role)


def _holds_a_float(tag: Tag | None) -> bool:
    # The types of nodes of OPC UA are known to their server only.
    return tag is not None and not tag.node and tag.data_type in _FLOATS
