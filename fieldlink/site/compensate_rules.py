"""What must hold between a loop's compensator and the rest of a site."""

from __future__ import annotations

from collections.abc import Iterator

from fieldlink.registers import DataType, RegisterValueError, Table
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
        for end in ("low", "high"):
            try:
                tag.encode(getattr(loop.compensate, end))
            except RegisterValueError as error:
                yield source.problem(
                    ("loops", name, "compensate", end),
                    f"OP could not be written to {error}",
                    "give low and high inside what the tag takes",
                )
