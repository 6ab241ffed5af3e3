"""What copy and paste leaves behind: one tag in two roles, one pair of tags in two loops.

All of it can be meant (two controllers on one valve for a time), so these are warnings.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from fieldlink.registers import DataType, Tag
from fieldlink.site.checked_site import Site
from fieldlink.site.models import Loop

__all__ = ["find_copies"]

_FLOATS = (DataType.FLOAT32, DataType.FLOAT64)


def find_copies(site: Site) -> Iterator[str]:
    """Yield a sentence for each loop that looks like a copy, and each tag in the wrong place."""
    pairs: dict[tuple[str, str, str], str] = {}
    names: dict[str, str] = {}
    for name, loop in site.loops.items():
        first = pairs.setdefault((loop.device, loop.op, loop.pv), name)
        if first != name:
            yield (
                f"loops {first} and {name}: both have OP {loop.op} and PV {loop.pv} of device "
                f"{loop.device}: if {name} was copied, correct its tags"
            )
        like = names.setdefault(name.casefold(), name)
        if like != name:
            yield (
                f"loops {like} and {name}: their names differ in case only, and are easily "
                "confused: rename one"
            )
        yield from _roles(name, loop, site.maps.get(loop.device, {}))


def _roles(name: str, loop: Loop, tags: Mapping[str, Tag]) -> Iterator[str]:
    taken = {loop.op: "OP", loop.pv: "PV"}
    for role in ("sp", "mode", "scan"):
        tag: str | None = getattr(loop, role)
        if tag is None:
            continue
        if tag in taken:
            yield (
                f"loop {name}: {role} is {tag}, its {taken[tag]} too: correct {role}, or remove it"
            )
        elif role == "scan" and _holds_a_float(tags.get(tag)):
            yield (
                f"loop {name}: scan is {tag}, a {tags[tag].data_type}: a counter of the PLC's "
                "cycles is a whole number; correct scan, or remove it"
            )
        taken.setdefault(tag, role)


def _holds_a_float(tag: Tag | None) -> bool:
    # The types of nodes of OPC UA are known to their server only.
    return tag is not None and not tag.node and tag.data_type in _FLOATS
