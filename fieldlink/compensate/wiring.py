"""From the site file to what a compensator beside a PLC needs: link, exchange area, settings."""

from __future__ import annotations

from compensator import (
    HybridSettings,
    OpLimits,
    RetrySettings,
    SupervisorSettings,
    WatchSettings,
)
from fieldlink.errors import FieldlinkError
from fieldlink.links import Clock, Link, SystemClock
from fieldlink.links.modbus import ModbusLink, ModbusSettings
from fieldlink.registers import ExchangeLayout, Tag
from fieldlink.site import Loop, Site
from fieldlink.site.compensate import CompensateSettings

__all__ = ["CompensateError", "exchange_of", "link_to", "op_out_of", "supervising"]


class CompensateError(FieldlinkError):
    """A loop that cannot be compensated as the site file describes it."""


def supervising(loop: Loop, settings: CompensateSettings, limits: OpLimits) -> SupervisorSettings:
    """Return the supervisor's settings as the site file gives them."""
    return SupervisorSettings(
        hybrid=HybridSettings(limits),
        watch=WatchSettings(travel_budget=settings.travel_budget, pv_trip=settings.pv_trip),
        retry=RetrySettings(after=max(1, round(settings.retry_after / loop.period))),
        gain_sign=settings.gain_sign,
        period=loop.period,
    )


def op_out_of(site: Site, loop: Loop) -> Tag | None:
    """Return the tag that takes OP; None where the site file names none (dry runs only)."""
    wanted = loop.compensate.op_out
    return None if wanted is None else site.maps[loop.device][wanted]


def exchange_of(name: str, loop: Loop) -> ExchangeLayout:
    """Return where the loop's block is; raise `CompensateError` if there is none."""
    layout = loop.writeback.exchange
    if layout is None:
        raise CompensateError(
            f"loop {name} has no exchange area to read the block from; give "
            f"[loops.{name}.writeback] a base and a loop_id"
        )
    if loop.sp is None:
        raise CompensateError(f"loop {name} has no set-point; name its tag with sp")
    return layout


def link_to(site: Site, name: str, op_out: Tag | None, *, write: bool, clock: Clock | None) -> Link:
    """Return a Modbus link of one loop's tags; it can write OP and the refusal's register alone."""
    loop = site.loops[name]
    if not site.devices[loop.device].link.startswith("modbus"):
        raise CompensateError(
            f"device {loop.device!r} is not a Modbus device; simulated plants are studied with "
            "fieldlink simulate"
        )
    ranges: tuple[tuple[int, int], ...] = ()
    if write and op_out is not None:
        ranges = ((op_out.address, op_out.end - 1),)
        layout = loop.writeback.exchange
        if layout is not None and layout.ack_refusal is not None:
            ranges += ((layout.ack_refusal, layout.ack_refusal),)
    settings = ModbusSettings(loop.device, site.devices[loop.device], site, writable=ranges)
    return ModbusLink(settings, site.requests_of_loop(name), clock or SystemClock())
