"""What must hold between a loop's compensator and the rest of a site."""

from __future__ import annotations

from collections.abc import Iterator

from fieldlink.registers import DataType, RegisterValueError, Table, Tag
from fieldlink.site.checked_site import Site
from fieldlink.site.errors import Problem, nearest
from fieldlink.site.models import Loop
from fieldlink.site.toml_source import TomlSource

__all__ = ["compensate_fits"]


def compensate_fits(site: Site, source: TomlSource, name: str, loop: Loop) -> Iterator[Problem]:
    """Return what is wrong with the table compensate of a loop that says where OP goes to."""
    settings = loop.compensate
    if settings.op_out is None:
        return
    yield from _op_out_fits(site, source, name, loop, settings.op_out)
    device = site.devices.get(loop.device)
    if device is not None and not device.link.startswith("modbus"):
        yield source.problem(
            ("loops", name, "compensate", "op_out"),
            f"device {loop.device!r} is not a Modbus device, OP cannot be written to it",
            "study simulated plants with fieldlink simulate",
        )
    if loop.sp is None:
        yield source.problem(
            ("loops", name, "compensate"),
            "the compensator needs the loop's set-point",
            "name its tag with sp",
        )
    if loop.writeback.exchange is None:
        yield source.problem(
            ("loops", name, "compensate"),
            "the loop has no exchange area to read the block from",
            f"give [loops.{name}.writeback] a base and a loop_id",
        )


def _op_out_fits(
    site: Site, source: TomlSource, name: str, loop: Loop, wanted: str
) -> Iterator[Problem]:
    key, tags = ("loops", name, "compensate", "op_out"), site.maps.get(loop.device)
    if tags is None:
        return
    tag = tags.get(wanted)
    if tag is None:
        yield source.problem(
            key,
            f"the register map of {loop.device!r} has no tag {wanted!r}",
            nearest(wanted, tags),
        )
    elif tag.table is not Table.HOLDING or tag.data_type in (DataType.BOOL, DataType.STRING):
        yield source.problem(
            key, f"{wanted} is not a number in a holding register", "name the tag that takes OP"
        )
    elif not tag.writable:
        yield source.problem(
            key,
            f"{wanted} is not writable in the register map",
            "set writable = yes there if the PLC expects OP in it",
        )
    else:
        if owner := _owner_of(site, name, tag):
            yield source.problem(
                key,
                f"{wanted} is {owner}: OP would be written over it",
                "name the tag from which the PLC takes this loop's OP",
            )
        low, high = loop.compensate.low, loop.compensate.high
        for end in ("low", "high"):
            try:
                tag.encode_inside(getattr(loop.compensate, end), low, high)
            except RegisterValueError as error:
                yield source.problem(
                    ("loops", name, "compensate", end),
                    f"OP could not be written to {error}",
                    "give low and high inside what the tag takes",
                )


def _owner_of(site: Site, name: str, wanted: Tag) -> str:
    """Say whose register a loop would write OP to; empty where that is its own.

    Tags of other names may be views of the same registers.
    """
    device = site.loops[name].device
    known = site.maps[device]
    for other, loop in site.loops_of(device).items():
        roles = {role: getattr(loop, role) for role in ("op", "pv", "sp", "mode", "scan")}
        if other == name:
            del roles["op"]  # some controllers take OP where they show it
        else:
            roles["op_out"] = loop.compensate.op_out
        for role, tag in roles.items():
            if tag in known and _overlap(known[tag], wanted):
                return f"the {role} of {'this loop' if other == name else f'loop {other}'}"
    return ""


def _overlap(one: Tag, other: Tag) -> bool:
    same = one.table is other.table
    return same and one.address < other.end and other.address < one.end
